"""A study's search in its results folder: what was tried, the worst found in each cell, and how it stands up.

`search/CELL.npz` keeps what all choices came to, so that a search that is broken off goes on; `search.csv`
has a row a generation, `worst.csv` a row a cell, and `worst.yaml` is a study of the worst choice alone.
"""

import functools
import hashlib
import io
import json
import math
import time
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float
from upath import UPath

from jaxnet.config.cells import Cell, to_plain
from jaxnet.config.keys import Config, SearchSettings
from jaxnet.config.study import Study
from jaxnet.engine import batch
from jaxnet.engine.batch import Machine
from jaxnet.engine.plan import Outcome
from jaxnet.explore import alone, late
from jaxnet.explore.box import Box, places_of
from jaxnet.explore.late import Choice
from jaxnet.explore.search import COURSE, Generation, Point, Trials, searched
from jaxnet.kinds.fields import is_drawn
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.runs.cluster import Cluster
from jaxnet.runs.replay import with_engine
from jaxnet.statistics import limits, recovery
from jaxnet.statistics.reach import spread_of
from jaxnet.statistics.steps import Steps
from jaxnet.store import rows
from jaxnet.store.folder import Folder, FolderError, digest, made_from
from jaxnet.store.results import Results

CHECKPOINT = 10.0  # [s], or as much longer as keeps the share of WRITING
WRITING = 0.05  # of the time, at most
FRESH = 10_000  # starts from which the worst choice is tried again
BOUNDED = {"tail_max": np.max, "tail_mean": np.mean}  # of what vehicles' bounds come to, metrics are at most


class Worst(NamedTuple):
    """What was found in a cell."""

    cell: int
    found: float  # at the horizon
    late: float  # the same choice at `until`
    until: float  # [s]
    greatest: float  # of any choice, at the horizon
    magnitude: float  # ā [m]
    attacked: str  # vehicles
    random: float  # the best of as many random lanes
    bound: float  # of theory, where one holds
    fresh: float  # mean over other starts
    fresh_low: float  # 5 % quantile of them
    fresh_high: float  # and their greatest
    nonlinear: float  # from the same starts as `found`
    lanes: int
    failed: int


class Hunt:
    """The search in one cell."""

    def __init__(self, study: Config, cell: Cell, folder: Folder, machine: Machine):
        assert study.search is not None
        self.study, self.cell, self.folder, self.machine = study, cell, folder, machine
        self.asked: SearchSettings = study.search
        source = Keyed(study.seed)
        drawn = [place for place in places_of(cell.scenario, source) if place.name in self.asked.over]
        if missing := [key for key in self.asked.over if key not in {place.name for place in drawn}]:
            raise FolderError(f"{cell} does not draw {missing[0]}, so there is nothing to choose")
        self.box = Box(cell.scenario, source, drawn)
        self.kept = self.read()
        known = np.split(self.kept["values"], np.cumsum(self.kept["sizes"])[:-1]) if self.kept else []
        self.trials = Trials(self.box, self.asked.starts, self.measured, machine, known)

    def measured(self, outcome: Outcome) -> Float[np.ndarray, " lanes"]:
        """What is maximised, of each lane; not a number where it failed."""
        return np.where(outcome.status == 0, self.counted(outcome.metrics), math.nan)

    def counted(self, metrics: Mapping[str, Any]) -> Float[np.ndarray, " lanes"]:
        """What is maximised, of lanes with these metrics."""
        if self.asked.maximise != "unrecovered":
            return np.asarray(metrics[self.asked.maximise])
        assert self.study.recovery is not None
        over = recovery.threshold(self.cell, self.study.recovery.tau)
        return (np.asarray(metrics["tail_mean"]) > over).astype(float)

    def generations(self) -> Iterator[Generation]:
        """All, those that were there included; what they came to is kept now and then, and at the end."""
        due = time.monotonic() + CHECKPOINT
        try:
            for generation in searched(self.trials, self.asked.budget, self.asked.seed):
                yield generation
                if (began := time.monotonic()) > due:
                    self.keep()
                    ended = time.monotonic()
                    due = ended + max(CHECKPOINT, (ended - began) / WRITING)
        finally:
            self.keep()

    @property
    def file(self) -> str:
        """Where it is kept what the choices came to."""
        return f"search/{self.cell.number}.npz"

    def stamp(self) -> str:
        """Of all that makes the search go its way."""
        said = json.dumps([COURSE, digest(self.study), to_plain(self.asked), self.cell.number])
        return hashlib.sha256(said.encode()).hexdigest()

    def read(self) -> dict[str, np.ndarray]:
        """What a search like this one has kept; nothing if there was none."""
        path = self.folder.path / self.file
        if not path.exists():
            return {}
        try:
            with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as kept:
                return dict(kept) if str(kept["stamp"]) == self.stamp() else {}
        except (ValueError, KeyError, OSError, zipfile.BadZipFile) as error:
            raise FolderError(f"{path} cannot be read ({error}): remove it to search anew") from error

    def keep(self, **more: Any) -> None:
        """Write what the choices came to, unless it is there."""
        values = self.trials.values
        if more or len(values) > len(self.trials.known):
            sizes = np.array([len(each) for each in values])
            content = {"stamp": np.array(self.stamp()), "sizes": sizes, "values": np.concatenate(values)}
            content |= {name: np.array(value) for name, value in more.items()}
            self.folder.put(self.file, lambda file: np.savez_compressed(file, **content))  # pyright: ignore[reportArgumentType]

    def worst(self, results: Results) -> tuple[Study, Worst]:
        """The choice that the search answers with, as a study of its own, and its row; both are kept."""
        if "worst" in self.kept:
            return self.alone(self.kept["point"]), Worst(*json.loads(str(self.kept["worst"])))
        choice = late.chosen(self.trials, self.asked.until, self.measured, self.machine)
        study = self.alone(choice.point)
        found = self.tried_again(choice, study, results)
        self.keep(worst=json.dumps(found), point=choice.point)
        return study, found

    def alone(self, point: Point) -> Study:
        """The study of one choice."""
        return alone.study_of(self.study, self.cell, self.box, point)

    def tried_again(self, choice: Choice, study: Study, results: Results) -> Worst:
        """The choice beside random lanes and bounds, from other starts and by the other engine."""
        starts, trials = self.asked.starts, self.trials
        (found,) = study.cells
        fresh = self.box.lanes(np.tile(choice.point, (FRESH, 1)), np.arange(starts, starts + FRESH))
        same = job(with_engine(found, "nonlinear").scenario, Keyed(self.study.seed), range(starts))
        again, nonlinear = (self.measured(batch.simulate(each, self.machine)) for each in (fresh, same))
        given = found.scenario.attack.amplitude()
        amplitude = math.nan if is_drawn(given) else float(given)
        return Worst(
            self.cell.number,
            choice.found,
            choice.late,
            choice.until,
            trials.best if np.isfinite(trials.best) else math.nan,
            amplitude,
            " ".join(map(str, found.scenario.attack.targets())),
            self.best_random(results),
            bound_of(found.scenario, self.asked.maximise) * amplitude,
            *spread_of_values(again),
            float(nonlinear.mean()),
            trials.lanes,
            trials.failed + int(np.isnan(again).sum()),
        )

    def best_random(self, results: Results) -> float:
        """Of the folder's lanes of the cell; of shares their mean. Not a number if all failed."""
        column = "tail_mean" if self.asked.maximise == "unrecovered" else self.asked.maximise
        for _, found in results.by_cell(column, where=rows.OK, cells=[self.cell.number]):
            values = self.counted({column: found[column].to_numpy()})
            return float(values.mean() if self.asked.maximise == "unrecovered" else values.max())
        return math.nan


