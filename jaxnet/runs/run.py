"""A run: simulate the lanes of a study that its folder lacks.

The executor simulates the shards, in this process (`shards`) or in others (`cluster`). The tables
at the end need the rows of one cell in memory at a time.
"""

import itertools
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import numpy as np
import pandas as pd

from jaxnet.config import keys
from jaxnet.config.cells import Cell, judged_metric
from jaxnet.config.keys import Config
from jaxnet.engine.batch import Machine
from jaxnet.model.wording import count
from jaxnet.runs import shards
from jaxnet.runs.shards import Assignment
from jaxnet.runs.tally import LAST_PHASE, Done, Tally
from jaxnet.statistics import recovery, summary
from jaxnet.store import arrays, layout, rows
from jaxnet.store.folder import DERIVED, Folder, FolderError, TakenError
from jaxnet.store.layout import Shard
from jaxnet.store.manifest import changed_settings, digest, manifest_entries, samples_of_cells
from jaxnet.store.tables import csv_text

ReportTally = Callable[[Tally], None]
Executor = Callable[[Assignment, Sequence[Shard], Callable[[int], None]], Iterator[Done]]
SEARCHED = ("search.csv", "worst.csv", "worst.yaml", "worst")  # jaxnet search goes on from search/
CHOSEN_STORE = "trajectories.zarr"


def made_of_rows(folder: Folder) -> list[str]:
    """Name what other rows make wrong; a sensitivity analysis has lanes and figures of its own."""
    figures = [f"figures/{each.name}" for each in folder.path.glob("figures/*")]
    others = [name for name in figures if not name.startswith("figures/sensitivity")]
    if others == figures:
        return [*DERIVED]
    return [*(name for name in DERIVED if name != "figures"), *others]


