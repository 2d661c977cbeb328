"""Simulate a study shard by shard into its folder; what is there already is not done again.

A shard holds consecutive samples of one cell. Small shards whose lanes can share a compiled program are
advanced together. `lanes/` is written last, so a shard that is there is complete with its arrays.
"""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import numpy as np
import pandas as pd
import pyarrow as pa
import zarr

from jaxnet.engine import batch, chassis
from jaxnet.engine.batch import Job
from jaxnet.engine.metrics import Metrics
from jaxnet.engine.status import Status
from jaxnet.study import arrays, config, layout, summary
from jaxnet.study.config import Config
from jaxnet.study.folder import Folder, digest, versions
from jaxnet.study.lanes import job
from jaxnet.study.layout import Shard, shard_size, shards_of
from jaxnet.study.sweep import Cell, plain

TOGETHER = 4 * batch.CHUNK  # lanes of small shards advanced as one

Progress = Callable[[int, int, int], None]  # lanes done, lanes in all, lanes failed


def execute(study: Config, cells: Sequence[Cell], folder: Folder, progress: Progress) -> None:
    """Bring the folder to hold every lane of the study; the folder is held by its writer."""
    began = time.monotonic()
    manifest = folder.manifest
    samples = max(study.samples, manifest.get("samples", 0))
    study = study.model_copy(update={"samples": samples})
    size = manifest.get("shard_size") or shard_size(cells, study.save)
    again = bool(manifest) and manifest["save"] != plain(study.save)
    folder.write_study(study)
    folder.write_manifest(
        hash=digest(study),
        seed=study.seed,
        versions=versions(),
        device=jax.devices()[0].device_kind,
        samples=samples,
        shard_size=size,
        save=plain(study.save),
        finished=manifest.get("finished", False) and manifest["samples"] == samples and not again,
    )
    todo = [
        shard
        for shard in shards_of(cells, samples, size)
        if again or not folder.done(shard.number, len(shard.samples))
    ]
    stores = prepare_stores(study, cells, folder, size, anew=again)
    tally = Tally(len(cells) * samples, todo, folder, progress)
    for shard, outcome in outcomes(study, todo, tally.chunk_done):
        store_shard(study, shard, outcome, folder, stores)
        tally.shard_done(outcome)
    rows: Any = read_rows(folder)
    if "chosen" in stores and (todo or not folder.manifest["finished"]):
        store_chosen(study, cells, rows, stores["chosen"])
    table = summary.summarise(rows, cells)
    folder.put("cells.csv", lambda file: table.to_csv(file, index=False))
    failed = int((rows["status"] != "ok").sum())
    folder.write_manifest(
        lanes={"total": len(rows), "ok": len(rows) - failed, "failed": failed},
        wall_seconds=round(manifest.get("wall_seconds", 0.0) + time.monotonic() - began, 3),
        finished=True,
    )


class Tally:
    """Counts lanes for the progress report; lanes of an unfinished shard count once it is stored."""

    def __init__(self, total: int, todo: Sequence[Shard], folder: Folder, progress: Progress):
        self.total, self.progress = total, progress
        self.done = total - sum(len(shard.samples) for shard in todo)
        self.failed = 0
        progress(self.done, total, 0)

    def chunk_done(self, lanes: int) -> None:
        """A chunk was advanced."""
        self.done += lanes
        self.progress(self.done, self.total, self.failed)

    def shard_done(self, outcome: chassis.Outcome) -> None:
        """A shard was stored."""
        self.failed += int((outcome.status != Status.ok).sum())
        self.progress(self.done, self.total, self.failed)


def prepare_stores(
    study: Config, cells: Sequence[Cell], folder: Folder, size: int, anew: bool
) -> dict[str, zarr.Group]:
    """Stores by what goes into them: `errors`, `all` trajectories, or those of `chosen` lanes."""
    stores, save = {}, study.save
    trajectories = {name: layout.TRAJECTORIES[name] for name in layout.trajectory_series(cells)}
    if anew:
        folder.clear_arrays()
    if save.errors:
        path = folder.path / "errors.zarr"
        stores["errors"] = arrays.prepare(path, layout.ERRORS, cells, study.samples, size)
    if save.trajectories != "none":
        path, kind = (
            folder.path / "trajectories.zarr",
            "all" if save.trajectories == "all" else "chosen",
        )
        chunk = size if kind == "all" else 1
        stores[kind] = arrays.prepare(path, trajectories, cells, study.samples, chunk)
    return stores


def outcomes(
    study: Config, shards: Sequence[Shard], chunk_done: Callable[[int], None]
) -> Iterator[tuple[Shard, chassis.Outcome]]:
    """Outcome of each shard, those that fit one program advanced together."""
    save = tuple(layout.ERRORS) if study.save.errors else ()
    if study.save.trajectories == "all":
        save += layout.trajectory_series([shard.cell for shard in shards])
    kinds: dict[Any, list[Shard]] = {}
    for shard in shards:
        kinds.setdefault(program_of(job(shard.cell.scenario, study.seed, [0], save)), []).append(shard)
    for alike in kinds.values():
        for together in packed(alike):
            jobs = [job(s.cell.scenario, study.seed, s.samples, save) for s in together]
            yield from zip(together, advance(jobs, chunk_done), strict=True)


def program_of(one: Job) -> Any:
    """What a job's compiled program depends on: types, shapes and the plan."""
    leaves, structure = jax.tree.flatten(one.inputs)
    return one.plan, structure, tuple((leaf.shape[1:], leaf.dtype) for leaf in leaves)


def packed(shards: Sequence[Shard]) -> Iterator[list[Shard]]:
    """Shards in runs of about TOGETHER lanes, in order."""
    run: list[Shard] = []
    for shard in shards:
        if run and sum(len(s.samples) for s in run) + len(shard.samples) > TOGETHER:
            yield run
            run = []
        run.append(shard)
    if run:
        yield run


def advance(jobs: Sequence[Job], chunk_done: Callable[[int], None]) -> list[chassis.Outcome]:
    """Outcomes of jobs that share a program."""
    outcome = batch.simulate(batch.join(jobs), chunk_done)
    ends = list(itertools.accumulate(one.size for one in jobs))
    return [
        jax.tree.map(lambda leaf, a=start, b=end: leaf[a:b], outcome)
        for start, end in zip([0, *ends], ends, strict=False)
    ]


def store_shard(
    study: Config,
    shard: Shard,
    outcome: chassis.Outcome,
    folder: Folder,
    stores: dict[str, zarr.Group],
) -> None:
    """Arrays first, rows last."""
    samples = slice(shard.samples.start, shard.samples.stop)
    for kind, names in (("errors", layout.ERRORS), ("all", layout.TRAJECTORIES)):
        if kind in stores:
            series = {name: outcome.series[name] for name in names if name in outcome.series}
            arrays.write(stores[kind], shard.cell.number, samples, series)
    folder.write_shard(shard.number, rows_of(study, shard, outcome))


def rows_of(study: Config, shard: Shard, outcome: chassis.Outcome) -> pa.Table:
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


def store_chosen(study: Config, cells: Sequence[Cell], rows: Any, store: zarr.Group) -> None:
    """Simulate the chosen lanes again with their trajectories."""
    series = layout.trajectory_series(cells)
    for cell in cells:
        samples = chosen_samples(study.save, rows[rows["cell"] == cell.number])
        if not samples:
            continue
        outcome = batch.simulate(job(cell.scenario, study.seed, samples, series))
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
