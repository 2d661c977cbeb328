"""A study's search in its results folder: generations, the worst choice in each cell, and its verification.

`search/CELL.npz` stores the values of all choices, so that an interrupted search resumes. `search.csv` has a
row per generation and `worst.csv` a row per cell. `worst.yaml` is a study of the worst choice.
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
from jaxtyping import Array, Bool, Float
from upath import UPath

from jaxnet.config.cells import Cell, to_plain
from jaxnet.config.keys import Config, Scenario, SearchSettings
from jaxnet.config.study import Study
from jaxnet.engine import batch
from jaxnet.engine.batch import Machine
from jaxnet.engine.plan import Outcome
from jaxnet.explore import alone, late
from jaxnet.explore.box import Box, places_of
from jaxnet.explore.late import LateChoice
from jaxnet.explore.search import SEARCH_VERSION, BoxPoint, Generation, Trials, search_box
from jaxnet.kinds.fields import is_drawn
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.runs.cluster import Cluster
from jaxnet.runs.replay import with_engine
from jaxnet.statistics import limits, recovery
from jaxnet.statistics.steps import Steps
from jaxnet.store import gate, rows
from jaxnet.store.folder import Folder, FolderError, digest, modules_of
from jaxnet.store.results import Results
from jaxnet.store.tables import write_table
from jaxnet.theory.spread import scenario_gain

CHECKPOINT = 10.0  # [s] between checkpoints, at least
WRITING = 0.05  # share of the time for checkpoints, at most
FRESH = 10_000  # further starts to verify the worst choice
REDUCTIONS = {"tail_max": np.max, "tail_mean": np.mean}  # from vehicles' bounds to a metric's bound


class WorstChoice(NamedTuple):
    """Row of `worst.csv`: the worst choice in a cell."""

    cell: int
    found: float  # mean over the starts, at the horizon
    late: float  # mean over the starts, at `until`
    until: float  # [s]
    greatest: float  # of all choices, at the horizon
    magnitude: float  # ā [m]
    attacked: str  # vehicles
    random: float  # greatest of as many random lanes
    bound: float  # of theory; not-a-number if none holds
    fresh: float  # mean over further starts
    fresh_low: float  # 5 % quantile over further starts
    fresh_high: float  # greatest over further starts
    fresh_allowed: float  # share of further starts that fulfil `subject_to`
    nonlinear: (
        float  # mean over the starts of `found`, by the nonlinear engine if it moves the vehicles
    )
    lanes: int
    failed: int


class CellSearch:
    """The search in one cell."""

    def __init__(self, study: Config, cell: Cell, folder: Folder, machine: Machine):
        assert study.search is not None
        self.study, self.cell, self.folder, self.machine = study, cell, folder, machine
        self.settings: SearchSettings = study.search
        source = Keyed(study.seed)
        drawn = [
            place for place in places_of(cell.scenario, source) if place.name in self.settings.over
        ]
        if missing := [
            key for key in self.settings.over if key not in {place.name for place in drawn}
        ]:
            raise FolderError(f"{cell} does not draw {missing[0]}, so there is nothing to choose")
        self.box = Box(cell.scenario, source, drawn)
        self.stored = self.load()
        known = (
            np.split(self.stored["values"], np.cumsum(self.stored["sizes"])[:-1])
            if self.stored
            else []
        )
        self.trials = Trials(self.box, self.settings.starts, self.measure, machine, known)

    def measure(self, outcome: Outcome) -> Float[np.ndarray, " lanes"]:
        """Return the objective of each lane; not-a-number where the lane failed, and minus infinity where it
        is not allowed.
        """
        values = self.values(outcome)
        return np.where(self.allowed(outcome.metrics) | np.isnan(values), values, -math.inf)

    def values(self, outcome: Outcome) -> Float[np.ndarray, " lanes"]:
        """Return the objective of each lane, allowed or not; not-a-number where the lane failed."""
        return np.where(outcome.status == 0, self.objective(outcome.metrics), math.nan)

    def allowed(
        self, metrics: Mapping[str, Float[Array | np.ndarray, " lanes"]]
    ) -> Bool[np.ndarray, "..."]:
        """Return whether lanes with these metrics fulfil `subject_to`; a blank metric does not."""
        fulfilled = np.asarray(True)
        for name, most in self.settings.subject_to.items():
            fulfilled = fulfilled & (np.asarray(metrics[name]) <= most)
        return fulfilled

    def objective(
        self, metrics: Mapping[str, Float[Array | np.ndarray, " lanes"]]
    ) -> Float[np.ndarray, " lanes"]:
        """Return the objective of lanes with these metrics."""
        if self.settings.maximise != "unrecovered":
            return np.asarray(metrics[self.settings.maximise])
        over = recovery.threshold(self.cell, self.study.recovery)
        return (np.asarray(metrics[self.cell.scenario.judged]) > over).astype(float)

    def generations(self) -> Iterator[Generation]:
        """Yield all generations, stored ones included; save the values at checkpoints and at the end."""
        due = time.monotonic() + CHECKPOINT
        try:
            for generation in search_box(self.trials, self.settings.budget, self.settings.seed):
                yield generation
                if (began := time.monotonic()) > due:
                    self.save()
                    ended = time.monotonic()
                    due = ended + max(CHECKPOINT, (ended - began) / WRITING)
        finally:
            self.save()

    @property
    def file(self) -> str:
        """Name of the file with the values of all choices."""
        return f"search/{self.cell.number}.npz"

    def stamp(self) -> str:
        """Return a hash of everything that determines the search."""
        counted = self.settings.maximise == "unrecovered"
        over = [to_plain(self.study.recovery)] if counted and self.study.recovery else []
        told = [
            SEARCH_VERSION,
            digest(self.study),
            to_plain(self.settings),
            self.cell.number,
            *over,
        ]
        identity = json.dumps(told)
        return hashlib.sha256(identity.encode()).hexdigest()

    def load(self) -> dict[str, np.ndarray]:
        """Return the stored values of a search with the same stamp; empty if there is none.

        Raises FolderError if the file is damaged.
        """
        path = self.folder.path / self.file
        if not path.exists():
            return {}
        try:
            with np.load(io.BytesIO(gate.read_whole(path)), allow_pickle=False) as stored:
                return dict(stored) if str(stored["stamp"]) == self.stamp() else {}
        except (ValueError, KeyError, OSError, zipfile.BadZipFile) as error:
            raise FolderError(
                f"{path} cannot be read ({error}): remove it to search anew"
            ) from error

    def save(self, **more: np.ndarray | str) -> None:
        """Write the values of all choices, unless they are stored already."""
        values = self.trials.values
        if more or len(values) > len(self.trials.known):
            sizes = np.array([len(each) for each in values])
            content = {
                "stamp": np.array(self.stamp()),
                "sizes": sizes,
                "values": np.concatenate(values),
            }
            content |= {name: np.array(value) for name, value in more.items()}
            self.folder.put(self.file, lambda file: np.savez_compressed(file, **content))  # pyright: ignore[reportArgumentType]

    def worst(self, results: Results) -> tuple[Study, WorstChoice]:
        """Return the study of the worst choice and its row; both are stored."""
        if "worst" in self.stored:
            return self.study_of(self.stored["point"]), WorstChoice(
                *json.loads(str(self.stored["worst"]))
            )
        choice = late.choose_finalist(self.trials, self.settings.until, self.measure, self.machine)
        study = self.study_of(choice.point)
        found = self.verify(choice, study, results)
        self.save(worst=json.dumps(found), point=choice.point)
        return study, found

    def study_of(self, point: BoxPoint) -> Study:
        """Return the study of one choice."""
        return alone.choice_study(self.study, self.cell, self.box, point)

    def verify(self, choice: LateChoice, study: Study, results: Results) -> WorstChoice:
        """Return the choice's row of `worst.csv`.

        The row compares the choice with random lanes, the bound, further starts and the nonlinear engine.
        """
        starts, trials = self.settings.starts, self.trials
        (found,) = study.cells
        fresh = self.box.lanes(np.tile(choice.point, (FRESH, 1)), np.arange(starts, starts + FRESH))
        same = job(with_engine(found, "nonlinear").scenario, Keyed(self.study.seed), range(starts))
        outcomes = [batch.simulate(each, self.machine) for each in (fresh, same)]
        again, nonlinear = map(self.values, outcomes)
        allowed = self.allowed(outcomes[0].metrics) & ~np.isnan(again)
        given = found.scenario.attack.amplitude()
        amplitude = math.nan if is_drawn(given) else float(given)
        return WorstChoice(
            self.cell.number,
            choice.found,
            choice.late,
            choice.until,
            trials.best if np.isfinite(trials.best) else math.nan,
            amplitude,
            " ".join(map(str, found.scenario.attack.targets())),
            self.best_random(results),
            bound_of(found.scenario, self.settings.maximise) * amplitude,
            *start_statistics(again),
            float(allowed.mean()),
            float(nonlinear.mean()),
            trials.lanes,
            trials.failed + int(np.isnan(again).sum()),
        )

    def best_random(self, results: Results) -> float:
        """Return the greatest value of the cell's random lanes that are allowed, or their share unrecovered.

        The value is not-a-number if there is no such lane.
        """
        column = self.settings.maximise
        column = self.cell.scenario.judged if column == "unrecovered" else column
        columns = [column, *self.settings.subject_to]
        for _, found in results.by_cell(*columns, where=rows.OK, cells=[self.cell.number]):
            metrics = {name: found[name].to_numpy() for name in columns}
            values = self.objective(metrics)
            if self.settings.maximise == "unrecovered":
                return float(values.mean())
            allowed = values[np.broadcast_to(self.allowed(metrics), values.shape)]
            return float(allowed.max()) if allowed.size else math.nan
        return math.nan


def start_statistics(values: Float[np.ndarray, " lanes"]) -> tuple[float, float, float]:
    """Return mean, 5 % quantile and greatest of the finite values."""
    finite = values[~np.isnan(values)]
    if not finite.size:
        return math.nan, math.nan, math.nan
    return float(finite.mean()), float(np.quantile(finite, 0.05)), float(finite.max())


def bound_of(scenario: Scenario, metric: str) -> float:
    """Return the sharpest valid bound on a metric, per ā; not-a-number where none is known."""
    if metric not in REDUCTIONS or scenario_gain(scenario) is None:
        return math.nan
    of_vehicles = REDUCTIONS[metric]
    return min(
        float(of_vehicles(bound.vehicles)) for bound, _ in limits.valid_bounds(scenario).values()
    )


def worst_table(found: Sequence[WorstChoice], cells: Sequence[Cell]) -> pd.DataFrame:
    """Return a table with a row per cell, its swept values first."""
    labelled = ({"cell": each.cell, **cells[each.cell].labels, **each._asdict()} for each in found)
    return pd.DataFrame(labelled)


def search_each(
    results: Results, machine: Machine, progress: Steps, executor: Cluster | None = None
) -> Iterator[UPath]:
    """Search in each cell of a study whose folder contains random lanes, and yield the files one by one.

    With an executor, workers search the cells in parallel, each to its end, before this process writes the
    files.
    """
    folder, study = results.folder, results.study
    config = study.config
    assert config.search is not None
    if executor is not None:
        for done, _ in enumerate(search_distributed(results, machine, executor), 1):
            progress("cells searched", done, len(study.cells))
    found, generations = list[WorstChoice](), list[dict[str, Any]]()
    for cell in study.cells:
        search = CellSearch(config, cell, folder, machine)
        for generation in search.generations():
            words = f"{cell}: {config.search.maximise} {generation.best:.4g}"
            progress(words, generation.lanes, config.search.budget)
            generations.append({"cell": cell.number, **cell.labels, **generation._asdict()})
        words = f"{cell}: at a late time, and again from other starts"
        progress(words, config.search.budget, config.search.budget)
        choice, answer = search.worst(results)
        found.append(answer)
        yield alone.simulate_choice(choice, folder.inside(f"worst/{cell.number}"), machine)
        name = "worst.yaml" if len(study.cells) == 1 else f"worst/{cell.number}.yaml"
        yield folder.put(name, functools.partial(alone.write_config, choice, name))
        tables = {
            "search.csv": pd.DataFrame(generations),
            "worst.csv": worst_table(found, study.cells),
        }
        for name, table in tables.items():
            folder.put(name, functools.partial(write_table, table))
    yield from (results.path / name for name in ("search.csv", "worst.csv"))


def search_distributed(results: Results, machine: Machine, executor: Cluster) -> Iterator[int]:
    """Search the cells on an executor and yield each cell's number when its search ends."""
    config = results.study.config
    task = functools.partial(search_cell, results.folder.absolute(), machine.chunk)
    cells = {f"cell {cell.number}": cell.number for cell in results.study.cells}
    yield from executor.deal(task, config.scope, modules_of(config), cells)


def search_cell(folder: Folder, chunk: int | None, number: int) -> int:
    """Search in one cell to its end on a worker, store the result, and return the cell's number."""
    results, machine = Results(folder.path), Machine(1, chunk)
    cell = results.study.cells[number]
    search = CellSearch(results.study.config, cell, folder, machine)
    for _ in search.generations():
        pass
    search.worst(results)
    return number