def spread_of_values(values: Float[np.ndarray, " lanes"]) -> tuple[float, float, float]:
    """Mean, 5 % quantile and greatest of those that are numbers."""
    there = values[~np.isnan(values)]
    if not there.size:
        return math.nan, math.nan, math.nan
    return float(there.mean()), float(np.quantile(there, 0.05)), float(there.max())


def bound_of(scenario: Any, metric: str) -> float:
    """The sharpest bound on a metric that holds, per ā; not a number where none is known."""
    if metric not in BOUNDED or spread_of(scenario) is None:
        return math.nan
    of_vehicles = BOUNDED[metric]
    return min(float(of_vehicles(bound.vehicles)) for bound, _ in limits.holding(scenario).values())


def table_of(found: Sequence[Worst], cells: Sequence[Cell]) -> pd.DataFrame:
    """A row a cell, its swept values first."""
    labelled = ({"cell": each.cell, **cells[each.cell].labels, **each._asdict()} for each in found)
    return pd.DataFrame(labelled)


def search_each(
    results: Results, machine: Machine, told: Steps, crew: Cluster | None = None
) -> Iterator[UPath]:
    """Search in each cell of a study whose random lanes a folder holds; the files, one after the other.

    A crew searches cells side by side, each to its end, before anything is written of all.
    """
    folder, study = results.folder, results.study
    config = study.config
    assert config.search is not None
    if crew is not None:
        for done, _ in enumerate(dealt(results, machine, crew), 1):
            told("cells searched", done, len(study.cells))
    found, generations = list[Worst](), list[dict[str, Any]]()
    for cell in study.cells:
        hunt = Hunt(config, cell, folder, machine)
        for generation in hunt.generations():
            words = f"{cell}: {config.search.maximise} {generation.best:.4g}"
            told(words, generation.lanes, config.search.budget)
            generations.append({"cell": cell.number, **cell.labels, **generation._asdict()})
        words = f"{cell}: at a late time, and again from other starts"
        told(words, config.search.budget, config.search.budget)
        choice, answer = hunt.worst(results)
        found.append(answer)
        yield alone.simulated(choice, folder.inside(f"worst/{cell.number}"), machine)
        name = "worst.yaml" if len(study.cells) == 1 else f"worst/{cell.number}.yaml"
        yield folder.put(name, functools.partial(alone.write_config, choice, name))
        tables = {"search.csv": pd.DataFrame(generations), "worst.csv": table_of(found, study.cells)}
        for name, table in tables.items():
            folder.put(name, functools.partial(table.to_csv, index=False))
    yield from (results.path / name for name in ("search.csv", "worst.csv"))


def dealt(results: Results, machine: Machine, crew: Cluster) -> Iterator[int]:
    """Cells searched by a crew, as they end; their numbers."""
    config = results.study.config
    task = functools.partial(search_cell, results.folder.absolute(), machine.chunk)
    cells = {f"cell {cell.number}": cell.number for cell in results.study.cells}
    yield from crew.deal(task, config.scope, made_from(config), cells)


def search_cell(folder: Folder, chunk: int | None, number: int) -> int:
    """On a worker: search in one cell to its end, and keep what came of it; its number."""
    results, machine = Results(folder.path), Machine(1, chunk)
    cell = results.study.cells[number]
    hunt = Hunt(results.study.config, cell, folder, machine)
    for _ in hunt.generations():
        pass
    hunt.worst(results)
    return number
