"""Vehicles that no attack can keep off the navigator, from the links a defence may drop
(theorems.md O11).

All functions use bootstrap percolation, which takes O(links). Doubt spreads from attacked links.
The remaining vehicles must stay joined to the navigator, whichever links they drop.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from jaxnet.model.graph import Digraph, Links
from jaxnet.model.retained import DropPolicy

Vehicles = Bool[np.ndarray, " m"]
Nodes = Bool[np.ndarray, " sources"]
Counts = Int[np.ndarray, " m"]
Votes = Int[np.ndarray, "m slots"]

NEVER = 2**62  # votes that no vehicle receives
MOST_RATED = 1000  # vehicles up to which a contraction is computed
SLOWEST = 1e-3  # least contraction that is reported


class Safe(NamedTuple):
    """Vehicles that converge to the navigator, and the reason in a few words.

    A reason with `consistent` holds only if attacked links announce what they carry (B1).
    """

    why: str
    vehicles: Vehicles
    consistent: bool = False
    left: float = 0.0  # [m/s³], the greatest R(a) that a tolerance of rounding leaves on links


def percolate(graph: Digraph, votes: Votes, needed: Counts, seeds: Nodes) -> Nodes:
    """The sources that percolation reaches from the seeds.

    Percolation reaches a vehicle once its reached sources have given it `needed` votes. `votes`
    holds the votes of each link.
    """
    listeners, slots = graph.edges()
    order = graph.sources[listeners, slots].argsort(kind="stable")
    number = np.bincount(graph.sources[listeners, slots], minlength=graph.vehicles + 1)
    ends = [0, *number.cumsum().tolist()]  # of the links from each source
    who, theirs = listeners[order].tolist(), votes[listeners, slots][order].tolist()
    reached = seeds | np.append(False, needed <= 0)
    left, waiting, there = needed.tolist(), np.flatnonzero(reached).tolist(), reached.tolist()
    for source in waiting:
        mine = slice(ends[source], ends[source + 1])
        for listener, vote in zip(who[mine], theirs[mine], strict=True):
            left[listener] -= vote
            if left[listener] <= 0 and not there[listener + 1]:
                there[listener + 1] = True
                waiting.append(listener + 1)
    return np.array(there)


def stay_joined(drops: DropPolicy, among: Vehicles) -> Vehicles:
    """The vehicles of a set that stay joined to the navigator through the set.

    They stay joined whichever links they drop. Percolation joins a vehicle if it always retains one
    joined source, or if it hears more joined sources than it drops.
    """
    votes = np.where(drops.links, 1, drops.number[:, None] + 1)
    navigator = np.arange(len(among) + 1) == 0
    return percolate(drops.graph, votes, np.where(among, drops.number + 1, NEVER), navigator)[1:]


def greatest(drops: DropPolicy, attacked: Links, bears: Counts) -> Vehicles:
    """The greatest set of vehicles that is closed, tolerates its attacked links and stays joined.

    - Closed: no vehicle of the set hears a vehicle outside the set.
    - Tolerant: each vehicle has at most `bears` attacked links that it may drop, and no other
      attacked link.
    - Joined: the vehicles join each other to the navigator, whichever links they drop.
    """
    falsified = drops.graph.heard & attacked
    fatal = np.broadcast_to(bears[:, None] + 1, attacked.shape)
    left = bears + 1 - (np.where(drops.links, 1, fatal) * falsified).sum(axis=1)
    out = np.zeros(len(bears) + 1, bool)
    while True:
        out = percolate(drops.graph, fatal, left, out)
        inside = stay_joined(drops, ~out[1:])
        if (inside | out[1:]).all():
            return inside
        out[1:] = ~inside


def contraction(drops: DropPolicy, inside: Vehicles) -> tuple[int, float] | None:
    """A number of ticks, and the factor by which announced disturbances shrink in these ticks.

    The disturbance is the greatest announcement of the vehicles `inside`, and the factor is the
    worst case. It follows from step (c) of the proof of theorem 1 (docs/guarantees.md), from the
    navigator outwards. The result is None in four cases:

    - The fleet has more than MOST_RATED vehicles.
    - The set is empty.
    - Percolation does not reach the whole set.
    - The factor exceeds 1 - SLOWEST.
    """
    if len(inside) > MOST_RATED or not inside.any():
        return None
    weights, sources = drops.graph.weights, drops.graph.sources
    rank = np.arange(drops.links.shape[1])
    lightest = np.sort(np.where(drops.links, weights, 0.0) + ~drops.links, axis=1)
    kept = weights.sum(axis=1) - lightest.sum(axis=1, where=rank < drops.number[:, None])
    factor, ticks = np.concatenate([[0.0], np.full(len(inside), np.nan)]), 0
    while np.isnan(factor[1:][inside]).any():
        known = ~np.isnan(factor)[sources]
        never, perhaps = drops.graph.heard & known & ~drops.links, drops.links & known
        enough = perhaps.sum(axis=1) > drops.number
        shares = weights.sum(axis=1, where=never), weights.min(axis=1, where=perhaps, initial=1.0)
        worst = (np.where(which, factor[sources], 0.0).max(axis=1) for which in (never, perhaps))
        either = [1 - share / kept * (1 - most) for share, most in zip(shares, worst, strict=True)]
        new = inside & np.isnan(factor[1:]) & (never.any(axis=1) | enough)
        factor[1:][new] = np.where(enough, np.minimum(*either), either[0])[new]
        ticks += 1
        if not new.any() or np.nanmax(factor) > 1 - SLOWEST:
            return None
    return ticks, float(np.nanmax(factor))
