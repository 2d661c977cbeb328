"""A study's search in its folder: generations, the worst choice in each cell, its verification.

`search/CELL.npz` stores the values of all choices, so that an interrupted search resumes.
`search.csv` has a row per generation and `worst.csv` a row per cell. `worst.yaml` is a study of the
worst choice.
"""

import functools
import hashlib
import io
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Array, Bool, Float
from upath import UPath

from jaxnet.config.cells import Cell, to_plain
from jaxnet.config.keys import Config, SearchSettings
from jaxnet.config.study import Study, load
from jaxnet.engine import batch
from jaxnet.engine.batch import Machine
from jaxnet.engine.plan import Outcome
from jaxnet.explore.box import VEHICLES, Box, places_of
from jaxnet.explore.cells import AnalysisRow
from jaxnet.explore.search import (
    SEARCH_VERSION,
    BoxPoint,
    Generation,
    LateChoice,
    Trials,
    search_box,
)
from jaxnet.kinds.fields import is_drawn
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.runs.cluster import Cluster
from jaxnet.runs.replay import with_engine
from jaxnet.runs.run import Run
from jaxnet.statistics import limits, recovery
from jaxnet.statistics.steps import Steps
from jaxnet.store import gate, rows
from jaxnet.store.folder import OURS, Folder, FolderError, config_text
from jaxnet.store.manifest import digest
from jaxnet.store.results import Results
from jaxnet.store.tables import csv_text
from jaxnet.theory.spread import scenario_gain

CHECKPOINT = 10.0  # [s] between checkpoints, at least
WRITING = 0.05  # share of the time for checkpoints, at most
FRESH = 10_000  # further starts to verify the worst choice
REDUCTIONS = {"tail_max": np.max, "tail_mean": np.mean}  # from vehicles' bounds to a metric's bound


Objectives = Float[np.ndarray, " lanes"]
Metrics = Mapping[str, Float[Array | np.ndarray, " lanes"]]
Step = Callable[[int, int], None]  # arguments: simulations of the worst done, and in all


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
    nonlinear: float  # mean over the starts, by the nonlinear engine if it moves the vehicles
    lanes: int
    failed: int
    bound_name: str = ""  # of `bound`


