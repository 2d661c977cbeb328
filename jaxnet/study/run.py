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
from jaxnet.study import arrays, config, layout, recovery, summary
from jaxnet.study.config import Config
from jaxnet.study.folder import DERIVED, Folder, FolderError, digest, versions
from jaxnet.study.lanes import job
from jaxnet.study.layout import Shard
from jaxnet.study.sweep import Cell, plain

Progress = Callable[[int, int, int], None]  # lanes done, lanes in all, lanes failed


def execute(
    study: Config, cells: Sequence[Cell], folder: Folder, progress: Progress, machine: Machine
) -> None:
    """Bring the folder to hold every lane of the study; the folder is held by its writer."""
    began, before = time.monotonic(), folder.manifest
    if isinstance(study.samples, int):
        study = study.model_copy(update={"samples": max(study.samples, before.get("samples", 0))})
    size = before.get("shard_size") or layout.shard_size(cells, study)
    looks = looks_of(study, before.get("samples", 0), size)
    folder.remove_torn()
    folder.write_study(study)
    tally = Tally(len(cells) * looks[-1], progress)
    counts, simulated, samples = recovery.nobody(cells), False, 0
    for look in looks:
        shards = layout.shards_of(cells, look, size)[len(cells) * (samples // size) :]
        begin(study, folder, machine, look, size)
        simulated |= simulate_shards(study, cells, shards, folder, machine, tally, look, size)
        samples = look
        if isinstance(study.samples, config.Sequential):
            assert study.recovery is not None
            rows = read_rows(folder, shards)
            counts = counts.plus(recovery.count(rows, cells, study.recovery.tau))
            if recovery.settled(counts, cells, look // size, study.samples.until):
                break
    rows: Any = read_rows(folder)
    if simulated or not folder.manifest["finished"]:
        store_chosen(study, cells, rows, folder, machine, samples)
    table = summary.summarise(rows, cells, study, samples // size)
    folder.put("cells.csv", lambda file: table.to_csv(file, index=False))
    failed = int((rows["status"] != "ok").sum())
    folder.write_manifest(
        lanes={"total": len(rows), "ok": len(rows) - failed, "failed": failed},
        wall_seconds=round(before.get("wall_seconds", 0.0) + time.monotonic() - began, 3),
        finished=True,
    )


def looks_of(study: Config, there: int, size: int) -> list[int]:
    """Samples a cell after which to look whether they are enough, the last in any case; `there` are begun.

    A fixed number is one look. A criterion looks after whole shards, so that each number of shards is
    looked at once, whatever was there.
    """
    if not isinstance(study.samples, config.Sequential):
        return [study.samples]
    least, most = max(1, -(-there // size)), study.samples.until.at_most // size
    if least * size > max(study.samples.until.at_most, there):
        raise FolderError(
            f"the folder's shards hold {size} samples, so at least {least * size} are simulated: allow them"
            " by samples.until.at_most, give another folder with --out, or replace its results with --fresh"
        )
    return [shards * size for shards in range(least, max(least, most) + 1)]


def begin(study: Config, folder: Folder, machine: Machine, samples: int, size: int) -> None:
    """Say in the manifest what is going to be in the folder."""
    before, save = folder.manifest, plain(study.save)
    same = before.get("save") == save and before.get("samples") == samples
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


def simulate_shards(
    study: Config,
    cells: Sequence[Cell],
    shards: Sequence[Shard],
    folder: Folder,
    machine: Machine,
    tally: "Tally",
    samples: int,
    size: int,
) -> bool:
    """Simulate and store those shards that are not there yet; whether there were any."""
    stores = prepare_stores(study, cells, folder, samples, size)
    todo = [shard for shard in shards if not folder.done(shard.number, len(shard.samples), filled_by(stores))]
    folder.need(layout.disk_bytes(study, cells, sum(len(shard.samples) for shard in todo)))
    tally.expect(shards, todo)
    if todo:
        folder.clear((*DERIVED, "cells.csv"))
    for shard, outcome in outcomes(study, cells, todo, machine, tally.load_done):
        store_shard(study, shard, outcome, folder, stores)
        tally.shard_done(outcome)
    return bool(todo)


class Tally:
    """Counts lanes for the progress report; lanes of an unfinished shard count once it is stored."""

    def __init__(self, total: int, progress: Progress):
        self.total, self.progress = total, progress
        self.done = self.failed = 0

    def expect(self, shards: Sequence[Shard], todo: Sequence[Shard]) -> None:
        """Of these shards, all but those to do are there."""
        self.done += sum(len(shard.samples) for shard in shards) - sum(len(shard.samples) for shard in todo)
        self.progress(self.done, self.total, self.failed)

    def load_done(self, lanes: int) -> None:
        """So many lanes came to their end."""
        self.done += lanes
        self.progress(self.done, self.total, self.failed)

    def shard_done(self, outcome: Outcome) -> None:
        """A shard was stored."""
        self.failed += int((outcome.status != Status.ok).sum())
        self.progress(self.done, self.total, self.failed)


def prepare_stores(
    study: Config, cells: Sequence[Cell], folder: Folder, samples: int, size: int
) -> dict[str, zarr.Group]:
    """Stores that are filled shard by shard, by their names; a shard's file says which it has filled."""
    wanted = {"errors": layout.ERRORS} if study.save.errors else {}
    if study.save.trajectories == "all":
        wanted["trajectories"] = layout.trajectory_variables(cells)
    return {
        name: arrays.prepare(folder.path / f"{name}.zarr", variables, cells, samples, size)
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


def store_chosen(
    study: Config, cells: Sequence[Cell], rows: Any, folder: Folder, machine: Machine, samples: int
) -> None:
    """Simulate the chosen lanes again with their trajectories, into a new store."""
    if isinstance(study.save.trajectories, str):
        return
    path, variables = folder.path / "trajectories.zarr", layout.trajectory_variables(cells)
    shutil.rmtree(path, ignore_errors=True)
    store = arrays.prepare(path, variables, cells, samples, chunk=1)
    for cell in cells:
        chosen = chosen_samples(study.save, rows[rows["cell"] == cell.number])
        if not chosen:
            continue
        outcome = batch.simulate(job(cell.scenario, study.seed, chosen, tuple(variables)), machine)
        for place, sample in enumerate(chosen):
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


def read_rows(folder: Folder, shards: Sequence[Shard] | None = None) -> pd.DataFrame:
    """Rows of some shards, or all of a folder, by cell and sample."""
    if shards is None:
        files = sorted((folder.path / "lanes").glob("[0-9]*.parquet"))
    else:
        files = [folder.shard(shard.number) for shard in shards]
    rows = pd.concat([pd.read_parquet(file) for file in files], ignore_index=True)
    return rows.sort_values(["cell", "sample"], ignore_index=True)