class Run:
    def __init__(
        self,
        study: Config,
        cells: Sequence[Cell],
        folder: Folder,
        progress: ReportTally,
        machine: Machine,
        crew: Executor | None = None,
    ):
        self.began, self.before = time.monotonic(), folder.manifest
        self.same_rows = False  # as the folder had when it was finished
        if isinstance(study.samples, int):
            asked, most = study.samples, max(study.samples, self.before.get("samples", 0))
            study = study.model_copy(update={"samples": most})
            if asked < most:
                told = f"the run was begun with samples: {most}, and keeps them"
                fewer = f"for samples: {asked} give --out or --fresh"
                warnings.warn(f"{folder.path}: {told}; {fewer}", stacklevel=2)
        self.study, self.cells, self.folder, self.machine = study, cells, folder, machine
        self.progress = progress
        self.crew = crew or (
            lambda work, todo, told: shards.simulate_shards(work, todo, machine, told)
        )
        self.work = Assignment(
            folder=Folder(folder.path.absolute(), folder.holds),
            study=digest(study),
            config=study,
            size=self.before.get("shard_size") or layout.shard_size(cells, study),
            columns=rows.row_columns(study, cells),
            stores=layout.filled_stores(cells, study.save),
            filled=None,
        )

    def whole(self) -> bool:
        """Simulate missing lanes, write tables and arrays; return whether lanes were missing."""
        there = samples_of_cells(self.before, len(self.cells))
        asked = self.study.samples
        looks: Sequence[list[int]] = [  # numbers of samples after which each cell may end
            list(recovery.looks(each, asked.until.at_most))
            if isinstance(asked, keys.Sequential)
            else [asked]
            for each in there
        ]
        lanes = sum(ahead[-1] for ahead in looks)
        tally = Tally(self.cells, lanes, self.study.recovery is not None)
        self.need_room(sum(ahead[0] for ahead in looks))
        self.folder.remove_torn()
        self.clear_settings()
        self.folder.write_study(self.study)
        simulated, samples = 0, [0] * len(self.cells)
        while any(looks):
            before = samples
            samples = [ahead[0] if ahead else end for ahead, end in zip(looks, before, strict=True)]
            tally.aim = sum(samples)
            every = layout.shards_of(self.cells, samples, self.work.size)
            new = [shard for shard in every if shard.samples.stop > before[shard.cell.number]]
            self.begin(samples)
            simulated += self.simulate(new, tally)
            looks = self.looks_ahead([ahead[1:] for ahead in looks], samples, tally)
        return self.finish(samples, simulated, tally)

    def need_room(self, lanes: int) -> None:
        """Raise FolderError if lanes do not fit the disk; each row file counts as a full shard."""
        there = sum(1 for _ in self.folder.path.glob("lanes/*.parquet")) * self.work.size
        self.folder.need(layout.disk_bytes(self.study, self.cells, max(0, lanes - there)))

    def looks_ahead(
        self, looks: Sequence[list[int]], samples: Sequence[int], tally: Tally
    ) -> Sequence[list[int]]:
        """Looks that each cell has ahead: none where its interval is narrow enough."""
        if not isinstance(self.study.samples, keys.Sequential):
            return looks
        until = self.study.samples.until
        halves = recovery.half_intervals(tally.counts, self.cells, samples, until)
        over = [half > until.half_width for half in halves]
        wide = [number for number, ahead in enumerate(looks) if ahead and over[number]]
        if wide:
            going = f"{'go' if len(wide) > 1 else 'goes'} on"
            cells = f"{len(wide)} of {count(len(self.cells), 'cell')} {going}"
            asked = f"± {halves[wide].max():.2g}, ± {until.half_width:g} is asked"
            tally.last_look = f"{asked}; {cells}"
        return [ahead if number in wide else [] for number, ahead in enumerate(looks)]

    def part(self, number: int, of: int) -> tuple[int, int, int]:
        """Simulate the missing lanes of shards `number`, `number + of`, …

        The method writes rows, and arrays beside them, so that other processes can simulate other
        shards. Returns the number of these shards, the number simulated now, and the number of
        failed lanes.
        """
        if isinstance(self.study.samples, keys.Sequential):
            told = "a part of the shards needs a number of samples, not a criterion to stop by"
            raise FolderError(told)
        samples = [self.study.samples] * len(self.cells)
        self.need_room(sum(samples) // of)
        mine = layout.shards_of(self.cells, samples, self.work.size)[number::of]
        lanes = sum(len(shard.samples) for shard in mine)
        tally = Tally(self.cells, lanes, self.study.recovery is not None)
        return len(mine), self.simulate(mine, tally), tally.failed

    def about(self, samples: Sequence[int]) -> dict[str, object]:
        """The manifest's entries on the folder; `samples` are the numbers of the cells."""
        return {
            **manifest_entries(self.study),
            "seed": self.study.seed,
            "device": jax.devices()[0].device_kind,
            "chunk": self.machine.chunk,
            "cells": len(self.cells),
            "samples": max(samples),
            "cell_samples": list(samples) if min(samples) < max(samples) else None,
            "shard_size": self.work.size,
        }

    def begin(self, samples: Sequence[int]) -> None:
        """Write the manifest, and make room for these samples in the stores that shards fill."""
        about, before = self.about(samples), self.folder.manifest
        entries = ("samples", "cell_samples")
        same = all(before.get(entry) == about[entry] for entry in entries)
        self.same_rows = same and before["finished"]
        finished = self.same_rows and before["save"] == about["save"]
        self.folder.write_manifest(**about, finished=finished)
        filled, size = {}, self.work.size
        for name, variables in self.work.stores.items():
            path = self.folder.path / name
            with self.folder.naming(name):
                filled[name] = arrays.prepare(path, variables, self.cells, max(samples), size)
        self.work = self.work._replace(filled=filled)

    def simulate(self, wanted: Sequence[Shard], tally: Tally) -> int:
        """Simulate the missing lanes of these shards; return the number of incomplete shards."""
        work = self.work
        with ThreadPoolExecutor(rows.READERS) as pool:
            found = list(pool.map(lambda shard: shards.find_done(work, shard), wanted))
        missing = [work.missing(shard, done) for shard, done in zip(wanted, found, strict=True)]
        todo = [shard for shard in missing if shard is not None]
        lanes = sum(len(shard.samples) for shard in todo)
        self.folder.need(layout.disk_bytes(self.study, self.cells, lanes))
        tally.record(done for done in found if done is not None)
        self.progress(tally)
        concerned = {shard.cell.number: shard.cell for shard in todo}
        shards.try_kinds(self.study, [*concerned.values()], self.machine, work.series)
        if work.filled is not None and (todo or not self.folder.manifest["finished"]):
            gone = () if self.same_rows else made_of_rows(self.folder)
            self.clear_derived("made of the rows before", gone)

        def load_done(lanes: int) -> None:
            tally.under_way += lanes
            self.progress(tally)

        try:
            for done in self.crew(work, todo, load_done):
                tally.record([done])
                self.progress(tally)
        except TakenError as error:
            there = sum(each.lanes for each in tally.shards.values())
            raise TakenError(f"{error}: {there:,} of {tally.total:,} lanes") from error
        return len(todo)

    def clear_settings(self) -> None:
        """Remove what was made with other settings than the study's."""
        if not (changed := changed_settings(self.before, self.study)):
            return
        counted = self.study.search is not None and self.study.search.maximise == "unrecovered"
        searched = "search" in changed or ("recovery" in changed and counted)
        told = f"made with another {' and '.join(changed)}"
        self.clear_derived(told, (*DERIVED, *(SEARCHED if searched else ())))

    def clear_derived(self, told: str, names: Sequence[str]) -> None:
        """Remove `cells.csv`, and with a warning those of these files that are there."""
        if taken := [name for name in names if (self.folder.path / name).exists()]:
            whole = ", ".join(dict.fromkeys(name.partition("/")[0] for name in taken))
            removed = f"removing what was {told}: {whole} (jaxnet report makes it again)"
            warnings.warn(f"{self.folder.path}: {removed}", stacklevel=2)
        self.folder.remove(*taken, "cells.csv")

    def finish(self, samples: Sequence[int], simulated: int, tally: Tally) -> bool:
        """Write chosen trajectories and tables of all rows; return whether any were missing."""
        missing = simulated > 0 or not self.folder.manifest["finished"]
        every = layout.shards_of(self.cells, samples, self.work.size)
        if not isinstance(self.study.save.trajectories, str):
            missing = self.store_chosen(every, missing, tally) or missing
            tally.phase = LAST_PHASE
        table = summary.summarise(self.folder, every, self.cells, self.study, samples)
        self.folder.put("cells.csv", csv_text(table).encode())
        total, failed = (int(np.sum(table[name])) for name in ("lanes", "failed"))
        # of parts that saved what is not asked for now
        self.folder.remove(*(f"lanes/{each.name}" for each in self.folder.path.glob("lanes/*.npz")))
        seconds = self.before.get("wall_seconds", 0.0) + time.monotonic() - self.began
        # all of it once more: an earlier holder's may have arrived late
        self.folder.write_manifest(
            **self.about(samples),
            lanes={"total": total, "ok": total - failed, "failed": failed},
            wall_seconds=round(seconds, 3),
            finished=True,
        )
        return missing

    def store_chosen(self, every: Sequence[Shard], anew: bool, tally: Tally) -> bool:
        """Simulate the chosen lanes again, and write their trajectories into a new store.

        Unless `anew`, a store that holds just these lanes stays. Returns whether it was written.
        """
        path, variables = self.folder.path / CHOSEN_STORE, layout.trajectory_variables(self.cells)
        metric = judged_metric(self.cells)
        lanes = rows.scan_cells(self.folder, every, ("sample", "status", metric))
        parts = [
            (self.cells[number], samples)
            for number, each in lanes
            if (samples := chosen_samples(self.study.save, each, metric))
        ]
        chosen = [(cell, sample) for cell, samples in parts for sample in samples]
        wanted = [(cell.number, sample) for cell, sample in chosen]
        if not anew and arrays.holds_lanes(path, variables, wanted):
            return False
        if arrays.open_for_writing(path) is not None:
            told = "holds all lanes, and is replaced by one of those that are chosen"
            warnings.warn(f"{path} {told}", stacklevel=2)
        self.folder.remove(CHOSEN_STORE)
        with self.folder.naming(CHOSEN_STORE):
            store = arrays.create_lanes(arrays.store_at(path), variables, self.cells, chosen)
        first = [0, *itertools.accumulate(len(samples) for _, samples in parts)]
        series = layout.series_of(variables)
        outcomes = shards.simulate_outcomes(self.study, parts, series, self.machine)
        for done in range(len(parts)):
            tally.phase = f"trajectories, cell {done + 1} of {len(parts)}"
            place, outcome = next(outcomes)
            with self.folder.naming(CHOSEN_STORE):
                arrays.write_lanes(store, first[place], parts[place][0], variables, outcome.series)
        with self.folder.naming(CHOSEN_STORE):
            arrays.seal(store, path, variables, len(chosen))
        return True


def chosen_samples(save: keys.Save, lanes: pd.DataFrame, metric: str) -> list[int]:
    """Samples of one cell whose trajectories the study saves, ascending; the worst by a metric."""
    match save.trajectories:
        case keys.Samples(samples=samples):
            return sorted(set(samples))
        case keys.WorstLanes(worst=count):
            ok: Any = lanes[lanes["status"] == "ok"]
            return sorted(ok.nlargest(count, metric)["sample"].tolist())
    return []