class CellSearch:
    def __init__(self, study: Config, cell: Cell, folder: Folder, machine: Machine):
        assert study.search is not None
        self.study, self.cell, self.folder, self.machine = study, cell, folder, machine
        self.settings: SearchSettings = study.search
        source, over = Keyed(study.seed), self.settings.over
        drawn = [place for place in places_of(cell.scenario, source) if place.name in over]
        if missing := [key for key in over if key not in {place.name for place in drawn}]:
            raise FolderError(f"{cell} does not draw {missing[0]}, so there is nothing to choose")
        self.box = Box(cell.scenario, source, drawn)
        self.stored, known = self.load(), list[np.ndarray]()
        if self.stored:
            known = np.split(self.stored["values"], np.cumsum(self.stored["sizes"])[:-1])
        starts, part = self.settings.starts, self.settings.may_exceed
        self.trials = Trials(self.box, starts, self.measure, machine, known, part)

    def measure(self, outcome: Outcome) -> Objectives:
        """Objective of each lane: not-a-number if it failed, minus infinity if not allowed."""
        values = self.values(outcome)
        return np.where(self.allowed(outcome.metrics) | np.isnan(values), values, -math.inf)

    def values(self, outcome: Outcome) -> Objectives:
        """Objective of each lane, allowed or not; not-a-number where the lane failed."""
        return np.where(outcome.status == 0, self.objective(outcome.metrics), math.nan)

    def allowed(self, metrics: Metrics) -> Bool[np.ndarray, "..."]:
        """Whether lanes with these metrics fulfil `subject_to`; a blank metric does not."""
        fulfilled = np.asarray(True)
        for name, most in self.settings.subject_to.items():
            fulfilled = fulfilled & (np.asarray(metrics[name]) <= most)
        return fulfilled

    def objective(self, metrics: Metrics) -> Objectives:
        if self.settings.maximise != "unrecovered":
            return np.asarray(metrics[self.settings.maximise])
        over = recovery.threshold(self.cell, self.study.recovery)
        return (np.asarray(metrics[self.cell.scenario.judged]) > over).astype(float)

    def generations(self) -> Iterator[Generation]:
        """Yield all generations, stored ones included; save values at checkpoints and the end."""
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
        return f"search/{self.cell.number}.npz"

    def stamp(self) -> str:
        counted = self.settings.maximise == "unrecovered"
        told = [SEARCH_VERSION, digest(self.study), to_plain(self.settings), self.cell.number]
        told += [to_plain(self.study.recovery)] if counted and self.study.recovery else []
        return hashlib.sha256(json.dumps(told).encode()).hexdigest()

    def load(self) -> dict[str, np.ndarray]:
        """Stored values of a search with the same stamp; empty if there is none."""
        path = self.folder.path / self.file
        if not path.exists():
            return {}
        with (
            gate.reading(path, "cannot be read: remove it to search anew"),
            np.load(io.BytesIO(gate.read_whole(path)), allow_pickle=False) as stored,
        ):
            return dict(stored) if str(stored["stamp"]) == self.stamp() else {}

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

    def worst(self, results: Results, step: Step) -> tuple[Study, WorstChoice]:
        """Study of the worst choice and its row; both are stored."""
        if "worst" in self.stored:
            found = WorstChoice(*json.loads(str(self.stored["worst"])))
            return self.study_of(self.stored["point"]), found
        step(0, 3)
        choice = self.trials.choose_finalist(self.settings.until)
        study = self.study_of(choice.point)
        found = self.verify(choice, study, results, step)
        self.save(worst=json.dumps(found), point=choice.point)
        return study, found

    def study_of(self, point: BoxPoint) -> Study:
        """Study of one choice: its config has the point's numbers, its samples are the starts."""
        attacked = self.box.attacked(point)
        keys: dict[str, Any] = to_plain(self.cell.scenario) | {
            "name": f"{self.study.name}-worst-{self.cell.number}",
            "seed": self.study.seed,
            "samples": self.settings.starts,
            "recovery": to_plain(self.study)["recovery"],
        }
        numbers: dict[str, dict[int, list[float]]] = {}  # by key and vehicle
        for place, column in self.box.columns.items():
            if place.name != VEHICLES:
                of_key = numbers.setdefault(place.name, {})
                of_key.setdefault(place.vehicle, []).append(self.box.number(place, point[column]))
        overrides: dict[str, Any] = {VEHICLES: attacked} if self.box.lots else {}
        for name, each in numbers.items():
            if 0 in each:
                overrides[name] = each[0] if name == "gain" else each[0][0]
            else:
                chosen = (each[vehicle] for vehicle in attacked)
                overrides[name] = [own[0] if len(own) == 1 else own for own in chosen]
        with self.study.scope():
            return load(keys, overrides)

    def verify(self, choice: LateChoice, study: Study, results: Results, step: Step) -> WorstChoice:
        """The choice beside random lanes, the bound, further starts and the nonlinear engine."""
        starts, trials = self.settings.starts, self.trials
        (found,) = study.cells
        fresh = self.box.lanes(np.tile(choice.point, (FRESH, 1)), np.arange(starts, starts + FRESH))
        same = job(with_engine(found, "nonlinear").scenario, Keyed(self.study.seed), range(starts))
        outcomes = []
        for each in (fresh, same):
            step(1 + len(outcomes), 3)
            outcomes.append(batch.simulate(each, self.machine))
        again, nonlinear = map(self.values, outcomes)
        allowed = self.allowed(outcomes[0].metrics) & ~np.isnan(again)
        given, finite = found.scenario.attack.amplitude(), again[~np.isnan(again)]
        amplitude, nothing = math.nan if is_drawn(given) else float(given), not finite.size
        bound, which, metric = math.nan, "", self.settings.maximise  # the least that holds, per ā
        if metric in REDUCTIONS and scenario_gain(found.scenario) is not None:
            known = limits.valid_bounds(found.scenario).items()
            reduced = {name: REDUCTIONS[metric](each.vehicles) for name, (each, _) in known}
            which = min(reduced, key=lambda name: reduced[name])
            bound = float(reduced[which])
        return WorstChoice(
            cell=self.cell.number,
            found=choice.found,
            late=choice.late,
            until=choice.until,
            greatest=trials.best if np.isfinite(trials.best) else math.nan,
            magnitude=amplitude,
            attacked=" ".join(map(str, found.scenario.attack.targets())),
            random=self.best_random(results),
            bound=bound * amplitude,
            fresh=math.nan if nothing else float(finite.mean()),
            fresh_low=math.nan if nothing else float(np.quantile(finite, 0.05)),
            fresh_high=math.nan if nothing else float(finite.max()),
            fresh_allowed=float(allowed.mean()),
            nonlinear=float(nonlinear.mean()),
            lanes=trials.lanes,
            failed=trials.failed + int(np.isnan(again).sum()),
            bound_name=which,
        )

    def best_random(self, results: Results) -> float:
        """Greatest value, or share unrecovered, of the cell's allowed random lanes; NaN if none."""
        column, counted = self.settings.maximise, self.settings.maximise == "unrecovered"
        columns = [self.cell.scenario.judged if counted else column, *self.settings.subject_to]
        for _, found in results.by_cell(*columns, where=rows.OK, cells=[self.cell.number]):
            metrics = {name: found[name].to_numpy() for name in columns}
            values = self.objective(metrics)
            allowed = values[np.broadcast_to(counted or self.allowed(metrics), values.shape)]
            greatest = allowed.mean() if counted else allowed.max(initial=-math.inf)
            return float(greatest) if allowed.size else math.nan
        return math.nan


