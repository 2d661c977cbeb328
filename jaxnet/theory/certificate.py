"""Certificate of a network: whom the navigator reaches, the paper's Assumption 1, what breaks
safety.
"""

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from jaxnet.config.scenario import MOST_INVERTED
from jaxnet.kinds.kind import vehicle_numbers
from jaxnet.model import graph, safety
from jaxnet.model.graph import Digraph, Links
from jaxnet.model.safety import Vehicles
from jaxnet.theory.theorem import Case, Theorem

MOST_TRIED = 3  # vehicles in a set


class Certificate(NamedTuple):
    """Facts about one network; lists contain vehicle numbers, from 1."""

    heard: Int[np.ndarray, " m"]  # |N_i|, sources that each vehicle hears
    unreachable: list[int]
    inverse_norm: float | None  # ‖L⁻¹‖₂, infinite if L is singular; None for large fleets
    attacked_links: list[tuple[int, int]]  # (i, j): i receives corrupted signals from j
    all_attacked: list[int]  # vehicles whose links are all attacked
    cut_off: list[int]  # vehicles without an honest path from the navigator


def certify(network: Digraph, attacked: Links) -> Certificate:
    honest = network.heard & ~attacked
    lost = graph.unreachable(network)
    norm = np.inf if lost else None
    if not lost and network.vehicles <= MOST_INVERTED:
        norm = graph.inverse_norm(network)
    links = [(int(i) + 1, int(network.sources[i, slot])) for i, slot in np.argwhere(attacked)]
    return Certificate(
        heard=network.heard.sum(axis=1),
        unreachable=lost,
        inverse_norm=norm,
        attacked_links=links,
        all_attacked=vehicle_numbers(np.asarray(~honest.any(axis=1))),
        cut_off=graph.unreachable(network.only(honest)),
    )


class HonestPaths(NamedTuple):
    """Vehicles without an honest path from the navigator, or without an honest source."""

    cut_off: list[int] | None  # in some lane; None for too many drawn sets
    perhaps: list[int]  # if all that may be drawn are attacked at once
    all_attacked: list[int]


def honest_paths(case: Case) -> HonestPaths:
    """Whom attacks part from the navigator in some lane (the paper's Assumption 1)."""
    network, attacked, *_ = case.situation
    facts = certify(network, attacked)
    lost = [] if not facts.cut_off else None
    if facts.cut_off and case.draws is not None:
        each = (graph.unreachable(network.only(network.heard & ~links)) for links in case.draws)
        lost = sorted(set().union(*each))
    return HonestPaths(lost, facts.cut_off, facts.all_attacked)


def droppable(case: Case) -> list[int] | None:
    """Vehicles that dropped links may part from the navigator."""
    network, _, trusted, _ = case.situation
    drops = case.scenario.defence.may_drop(network, trusted)
    return vehicle_numbers(~safety.stay_joined(drops, np.ones(network.vehicles, bool))) or None


class JointReach(NamedTuple):
    """Vehicles, from 1, that the navigator reaches where networks take turns."""

    union: list[int]  # over the links of all networks
    always: list[int]  # in each network
    nominal: list[int]  # in each network, and so is every vehicle upstream


def joint_reach(networks: Sequence[Digraph]) -> JointReach:
    """Whom the navigator reaches in networks that take turns.

    Without attack and errors, the `nominal` vehicles obey O1 (theorems.md): all their messages are
    those of vehicles that obey it too.
    """
    vehicles = networks[0].vehicles
    links = set[tuple[int, int]]()
    always = set(range(1, vehicles + 1))
    for network in networks:
        listeners, slots = network.edges()
        sources = network.sources[listeners, slots]
        links |= set(zip((listeners + 1).tolist(), sources.tolist(), strict=True))
        always -= set(graph.unreachable(network))
    everything = graph.weighted(vehicles, [(*link, 1.0) for link in sorted(links)])
    union = set(range(1, vehicles + 1)) - set(graph.unreachable(everything))
    nominal = set(always)
    while spoilt := {i for i, j in links if i in nominal and j and j not in nominal}:
        nominal -= spoilt
    return JointReach(sorted(union), sorted(always), sorted(nominal))


def reach_in_turns(case: Case) -> JointReach | None:
    networks = case.scenario.topology.turns()
    if len(networks) == 1:
        return None
    return joint_reach([each.normalised_rows(case.scenario.vehicles) for each in networks])


def nominal_in_turns(case: Case) -> list[int] | None:
    found = reach_in_turns(case)
    return None if found is None else found.nominal


INVERSE_NORM = Theorem(
    "O5", "inverse norm", "", ("leader",), lambda case: certify(*case.situation[:2]).inverse_norm
)
HONEST_PATHS = Theorem("Assumption 1", "honest paths", "", ("leader",), honest_paths)
CUT_OFF = Theorem("O11", "cut off", "", ("leader",), droppable)
REACH = Theorem("O1", "reach", "", ("leader", "small"), reach_in_turns)
NOMINAL = Theorem("O1", "nominal", "", ("leader", "small", "solved", "flat"), nominal_in_turns)


class Margin(NamedTuple):
    """Attacked sets, of at most three vehicles, that break the safety of each vehicle."""

    sets: list[list[tuple[int, ...]]]  # of each unsafe vehicle, the minimal sets that break it
    further: Int[np.ndarray, " m"]  # least number of further attackers that break it; 0 if unsafe


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
