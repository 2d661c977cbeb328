"""Attackers that W-MSR tolerates on a network, by the robustness of the vehicles alone."""

from functools import lru_cache
from time import monotonic
from typing import NamedTuple

import numpy as np

from jaxnet.kinds.kind import vehicle_numbers
from jaxnet.model.graph import dense
from jaxnet.theory import integer, robustness
from jaxnet.theory.case import Case
from jaxnet.theory.integer import RobustnessBracket


class VehiclesAlone(NamedTuple):
    """Robustness of the vehicles without the navigator, and the greatest F of F-total attackers."""

    pairs: list[int] | None  # the greatest s for r = 1, 2, …; None for large fleets
    r: RobustnessBracket
    total: RobustnessBracket

    @property
    def local(self) -> RobustnessBracket:
        """Bounds on the greatest F of F-local attackers."""
        return RobustnessBracket(*map(robustness.most_local, self.r))


def alone(case: Case) -> VehiclesAlone | None:
    graph = case.situation.graph
    if case.seconds <= 0 or graph.vehicles > integer.MOST_PROGRAMMED:
        return None
    heard = dense(graph)[:, 1:] > 0
    if graph.vehicles > robustness.MOST_NODES:
        return VehiclesAlone(None, *brackets(len(heard), heard.tobytes(), case.seconds))
    found = robustness.robustness(heard)
    r, total = len(found), robustness.most_total(found)
    return VehiclesAlone(found, RobustnessBracket(r, r), RobustnessBracket(total, total))


@lru_cache(maxsize=20)  # the cells of several attacks share one graph
def brackets(n: int, heard: bytes, seconds: float) -> tuple[RobustnessBracket, RobustnessBracket]:
    """Bounds on the greatest r, and on the greatest F of F-total attackers."""
    matrix, end = np.frombuffer(heard, bool).reshape(n, n), monotonic() + seconds
    known = integer.robustness_bracket(matrix, seconds)
    return known, integer.total_bracket(matrix, known, end - monotonic())


class Led(NamedTuple):
    """Robustness with respect to vehicles that somebody trusts."""

    leaders: list[int]  # and 0, the navigator, whom all trust
    strongly: int  # the greatest r
    reached: list[int]  # by percolation with F = 1, besides the leaders


def led(case: Case) -> Led | None:
    graph, _, trusted, _ = case.situation
    leaders = np.isin(np.arange(graph.vehicles + 1), graph.sources[trusted])
    if not leaders[1:].any() or leaders[1:].all():
        return None
    reached = robustness.percolated(graph, trusted, leaders)[1:] & ~leaders[1:]
    strongly = robustness.leader_robustness(graph, leaders)
    return Led(np.flatnonzero(leaders).tolist(), strongly, vehicle_numbers(reached))
