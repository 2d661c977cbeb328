"""What a network promises before anything moves: reach, gain, and the paper's Assumption 1.

NumPy alone, so that a config is checked at once.
"""

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from jaxnet.model import graph
from jaxnet.model.graph import Digraph, Links
from jaxnet.model.safety import Vehicles

MOST_TRIED = 3  # vehicles in a set that is tried
MOST_INVERTED = 1_000  # vehicles whose L is inverted, in less than a second


class Certificate(NamedTuple):
    """Facts about one network; vehicles are listed by number, from 1."""

    heard: Int[np.ndarray, " m"]  # |N_i|, sources that each vehicle hears
    unreachable: list[int]
    inverse_norm: float | None  # ‖L⁻¹‖₂, infinite if L is singular; of large fleets it is not found
    attacked_links: list[tuple[int, int]]  # (i, j): what i hears of j is corrupted
    all_attacked: list[int]  # vehicles all of whose links are attacked
    cut_off: list[int]  # vehicles that no honest path joins to the navigator


def certify(network: Digraph, attacked: Links) -> Certificate:
    """Certificate of a graph and the links attacked on it."""
    honest = network.heard & ~attacked
    lost = graph.unreachable(network)
    norm = np.inf if lost else None
    if not lost and network.vehicles <= MOST_INVERTED:
        norm = graph.inverse_norm(network)
    return Certificate(
        heard=network.heard.sum(axis=1),
        unreachable=lost,
        inverse_norm=norm,
        attacked_links=[(int(i) + 1, int(network.sources[i, slot])) for i, slot in np.argwhere(attacked)],
        all_attacked=vehicles(np.asarray(~honest.any(axis=1))),
        cut_off=graph.unreachable(network.only(honest)),
    )


def vehicles(mask: Bool[np.ndarray, " m"]) -> list[int]:
    """Numbers of the vehicles in a mask."""
    return [int(i) for i in np.flatnonzero(mask) + 1]


class Margin(NamedTuple):
    """What breaks the safety of each vehicle, as far as sets of three vehicles tell."""

    sets: list[list[tuple[int, ...]]]  # of who is not safe: least sets of the attacked that suffice for it
    further: Int[np.ndarray, " m"]  # that break who is safe, attacked too; 0 if not safe, 4 at most


def margin(safe: Callable[[list[int]], Vehicles], attacked: Sequence[int], vehicles: int) -> Margin:
    """By trying: `safe` says who is if these vehicles are attacked, fewer the more there are."""
    sets: list[list[tuple[int, ...]]] = [[] for _ in range(vehicles)]
    further = np.where(safe([*attacked]), MOST_TRIED + 1, 0)
    for few in some_of(attacked, 0):
        for i in np.flatnonzero(~safe([*few]) & (further == 0)):
            if not any(set(each) <= set(few) for each in sets[i]):
                sets[i].append(few)
    for more in some_of([i for i in range(1, vehicles + 1) if i not in attacked], 1):
        if (further <= len(more)).all():
            break
        broken = ~safe([*attacked, *more])
        further = np.where(broken, np.minimum(further, len(more)), further)
    return Margin(sets, further)


def some_of(vehicles: Sequence[int], least: int) -> list[tuple[int, ...]]:
    """Sets of `least` to three of some vehicles, smaller ones first."""
    return [each for size in range(least, MOST_TRIED + 1) for each in combinations(vehicles, size)]
