"""Simulate a study shard by shard into its folder; what is there already is not done again.

A shard holds consecutive samples of one cell. Shards whose lanes can share a compiled program follow each
other without a pause, drawn while others are simulated. `lanes/` is written last, so a shard that is there
is complete with its arrays.
"""

import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import numpy as np
import pandas as pd
import pyarrow as pa
import zarr

from jaxnet.engine import batch
from jaxnet.engine.batch import Job, Machine
from jaxnet.engine.metrics import Metrics
from jaxnet.engine.plan import Outcome
from jaxnet.engine.status import Status
from jaxnet.study import arrays, config, layout, summary
from jaxnet.study.config import Config
from jaxnet.study.folder import Folder, digest, versions
from jaxnet.study.lanes import job
from jaxnet.study.layout import Shard
from jaxnet.study.sweep import Cell, plain

Progress = Callable[[int, int, int], None]  # lanes done, lanes in all, lanes failed


def execute(
    study: Config, cells: Sequence[Cell], folder: Folder, progress: Progress, machine: Machine
) -> None:
    """Bring the folder to hold every lane of the study; the folder is held by its writer."""
    began, before = time.monotonic(), folder.manifest
    samples, save = max(study.samples, before.get("samples", 0)), plain(study.save)
    study = study.model_copy(update={"samples": samples})
    size = before.get("shard_size") or layout.shard_size(cells, study.save)
    same = before.get("save") == save and before.get("samples") == samples
    folder.remove_torn()
    folder.write_study(study)
    folder.write_manifest(
        hash=digest(study),
        seed=study.seed,
        versions=versions(),
        device=jax.devices()[0].device_kind,
        chunk=machine.chunk,
        samples=samples,
        shard_size=size,
        save=save,
        finished=same and before["finished"],
    )
    stores = prepare_stores(study, cells, folder, size)
    todo = [
        shard
        for shard in layout.shards_of(cells, samples, size)
        if not folder.done(shard.number, len(shard.samples), filled_by(stores))
    ]
    folder.need(layout.disk_bytes(study, cells, sum(len(shard.samples) for shard in todo)))
    tally = Tally(len(cells) * samples, todo, progress)
    for shard, outcome in outcomes(study, cells, todo, machine, tally.load_done):
        store_shard(study, shard, outcome, folder, stores)
        tally.shard_done(outcome)
    rows: Any = read_rows(folder)
    if todo or not folder.manifest["finished"]:
        store_chosen(study, cells, rows, folder, machine)
    table = summary.summarise(rows, cells)
    folder.put("cells.csv", lambda file: table.to_csv(file, index=False))
    failed = int((rows["status"] != "ok").sum())
    folder.write_manifest(
        lanes={"total": len(rows), "ok": len(rows) - failed, "failed": failed},
        wall_seconds=round(before.get("wall_seconds", 0.0) + time.monotonic() - began, 3),
        finished=True,
    )


class Tally:
    """Counts lanes for the progress report; lanes of an unfinished shard count once it is stored."""

    def __init__(self, total: int, todo: Sequence[Shard], progress: Progress):
        self.total, self.progress = total, progress
        self.done = total - sum(len(shard.samples) for shard in todo)
        self.failed = 0
        progress(self.done, total, 0)

    def load_done(self, lanes: int) -> None:
        """So many lanes came to their end."""
        self.done += lanes
        self.progress(self.done, self.total, self.failed)

    def shard_done(self, outcome: Outcome) -> None:
        """A shard was stored."""
        self.failed += int((outcome.status != Status.ok).sum())
        self.progress(self.done, self.total, self.failed)


def prepare_stores(study: Config, cells: Sequence[Cell], folder: Folder, size: int) -> dict[str, zarr.Group]:
    """Stores that are filled shard by shard, by their names; a shard's file says which it has filled."""
    wanted = {"errors": layout.ERRORS} if study.save.errors else {}
    if study.save.trajectories == "all":
        wanted["trajectories"] = layout.trajectory_variables(cells)
    return {
        name: arrays.prepare(folder.path / f"{name}.zarr", variables, cells, study.samples, size)
        for name, variables in wanted.items()
    }


def filled_by(stores: dict[str, zarr.Group]) -> dict[str, str]:
    """What a shard's file says of the stores that it has filled."""
    return {name: arrays.identity(store) for name, store in stores.items()}


