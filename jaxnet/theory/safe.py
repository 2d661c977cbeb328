"""Vehicles that no attack keeps off the navigator, and the attackers that end the proof (O11)."""

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from jaxnet.config.scenario import safe_in, safe_in_all
from jaxnet.model.safety import Safe, Vehicles
from jaxnet.theory.case import Case
from jaxnet.theory.robustness import MOST_NODES

MOST_TRIED = 3  # vehicles in a set


class SafeVehicles(NamedTuple):
    """Safe vehicles by reason, the strongest first; the weakest of all sets that are drawn."""

    reasons: list[Safe]
    drawn: bool  # whether several sets of attacked vehicles may be drawn
    tried: bool  # whether these sets were tried one by one, not all of them together

    def by_majority(self) -> Bool[np.ndarray, " m"]:
        """Vehicles that are safe only where attacked links announce what they carry."""
        found = np.zeros(len(self.reasons[0].vehicles), bool)
        for each in sorted(self.reasons, key=lambda each: not each.consistent):
            found = found | each.vehicles if each.consistent else found & ~each.vehicles
        return found


def safe_vehicles(case: Case) -> SafeVehicles:
    graph, attacked, *_ = case.situation
    sets = [attacked] if case.draws is None else case.draws
    reasons = safe_in_all(case.scenario, graph, sets)
    return SafeVehicles(reasons, len(sets) > 1, case.draws is not None)


class Margin(NamedTuple):
    """Attacked sets, of at most three vehicles, that break the safety of each vehicle."""

    sets: list[list[tuple[int, ...]]]  # of each unsafe vehicle, the minimal sets that break it
    further: Int[np.ndarray, " m"]  # least number of further attackers that break it; 0 if unsafe


def proof_ends(case: Case) -> Margin | None:
    """Attackers that leave no proof; None for large fleets, and where sets are too many to try."""
    scenario, graph = case.scenario, case.situation.graph
    few = case.seconds > 0 and graph.vehicles <= MOST_NODES and case.draws is not None
    if not few or not scenario.attack.present:
        return None

    def safe(attacked: list[int]) -> Vehicles:
        reasons = safe_in(scenario, graph, scenario.attack.on(attacked).attacked_links(graph))
        return np.any([each.vehicles for each in reasons], axis=0)

    everyone = range(1, graph.vehicles + 1)
    return margin(safe, scenario.attack.targets() or everyone, graph.vehicles)


def margin(safe: Callable[[list[int]], Vehicles], attacked: Sequence[int], vehicles: int) -> Margin:
    """Margin by brute force; `safe(attacked)` is monotone: more attacked, fewer safe vehicles."""
    sets: list[list[tuple[int, ...]]] = [[] for _ in range(vehicles)]
    further = np.where(safe([*attacked]), MOST_TRIED + 1, 0)
    for few in small_sets(attacked, 0):
        for i in np.flatnonzero(~safe([*few]) & (further == 0)):
            if not any(set(each) <= set(few) for each in sets[i]):
                sets[i].append(few)
    for more in small_sets([i for i in range(1, vehicles + 1) if i not in attacked], 1):
        if (further <= len(more)).all():
            break
        broken = ~safe([*attacked, *more])
        further = np.where(broken, np.minimum(further, len(more)), further)
    return Margin(sets, further)


def small_sets(vehicles: Sequence[int], least: int) -> list[tuple[int, ...]]:
    """Subsets of some vehicles with `least` to three members, smaller subsets first."""
    return [each for size in range(least, MOST_TRIED + 1) for each in combinations(vehicles, size)]
