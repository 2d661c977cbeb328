"""What a study asks for, beside what theory says that starts and errors alone leave."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxnet.config.cells import Cell, judged_metric
from jaxnet.config.keys import Config, Scenario
from jaxnet.config.scenario import broken_premise, for_any_signal, missing
from jaxnet.model.wording import Named, cells_named
from jaxnet.statistics.curves import cell_magnitudes
from jaxnet.statistics.recovery import threshold
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results
from jaxnet.theory.alarms import tested
from jaxnet.theory.case import Case
from jaxnet.theory.run_lengths import mean_run
from jaxnet.theory.start import Start, start_sizes
from jaxnet.theory.theorems import OF_ALARMS, START, errors_leave

LOST = 1000  # times ā and the farthest start
LEAST_LEFT = 1e-3  # of a start, where a study asks for no length


class Ending(NamedTuple):
    """A length that a study asks for, and the times of a cell."""

    length: float  # [m]
    after: float  # [s] from when a start is below it
    begins: float  # [s], of the tail
    horizon: float  # [s] that would do


@for_any_signal
def decay_of(scenario: Scenario) -> Start | str:
    """How starts die away, or why it is not known."""
    if why := broken_premise(scenario, START.needs):
        return why
    found = START.value(Case(scenario))
    return "gains are drawn or apart, or a start has no bound" if found is None else found


def ending(cell: Cell, study: Config) -> Ending | str:
    """When a start of the cell has died away, or why it is not known."""
    scenario, found = cell.scenario, decay_of(cell.scenario)
    if isinstance(found, str):
        return found
    length = asked_length(cell, study, found.distance)
    after, step = found.after(length), scenario.output_step
    least = after + scenario.tail
    horizon = step * np.ceil(round(least / step, 9)) if np.isfinite(least) else least
    return Ending(length, after, scenario.horizon - scenario.tail, float(horizon))


@for_any_signal
def left_by_errors(scenario: Scenario) -> float:
    return errors_leave(Case(scenario))


def errors_words(study: Config, cells: Sequence[Cell], named: Named = cells_named) -> str:
    """Where errors of sensors and messages alone leave more than recovery allows; else "".

    Nothing is told of cells whose kinds have no code here.
    """

    def excess(cell: Cell) -> float:
        left = left_by_errors(cell.scenario)
        return left if left > threshold(cell, study.recovery) else 0.0

    asked = cells if study.recovery is not None else ()
    found = {cell.number: known_or(0.0, lambda cell=cell: excess(cell)) for cell in asked}
    above = {number: left for number, left in found.items() if left}
    if not above:
        return ""
    ends = " to ".join(sorted({f"{end(above.values()):.3g}" for end in (min, max)}, key=float))
    words = f"errors of sensors and messages alone leave an expected mean error of {ends} m"
    return f"{words}, which recovery does not allow, in {named([*above])}"


@for_any_signal
def cut_falsely(scenario: Scenario) -> bool:
    """Whether a false alarm has cut an honest link for good before the end, more likely than not.

    The first alarm comes by a geometric law, with the known mean (its upper end, if two are known).
    """
    detector = scenario.detector
    if not detector.cuts_links or detector.return_after or missing(scenario, OF_ALARMS):
        return False
    rule, orders = tested(Case(scenario))
    run = rule and mean_run(rule, orders)
    return bool(run) and (1 - 1 / run.most) ** (1 + scenario.horizon / scenario.tick) < 0.5


def cuts_words(cells: Sequence[Cell], named: Named = cells_named) -> str:
    """Where false alarms cut most honest links before the end; else ""."""
    found = [c.number for c in cells if known_or(False, partial(cut_falsely, c.scenario))]
    words = "false alarms will cut most honest links before the run ends, in"
    return f"{words} {named(found)}" if found else ""


def lost_limits(results: Results) -> Float[np.ndarray, " cells"]:
    """Errors [m] above which a fleet is lost, by cell: far above ā and every start."""
    cells = results.study.cells
    sizes = known_or(np.zeros(len(cells)), lambda: cell_magnitudes(results))
    starts = [known_or(np.inf, lambda cell=cell: start_sizes(cell.scenario)[0]) for cell in cells]
    return LOST * (np.nan_to_num(sizes) + starts)


def lost_cells(results: Results, column: str) -> list[int]:
    """Cells whose fleet is lost, by a column of errors [m]."""
    return np.flatnonzero(results.cells[column].to_numpy() > lost_limits(results)).tolist()


def lost_words(results: Results, cells: Sequence[Cell], named: Named = cells_named) -> str:
    """Where the fleet is lost, of these cells; else ""."""
    lost = lost_cells(results, f"{judged_metric(results.study.cells)}_median")
    found = [cell.number for cell in cells if cell.number in lost]
    words = (
        f"the fleet is lost (median error over {LOST:,} times the sum of ā and the farthest start)"
    )
    return f"{words} in {named(found)}" if found else ""


def asked_length(cell: Cell, study: Config, distance: float) -> float:
    """The least length [m] of recovery and settling times; else a thousandth of the start."""
    lengths = [threshold(cell, study.recovery)]
    for metric in study.metrics:
        if metric.base == "settling_time":
            asked: Any = metric.of
            lengths.append(asked.below or asked.share * distance)
    known = [length for length in lengths if length == length]
    return min(known, default=LEAST_LEFT * distance)