def search_each(
    results: Results, machine: Machine, progress: Steps, executor: Cluster | None = None
) -> Iterator[UPath]:
    """Search in each cell of a study whose folder has random lanes; yield the files one by one.

    With an executor, workers search the cells in parallel, each to its end, before this process
    writes the files.
    """
    folder, study = results.folder, results.study
    config = study.config
    assert config.search is not None
    if executor is not None:
        task = functools.partial(
            search_cell, Folder(folder.path.absolute(), folder.holds), machine.chunk
        )
        cells = {f"cell {cell.number}": cell.number for cell in study.cells}
        ended = executor.deal(task, config, cells)
        for done, _ in enumerate(ended, 1):
            progress("cells searched", done, len(study.cells))
    found, generations = list[AnalysisRow](), list[AnalysisRow]()
    for cell in study.cells:
        search, labels = CellSearch(config, cell, folder, machine), {"cell": cell.number}
        labels |= cell.labels
        for generation in search.generations():
            words = f"cell {cell.number}: {config.search.maximise} {generation.best:.4g}"
            progress(words, generation.lanes, config.search.budget)
            generations.append({**labels, **generation._asdict()})
        words = f"cell {cell.number}: at a late time, from other starts, with the nonlinear engine"
        choice, answer = search.worst(results, functools.partial(progress, words))
        found.append({**labels, **answer._asdict()})
        yield simulate_choice(
            choice, Folder(folder.path / f"worst/{cell.number}", folder.holds), machine
        )
        name = "worst.yaml" if len(study.cells) == 1 else f"worst/{cell.number}.yaml"
        text = config_text(choice.config, name).encode()
        yield folder.put(name, text)
        for name, rows_of in {"search.csv": generations, "worst.csv": found}.items():
            folder.put(name, csv_text(pd.DataFrame(rows_of)).encode())
    yield from (results.path / name for name in ("search.csv", "worst.csv"))


def simulate_choice(study: Study, folder: Folder, machine: Machine) -> UPath:
    """Simulate a choice with the trajectory of its first lane, in place of another choice."""
    saved = load(study, {"save.trajectories": {"samples": [0]}})
    with folder.writing():
        if folder.manifest.get("hash") != digest(saved.config):
            folder.remove(*OURS)
        Run(saved.config, saved.cells, folder, lambda tally: None, machine).whole()
    return folder.path


def search_cell(folder: Folder, chunk: int | None, number: int) -> int:
    results, machine = Results(folder.path), Machine(1, chunk)
    cell = results.study.cells[number]
    search = CellSearch(results.study.config, cell, folder, machine)
    for _ in search.generations():
        pass
    search.worst(results, lambda done, total: None)
    return number
