"""Patterns of links between vehicles: entry (i, j) says whether vehicle i + 1 hears vehicle j + 1.

Sparse arrays of SciPy's, but for the small world, which is rewired in a dense one.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Bool
from scipy import sparse

Neighbours = Any  # (m, m) booleans: which vehicles each one hears, dense or a sparse array of SciPy's


def of_pairs(vehicles: int, listeners: Any, sources: Any) -> Neighbours:
    """Who hears whom by listeners and sources, from 0."""
    return sparse.coo_array((np.ones(len(listeners), bool), (listeners, sources)), shape=(vehicles, vehicles))


def circulant(vehicles: int, offsets: Iterable[int]) -> Neighbours:
    """Who hears whom where i hears i + o for each offset o, around the ring."""
    around = np.unique(np.array([offset % vehicles for offset in offsets], int))
    listeners = np.arange(vehicles).repeat(len(around))
    return of_pairs(vehicles, listeners, (listeners + np.tile(around, vehicles)) % vehicles)


def lattice(vehicles: int, neighbours: int) -> Neighbours:
    """Who hears whom where each hears the nearest on a ring, half of them on each side."""
    near = range(1, neighbours // 2 + 1)
    return circulant(vehicles, [*near, *(-offset for offset in near)])


def grid(rows: int, columns: int, torus: bool) -> Neighbours:
    """Who hears whom in rows and columns, numbered row by row; of a torus the last also hears the first."""
    place = np.arange(rows * columns).reshape(rows, columns)
    pairs = []
    for lines in (place, place.T):
        ahead = np.roll(lines, -1, axis=0)
        here, there = (lines, ahead) if torus else (lines[:-1], ahead[:-1])
        pairs += [np.stack([here, there]).reshape(2, -1), np.stack([there, here]).reshape(2, -1)]
    listeners, sources = np.unique(np.concatenate(pairs, axis=1), axis=1)
    others = listeners != sources
    return of_pairs(place.size, listeners[others], sources[others])


def small_world(
    vehicles: int, neighbours: int, rewired: float, random: np.random.Generator
) -> Bool[np.ndarray, "m m"]:
    """A ring lattice whose links, offset by offset, are each joined to another vehicle with a probability.

    Source: Watts and Strogatz, Collective dynamics of small-world networks, 1998.
    """
    heard = lattice(vehicles, neighbours).toarray()
    for offset in range(1, neighbours // 2 + 1):
        for i in np.flatnonzero(random.random(vehicles) < rewired):
            free = np.flatnonzero(~heard[i] & (np.arange(vehicles) != i))
            if len(free):
                before, now = (i + offset) % vehicles, random.choice(free)
                heard[i, before] = heard[before, i] = False
                heard[i, now] = heard[now, i] = True
    return heard


def drawn_regular(vehicles: int, degree: int, random: np.random.Generator) -> Neighbours:
    """Who hears whom in a random regular graph, by pairing free ends until all are paired.

    Source: Steger and Wormald, Generating random regular graphs quickly, 1999; nearly uniform.
    """
    while True:
        pairs: set[tuple[int, int]] = set()
        ends = np.repeat(np.arange(vehicles), degree)
        while len(ends):
            ends = random.permutation(ends)
            left: list[int] = []
            for i, j in ends.reshape(-1, 2).tolist():
                if i == j or (i, j) in pairs:
                    left += [i, j]
                else:
                    pairs |= {(i, j), (j, i)}
            if len(left) == len(ends) and not any_pair(pairs, left):
                break
            ends = np.array(left, int)
        else:
            return of_pairs(vehicles, *zip(*pairs, strict=True))


def any_pair(pairs: set[tuple[int, int]], ends: list[int]) -> bool:
    """Whether two of these free ends may still be joined."""
    free = sorted(set(ends))
    return any((i, j) not in pairs for i in free for j in free if i != j)
