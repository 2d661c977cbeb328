"""Choice among a search's finalists: each is simulated to a late time, and the worst at that time wins.

A search compares choices at the horizon, where much of an error may be transient. The error at a late time
distinguishes a transient from a persistent error.
"""

import math
from typing import NamedTuple

import numpy as np

from jaxnet.config.keys import Scenario
from jaxnet.config.scenario import outputs_of
from jaxnet.config.spacings import multiples
from jaxnet.engine import batch
from jaxnet.engine.batch import Machine
from jaxnet.explore.box import Box
from jaxnet.explore.search import POPULATIONS, BoxPoint, Finalist, Means, Measure, Trials

MOST_LATE_LANES = 256  # of all finalists together, unless fewer finalists than POPULATIONS remain
TIE_TOLERANCE = 1e-6  # of the error at the horizon; late errors that differ by less are equal


class LateChoice(NamedTuple):
    """The finalist that a search returns."""

    point: BoxPoint
    found: float  # mean over the starts, at the horizon
    late: float  # mean over the starts, at `until`; not-a-number if a lane fails before or is not allowed
    until: float  # [s]


def late_time(scenario: Scenario, until: float) -> float:
    """Return the first output time [s] at or after both `until` and the horizon."""
    outputs = math.ceil(round(until / scenario.output_step, 6))
    late = multiples(scenario.output_step, [outputs])[0]
    return scenario.horizon if outputs <= outputs_of(scenario) else late


def choose_finalist(trials: Trials, until: float, measure: Measure, machine: Machine) -> LateChoice:
    """Return the finalist with the greatest error at the late time.

    Ties go to the greatest error at the horizon.
    """
    scenario = trials.box.scenario
    time = late_time(scenario, until)
    leader = Finalist(trials.best if np.isfinite(trials.best) else math.nan, trials.point)
    if time == scenario.horizon:
        return LateChoice(leader.point, leader.found, leader.found, time)
    finalists = [leader, *late_finalists(trials)]
    late = late_means(time, np.stack([each.point for each in finalists]), trials, measure, machine)
    late = np.where(np.isfinite(late), late, math.nan)
    if np.isnan(late).all():
        return LateChoice(leader.point, leader.found, math.nan, time)
    lasting = np.flatnonzero(
        late >= np.nanmax(late) - TIE_TOLERANCE * np.nan_to_num(abs(leader.found))
    )
    number = max(lasting, key=lambda number: finalists[number].found)
    return LateChoice(finalists[number].point, finalists[number].found, float(late[number]), time)


def late_finalists(trials: Trials) -> list[Finalist]:
    """Return the finalists that are simulated to the late time, the worst at the horizon first."""
    finite = [each for each in trials.finalists if np.isfinite(each.found)]
    most = max(POPULATIONS, MOST_LATE_LANES // trials.starts)
    return sorted(finite, key=lambda each: -each.found)[:most]


def late_means(
    time: float, points: np.ndarray, trials: Trials, measure: Measure, machine: Machine
) -> Means:
    """Return the mean over the starts at each point, for lanes that last until a time [s]."""
    box = Box(
        trials.box.scenario.model_copy(update={"horizon": time}),
        trials.box.source,
        trials.box.places,
    )
    samples = np.tile(np.arange(trials.starts), len(points))
    outcome = batch.simulate(box.lanes(points.repeat(trials.starts, axis=0), samples), machine)
    return measure(outcome).reshape(len(points), trials.starts).mean(axis=1)
