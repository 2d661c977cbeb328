"""A run: bring a folder to hold every lane of a study; what is there already is not done again.

Who simulates the shards is the crew's business: this process (`shards`) or others (`cluster`).
Nobody has to hold more than one cell's rows for the tables at the end.
"""

import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import numpy as np
import pandas as pd

from jaxnet.config import keys
from jaxnet.config.cells import Cell, to_plain
from jaxnet.config.keys import Config
from jaxnet.engine import batch
from jaxnet.engine.batch import Machine
from jaxnet.lanes.jobs import job, source_of
from jaxnet.runs import shards
from jaxnet.runs.shards import Assignment
from jaxnet.runs.tally import Done, Tally
from jaxnet.statistics import recovery, summary
from jaxnet.store import arrays, lane_store, layout, rows
from jaxnet.store.folder import (
    DERIVED,
    Folder,
    FolderError,
    TakenError,
    digest,
    made_from,
    said_of_kinds,
    versions,
)
from jaxnet.store.layout import Shard

Report = Callable[[Tally], None]
Crew = Callable[[Assignment, Sequence[Shard], Callable[[int], None]], Iterator[Done]]
READERS = 16  # files looked over at a time
CHOSEN = "trajectories.zarr"


def alone(machine: Machine) -> Crew:
    """The crew of this process."""
    return lambda work, todo, load_done: shards.simulate_shards(work, todo, machine, load_done)


