"""Certificate of a network before a simulation: reach, gain, and the paper's Assumption 1.

The module imports NumPy alone, so that a config is checked at once.
"""

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from jaxnet.model import graph
from jaxnet.model.graph import Digraph, Links
from jaxnet.model.safety import Vehicles

MOST_TRIED = 3  # vehicles in a set
MOST_INVERTED = 1_000  # vehicles; L of a larger fleet takes over a second to invert


class Certificate(NamedTuple):
    """Facts about one network; lists contain vehicle numbers, from 1."""

    heard: Int[np.ndarray, " m"]  # |N_i|, sources that each vehicle hears
    unreachable: list[int]
    inverse_norm: float | None  # ‖L⁻¹‖₂, infinite if L is singular; None for large fleets
    attacked_links: list[tuple[int, int]]  # (i, j): i receives corrupted signals from j
    all_attacked: list[int]  # vehicles whose links are all attacked
    cut_off: list[int]  # vehicles without an honest path from the navigator


def certify(network: Digraph, attacked: Links) -> Certificate:
    """Return the certificate of a graph with attacked links."""
    honest = network.heard & ~attacked
    lost = graph.unreachable(network)
    norm = np.inf if lost else None
    if not lost and network.vehicles <= MOST_INVERTED:
        norm = graph.inverse_norm(network)
    return Certificate(
        heard=network.heard.sum(axis=1),
        unreachable=lost,
        inverse_norm=norm,
        attacked_links=[
            (int(i) + 1, int(network.sources[i, slot])) for i, slot in np.argwhere(attacked)
        ],
        all_attacked=numbered_vehicles(np.asarray(~honest.any(axis=1))),
        cut_off=graph.unreachable(network.only(honest)),
    )


class JointReach(NamedTuple):
    """Vehicles that the navigator reaches where networks take turns; lists contain numbers, from 1."""

    union: list[int]  # over the links of all networks
    always: list[int]  # in each network
    nominal: list[
        int
    ]  # in each network, and no source is ever one that the navigator does not reach


def joint_reach(networks: Sequence[Digraph]) -> JointReach:
    """Return whom the navigator reaches in networks that take turns.

    Without attack and errors, the `nominal` vehicles obey O1 (theorems.md): all their words are those of
    vehicles that obey it too.
    """
    vehicles = networks[0].vehicles
    links = set[tuple[int, int]]()
    always = set(range(1, vehicles + 1))
    for network in networks:
        listeners, slots = network.edges()
        links |= set(
            zip((listeners + 1).tolist(), network.sources[listeners, slots].tolist(), strict=True)
        )
        always -= set(graph.unreachable(network))
    everything = graph.weighted(vehicles, [(*link, 1.0) for link in sorted(links)])
    union = set(range(1, vehicles + 1)) - set(graph.unreachable(everything))
    nominal = set(always)
    while spoilt := {i for i, j in links if i in nominal and j and j not in nominal}:
        nominal -= spoilt
    return JointReach(sorted(union), sorted(always), sorted(nominal))


def numbered_vehicles(mask: Bool[np.ndarray, " m"]) -> list[int]:
    """Return the numbers, from 1, of the vehicles in a mask."""
    return [int(i) for i in np.flatnonzero(mask) + 1]


class Margin(NamedTuple):
    """Attacked sets that break the safety of each vehicle; sets of at most three vehicles are tried."""

    sets: list[
        list[tuple[int, ...]]
    ]  # for each unsafe vehicle, the minimal attacked sets that break it
    further: Int[
        np.ndarray, " m"
    ]  # least number of further attacked vehicles that break it; 0 if unsafe


def margin(safe: Callable[[list[int]], Vehicles], attacked: Sequence[int], vehicles: int) -> Margin:
    """Return the margin by brute force.

    `safe(attacked)` returns the safe vehicles. It is monotone: more attacked vehicles, fewer safe vehicles.
    """
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
    """Return the subsets of some vehicles with `least` to three members, smaller subsets first."""
    return [each for size in range(least, MOST_TRIED + 1) for each in combinations(vehicles, size)]
