"""Problems whose answer is known, as batches of lanes that the engines can run."""

from typing import Any, NamedTuple

import jax
import numpy as np
import pandas as pd
from upath import UPath

import jaxnet
from jaxnet.config.study import Study
from jaxnet.engine import batch
from jaxnet.engine.batch import Job
from jaxnet.engine.metrics import SERIES
from jaxnet.engine.plan import Outcome
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.store.results import Results

FEW = batch.Machine(devices=1, chunk=4)
# Saved wherever something is, for each choice is a program to be compiled; inputs take a tenth of
# it.
EVERYTHING = tuple(name for name in SERIES if name != "inputs")

# What many studies of tests have in common: nobody lies or judges; agents without a navigator.
QUIET = {"attack": "none", "defence": "none"}
AGENTS = {"vehicle": "single_integrator", "navigator": "none", "law": "local"}


def clock(tick: float, horizon: float, tail: float = 0.0) -> dict[str, float]:
    """Keys of a study whose output times are its ticks [s]."""
    return {"tick": tick, "output_step": tick, "horizon": horizon, "tail": tail}


def study(**keys: Any) -> Study:
    """A study of these keys, the defaults elsewhere."""
    return jaxnet.load({"name": "test", **keys})


def results_of(given: Study, rows: pd.DataFrame) -> Results:
    """Results whose rows are these, which are in no folder."""
    made = Results(UPath("nowhere"))

    def by_cell(*columns: str, where: Any = None, cells: Any = None) -> Any:
        wanted = rows if where is None else rows[rows["status"] == "ok"]
        return (
            (number, lanes)
            for number, lanes in wanted.groupby("cell")
            if cells is None or number in cells
        )

    vars(made).update(
        study=given, by_cell=by_cell, manifest={"samples": int(rows["sample"].max()) + 1}
    )
    return made


class Lanes(NamedTuple):
    """Lanes of several cells, cell by cell."""

    jobs: list[Job]

    @property
    def size(self) -> int:
        """How many."""
        return sum(job.size for job in self.jobs)


def lanes(given: Study, samples: int, save: tuple[str, ...] = EVERYTHING) -> Any:
    """Lanes of all cells of a study: one job where there is one cell."""
    jobs = [
        job(cell.scenario, Keyed(given.config.seed), range(samples), save) for cell in given.cells
    ]
    return jobs[0] if len(jobs) == 1 else Lanes(jobs)


def simulate(one: Any) -> Outcome:
    """Outcomes of lanes; whom they retain is told by listener and source, (times, m, m + 1)."""
    outcomes = [by_source(each, simulated(each)) for each in getattr(one, "jobs", [one])]
    return jax.tree.map(lambda *parts: np.concatenate(parts), *outcomes)


def outcome(samples: int, save: tuple[str, ...] = EVERYTHING, /, **keys: Any) -> Outcome:
    """Outcomes of lanes of all cells of a study of these keys."""
    return simulate(lanes(study(**keys), samples, save))


def by_source(job: Job, outcome: Outcome) -> Outcome:
    """The same with `kept` by listener and source, if it was saved."""
    if "kept" not in outcome.series:
        return outcome
    kept = of_slots(outcome.series["kept"], np.asarray(job.network.hearing.sources))
    return outcome._replace(series=outcome.series | {"kept": kept})


def of_slots(kept: np.ndarray, sources: np.ndarray) -> np.ndarray:
    """Weights by listener and source, (…, m, m + 1), of those by slot."""
    found = np.zeros((*kept.shape[:-2], sources.shape[1], sources.shape[1] + 1))
    for slot, listener in np.ndindex(*sources.shape):
        found[..., listener, sources[slot, listener]] += kept[..., slot, listener]
    return found


def simulated(job: Job) -> Outcome:
    """Outcome of a job; up to 24 lanes run four side by side, for most of a wide chunk would be
    filling.
    """
    return batch.simulate(job) if job.size > 24 else batch.simulate(job, FEW)


class OneLane(NamedTuple):
    """A lane by itself, its graph and attacked links as matrices over (listener, source)."""

    lane: Any
    weights: Any
    links: Any

    def __getattr__(self, name: str) -> Any:
        """What the lane holds."""
        return getattr(self.lane, name)


def lane(one: Any, number: int) -> OneLane:
    """One lane, by itself."""
    for each in getattr(one, "jobs", [one]):
        if number < each.size:
            break
        number -= each.size
    lane = jax.tree.map(lambda leaf: np.asarray(leaf[number]), each.inputs.lane)
    sources, _, attacked, *_ = each.network.hearing
    m = sources.shape[1]
    weights, links = np.zeros((m, m + 1)), np.zeros((m, m + 1), bool)
    for slot, weight, added in zip(sources, lane.weights, attacked, strict=True):
        weights[np.arange(m), slot] += weight
        links[np.arange(m), slot] |= added
    return OneLane(lane, weights, links)