def outcomes(
    study: Config,
    cells: Sequence[Cell],
    shards: Sequence[Shard],
    machine: Machine,
    load_done: Callable[[int], None],
) -> Iterator[tuple[Shard, Outcome]]:
    """Outcome of each shard, those that fit one program in one go."""
    save = tuple(layout.ERRORS) if study.save.errors else ()
    if study.save.trajectories == "all":
        save += layout.trajectory_series(cells)
    cells_in_need = {shard.cell.number: shard.cell for shard in shards}
    programs = {
        number: program_of(job(cell.scenario, study.seed, [0], save))
        for number, cell in cells_in_need.items()
    }
    kinds: dict[Any, list[Shard]] = {}
    for shard in shards:
        kinds.setdefault(programs[shard.cell.number], []).append(shard)
    for alike in kinds.values():
        one = job(alike[0].cell.scenario, study.seed, [0], save)
        inputs = (job(shard.cell.scenario, study.seed, shard.samples, save).inputs for shard in alike)
        lanes = sum(len(shard.samples) for shard in alike)
        ends = batch.simulate_each(inputs, lanes, one.network, one.clock, one.plan, machine, load_done)
        yield from zip(alike, ends, strict=True)


def program_of(one: Job) -> Any:
    """What jobs must share to run in one go: types, shapes, the plan, the network and the clock."""
    leaves, structure = jax.tree.flatten(one.inputs)
    shared, kind = jax.tree.flatten((one.network, one.clock))
    values = tuple((leaf.shape, leaf.tobytes()) for leaf in map(np.asarray, shared))
    return one.plan, structure, tuple((leaf.shape[1:], leaf.dtype) for leaf in leaves), kind, values


def store_shard(
    study: Config,
    shard: Shard,
    outcome: Outcome,
    folder: Folder,
    stores: dict[str, zarr.Group],
) -> None:
    """Arrays first, rows last."""
    samples = slice(shard.samples.start, shard.samples.stop)
    kinds = {"errors": layout.ERRORS, "trajectories": layout.TRAJECTORIES}
    for name, store in stores.items():
        series = {key: values for key, values in outcome.series.items() if key in kinds[name]}
        arrays.write(store, shard.cell.number, samples, series)
    folder.write_shard(shard.number, rows_of(study, shard, outcome), filled_by(stores))


def rows_of(study: Config, shard: Shard, outcome: Outcome) -> pa.Table:
    """One row per lane, columns as the contract orders them."""
    count = len(shard.samples)
    columns: dict[str, Any] = {
        "cell": np.full(count, shard.cell.number, dtype=np.int64),
        "sample": np.array(shard.samples, dtype=np.int64),
    }
    for key, label in shard.cell.labels.items():
        columns[key] = pa.array([label] * count, type=column_type(study, key, label))
    columns["status"] = [Status(code).name for code in outcome.status]
    columns |= {name: getattr(outcome.metrics, name) for name in Metrics._fields}
    columns |= {
        "steps": outcome.steps.astype(np.int64),
        "switches": outcome.switches.astype(np.int64),
    }
    return pa.table(columns)


def column_type(study: Config, key: str, label: Any) -> pa.DataType:
    """Type of a swept key's column, the same in every shard."""
    if isinstance(label, str):
        return pa.string()
    given = study.sweep[key]
    whole = isinstance(given, list) and all(isinstance(value, int) for value in given)
    return pa.int64() if whole else pa.float64()


def store_chosen(study: Config, cells: Sequence[Cell], rows: Any, folder: Folder, machine: Machine) -> None:
    """Simulate the chosen lanes again with their trajectories, into a new store."""
    if isinstance(study.save.trajectories, str):
        return
    path, variables = folder.path / "trajectories.zarr", layout.trajectory_variables(cells)
    shutil.rmtree(path, ignore_errors=True)
    store = arrays.prepare(path, variables, cells, study.samples, chunk=1)
    for cell in cells:
        samples = chosen_samples(study.save, rows[rows["cell"] == cell.number])
        if not samples:
            continue
        outcome = batch.simulate(job(cell.scenario, study.seed, samples, tuple(variables)), machine)
        for place, sample in enumerate(samples):
            one = {name: values[place : place + 1] for name, values in outcome.series.items()}
            arrays.write(store, cell.number, slice(sample, sample + 1), one)


def chosen_samples(save: config.Save, rows: Any) -> list[int]:
    """Samples of one cell whose trajectories are asked for."""
    match save.trajectories:
        case config.Samples(samples=samples):
            return samples
        case config.Worst(worst=count):
            ok = rows[rows["status"] == "ok"]
            return ok.nlargest(count, "tail_mean")["sample"].tolist()
    return []


def read_rows(folder: Folder) -> pd.DataFrame:
    """All rows of a folder, by cell and sample."""
    files = sorted((folder.path / "lanes").glob("[0-9]*.parquet"))
    rows = pd.concat([pd.read_parquet(file) for file in files], ignore_index=True)
    return rows.sort_values(["cell", "sample"], ignore_index=True)
