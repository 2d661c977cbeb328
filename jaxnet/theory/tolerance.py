"""Attackers that W-MSR tolerates on a network, by the robustness of the vehicles alone (O9)."""

from functools import lru_cache
from time import monotonic
from typing import NamedTuple

import numpy as np

from jaxnet.config.scenario import EVERY_MESSAGE, broken_premise, greatest_strength
from jaxnet.kinds.fields import value_range
from jaxnet.model.graph import Digraph, Links, dense
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
    unasked = case.seconds <= 0 or case.scenario.defence.tolerates() is None
    if unasked or graph.vehicles > integer.MOST_PROGRAMMED:
        return None
    heard = dense(graph)[:, 1:] > 0
    if graph.vehicles > robustness.MOST_NODES:
        return VehiclesAlone(None, *brackets(len(heard), heard.tobytes(), case.seconds))
    found = robustness.robustness(heard)
    r, total = len(found), robustness.most_total(found)
    return VehiclesAlone(found, RobustnessBracket(r, r), RobustnessBracket(total, total))


def is_borne(graph: Digraph, attacked: Links, liars: int, F: int) -> bool | None:
    """Whether W-MSR bears these liars on a graph, by its robustness (O9); None for large fleets."""
    if graph.vehicles > robustness.MOST_NODES:
        return None
    each = int(np.minimum(attacked.sum(axis=1), liars).max(initial=0))
    found = robustness.robustness(dense(graph)[:, 1:] > 0)
    in_all = liars <= F <= robustness.most_total(found)
    return in_all or each <= F <= robustness.most_local(len(found))


class Agreement(NamedTuple):
    """Whether honest vehicles agree inside the range of their starts under W-MSR, and why."""

    proved: bool
    why: str


OF_AGREEMENT = (*EVERY_MESSAGE, "same links", "alike", "one gain", "one identity", "flat")
OF_AGREEMENT += ("continuous", "drops")


def agreement(case: Case) -> Agreement | None:
    """Ask LeBlanc et al., IEEE JSAC 31(4), 2013, of vehicles without a navigator; else None."""
    scenario, F = case.scenario, case.scenario.defence.tolerates()
    if F is None or scenario.navigator.present:
        return None
    if why := broken_step(case) or broken_premise(scenario, OF_AGREEMENT):
        return Agreement(False, why)
    attack, links = scenario.attack, case.situation.attacked
    total = attack.number()
    each = int(np.minimum(links.sum(axis=1), total).max())
    drawn = ", whichever are drawn" if total and not attack.targets() else ""
    liars = f"{total} attacked{drawn}, at most {each} of them heard by one vehicle, and F = {F}"
    robust = alone(case)
    if robust is None:
        return Agreement(False, f"{liars}: the robustness of the vehicles was not examined")
    if total <= F <= robust.total.low:
        return Agreement(True, f"{liars}; the vehicles are ({F + 1}, {F + 1})-robust")
    if each <= F <= robust.local.low:
        return Agreement(True, f"{liars}; the vehicles are {2 * F + 1}-robust")
    if min(total, each) > F:
        return Agreement(False, f"{liars}: too many are attacked")
    needed = [f"({F + 1}, {F + 1})-robust"] * (total <= F) + [f"{2 * F + 1}-robust"] * (each <= F)
    sure = robust.total.known and robust.local.known
    told = f"are not known to be {' or '.join(needed)}"
    if sure:
        told = f"are {'neither' if len(needed) > 1 else 'not'} {' nor '.join(needed)}"
    return Agreement(False, f"{liars}: the vehicles {told}")


def broken_step(case: Case) -> str:
    """What keeps a tick from being a step of W-MSR, `x ← W x` with positive weights; "" if it is.

    At a tick a vehicle moves by h k0 of the way to the mean, times the strength of its row.
    """
    scenario = case.scenario
    law, defence, order = scenario.law, scenario.defence, scenario.vehicle.order
    if law.couples() or not law.holds:
        return "the law is not local with hold: true"
    if order != 1:
        return f"the order of the vehicles is {order}, not 1"
    step = scenario.tick * value_range(scenario.gain[0])[1] if scenario.gain_matrices is None else 0
    if not step * greatest_strength(scenario) < 1:
        return "tick times gain, times the strength of a row of weights, is not below 1"
    if case.situation.trusted.any() or defence.draws():
        return "the defence trusts vehicles, or has noise"
    if scenario.attack.present and scenario.attack.by_link():
        return "an attacked vehicle does not send all listeners the same"
    return ""


@lru_cache(maxsize=20)  # the cells of several attacks share one graph
def brackets(n: int, heard: bytes, seconds: float) -> tuple[RobustnessBracket, RobustnessBracket]:
    """Bounds on the greatest r, and on the greatest F of F-total attackers."""
    matrix, end = np.frombuffer(heard, bool).reshape(n, n), monotonic() + seconds
    known = integer.robustness_bracket(matrix, seconds)
    return known, integer.total_bracket(matrix, known, end - monotonic())