class Run:
    """One study's way into one folder, which is held by its writer."""

    def __init__(
        self,
        study: Config,
        cells: Sequence[Cell],
        folder: Folder,
        progress: Report,
        machine: Machine,
        crew: Crew | None = None,
    ):
        self.began, self.before = time.monotonic(), folder.manifest
        if isinstance(study.samples, int):
            study = study.model_copy(update={"samples": max(study.samples, self.before.get("samples", 0))})
        self.study, self.cells, self.folder, self.machine = study, cells, folder, machine
        self.crew = crew or alone(machine)
        self.modules = made_from(study)
        self.size = self.before.get("shard_size") or layout.shard_size(cells, study)
        self.progress = progress

    def whole(self) -> bool:
        """Simulate what is missing, and make the tables and arrays; whether anything was missing."""
        looks = looks_of(self.study.samples, self.before.get("samples", 0))
        tally = self.tally(len(self.cells) * looks[-1])
        self.folder.remove_torn()
        self.folder.write_study(self.study)
        simulated = samples = 0
        for look in looks:
            tally.aim = len(self.cells) * look
            new = layout.shards_of(self.cells, look, self.size)[len(self.cells) * (samples // self.size) :]
            self.begin(look)
            simulated += self.simulate(new, self.work(self.prepare(look)), tally)
            samples = look
            if isinstance(self.study.samples, keys.Sequential):
                until = self.study.samples.until
                half = recovery.widest(tally.counts, self.cells, look, until)
                if half <= until.half_width:
                    break
                tally.last_look = f"± {half:.2g} at {look:,} samples a cell, ± {until.half_width:g} is asked"
        return self.finish(samples, simulated)

    def part(self, number: int, of: int) -> tuple[int, int, int]:
        """Simulate what is missing of every `of`-th shard from `number` on.

        Rows alone are written, and arrays beside them, so that others can do the same with the other shards.
        How many shards these are, how many were simulated, and how many lanes failed.
        """
        if isinstance(self.study.samples, keys.Sequential):
            raise FolderError("a part of the shards needs a number of samples, not a criterion to stop by")
        mine = layout.shards_of(self.cells, self.study.samples, self.size)[number::of]
        tally = self.tally(sum(len(shard.samples) for shard in mine))
        simulated = self.simulate(mine, self.work(None), tally)
        return len(mine), simulated, tally.failed

    def about(self, samples: int) -> dict[str, Any]:
        """Entries of the manifest that say what the folder holds once the run is through."""
        return {
            "hash": digest(self.study),
            "seed": self.study.seed,
            "versions": versions(),
            "kinds": said_of_kinds(self.study),
            "modules": {name: made_of._asdict() for name, made_of in self.modules.items()},
            "device": jax.devices()[0].device_kind,
            "chunk": self.machine.chunk,
            "cells": len(self.cells),
            "samples": samples,
            "shard_size": self.size,
            "save": to_plain(self.study.save),
        }

    def begin(self, samples: int) -> None:
        """Say in the manifest what is going to be in the folder."""
        about, before = self.about(samples), self.folder.manifest
        same = all(before.get(entry) == about[entry] for entry in ("save", "samples"))
        self.folder.write_manifest(**about, finished=same and before["finished"])

    def prepare(self, samples: int) -> dict[str, str]:
        """Make room for so many samples in the stores that are filled shard by shard; their identities."""
        identities = {}
        for name, variables in layout.filled_stores(self.cells, self.study.save).items():
            self.folder.look()
            store = arrays.prepare(self.folder.path / name, variables, self.cells, samples, self.size)
            identities[name] = arrays.identity(store)
        return identities

    def work(self, filled: dict[str, str] | None) -> Assignment:
        """What every shard takes."""
        return Assignment(
            self.folder.absolute(),
            digest(self.study),
            self.study,
            self.size,
            rows.column_types(self.study, self.cells),
            layout.filled_stores(self.cells, self.study.save),
            filled,
            self.modules,
            self.tau,
        )

    @property
    def tau(self) -> float | None:
        """Of the study's recovery, if that is asked for."""
        return None if self.study.recovery is None else self.study.recovery.tau

    def tally(self, lanes: int) -> Tally:
        """A count of so many lanes, before the first."""
        return Tally(self.cells, lanes, self.study.recovery is not None)

    def simulate(self, wanted: Sequence[Shard], work: Assignment, tally: Tally) -> int:
        """Simulate and store those shards that are not there yet; how many there were."""
        with ThreadPoolExecutor(READERS) as pool:
            found = list(pool.map(lambda shard: shards.there(work, shard), wanted))
        missing = [work.missing(shard, done) for shard, done in zip(wanted, found, strict=True)]
        todo = [shard for shard in missing if shard is not None]
        self.folder.need(layout.disk_bytes(self.study, self.cells, sum(len(shard.samples) for shard in todo)))
        self.tell(tally, [done for done in found if done is not None])
        if work.filled is not None and (todo or not self.folder.manifest["finished"]):
            self.clear_derived()

        def load_done(lanes: int) -> None:
            tally.under_way += lanes
            self.progress(tally)

        try:
            for done in self.crew(work, todo, load_done):
                self.tell(tally, [done])
        except TakenError as error:
            there = sum(each.lanes for each in tally.shards.values())
            raise TakenError(f"{error}: {there:,} of {tally.total:,} lanes") from error
        return len(todo)

    def tell(self, tally: Tally, found: Sequence[Done]) -> None:
        """Report shards that are there."""
        tally.there(found)
        self.progress(tally)

    def clear_derived(self) -> None:
        """Remove what was made of the rows that were there, which is told before."""
        if taken := [name for name in DERIVED if (self.folder.path / name).exists()]:
            warnings.warn(
                f"{self.folder.path}: removing what was made of the rows before: {', '.join(taken)}"
                " (jaxnet report makes it again)",
                stacklevel=2,
            )
        self.folder.clear((*taken, "cells.csv"))

    def finish(self, samples: int, simulated: int) -> bool:
        """The chosen trajectories, and the tables of all rows; whether anything was missing."""
        missing = simulated > 0 or not self.folder.manifest["finished"]
        every = layout.shards_of(self.cells, samples, self.size)
        if not isinstance(self.study.save.trajectories, str):
            lanes = rows.scan(self.folder, every, ("sample", "status", "tail_mean"))
            chosen = {number: chosen_samples(self.study.save, each) for number, each in lanes}
            missing = missing or not self.stored(chosen)
            if missing:
                self.store_chosen(chosen)
        table = summary.summarise(self.folder, every, self.cells, self.study, samples)
        self.folder.put("cells.csv", lambda file: table.to_csv(file, index=False))
        total, failed = (int(np.sum(table[name])) for name in ("lanes", "failed"))
        for taken in self.folder.path.glob("lanes/*.npz"):  # of parts that saved what is not asked for now
            self.folder.remove(f"lanes/{taken.name}")
        self.folder.write_manifest(  # all of it once more: an earlier holder's may have arrived late
            **self.about(samples),
            lanes={"total": total, "ok": total - failed, "failed": failed},
            wall_seconds=round(self.before.get("wall_seconds", 0.0) + time.monotonic() - self.began, 3),
            finished=True,
        )
        return missing

    def stored(self, chosen: Mapping[int, Sequence[int]]) -> bool:
        """Whether the chosen lanes' trajectories are there as they were written."""
        lanes = [(cell, sample) for cell, samples in chosen.items() for sample in samples]
        return lane_store.holds(self.folder.path / CHOSEN, layout.trajectory_variables(self.cells), lanes)

    def store_chosen(self, chosen: Mapping[int, Sequence[int]]) -> None:
        """Simulate the chosen lanes again with their trajectories, into a new store."""
        path, variables = self.folder.path / CHOSEN, layout.trajectory_variables(self.cells)
        lanes = [(self.cells[cell], sample) for cell, samples in chosen.items() for sample in samples]
        if arrays.opened(path) is not None:
            warnings.warn(
                f"{path} holds all lanes, and is replaced by one of those that are chosen", stacklevel=2
            )
        self.folder.remove(CHOSEN)
        store = lane_store.create_lanes(arrays.store_at(path), variables, self.cells, lanes)
        first = 0
        for cell, samples in ((self.cells[number], samples) for number, samples in chosen.items() if samples):
            source = source_of(self.study, cell.scenario)
            one = job(cell.scenario, source, samples, layout.series_of(variables))
            series = batch.simulate(one, self.machine).series
            self.folder.look()
            lane_store.write_lanes(store, first, cell, variables, series)
            first += len(samples)
        self.folder.look()
        lane_store.seal(store, path, variables, len(lanes))


def looks_of(samples: int | keys.Sequential, there: int) -> list[int]:
    """Samples a cell after which to look whether they are enough, the last in any case; `there` are begun.

    A fixed number is one look.
    """
    if not isinstance(samples, keys.Sequential):
        return [samples]
    return list(recovery.looks(there, samples.until.at_most))


def chosen_samples(save: keys.Save, lanes: pd.DataFrame) -> list[int]:
    """Samples of one cell whose trajectories are asked for, ascending."""
    match save.trajectories:
        case keys.Samples(samples=samples):
            return sorted(set(samples))
        case keys.WorstLanes(worst=count):
            ok: Any = lanes[lanes["status"] == "ok"]
            return sorted(ok.nlargest(count, "tail_mean")["sample"].tolist())
    return []
