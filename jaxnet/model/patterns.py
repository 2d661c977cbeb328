"""Patterns of links between vehicles: entry (i, j) says whether vehicle i + 1 hears vehicle j + 1.

Patterns are sparse SciPy arrays. Only `small_world` returns a dense one: it rewires links.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Bool

from jaxnet.lazy import sparse
from jaxnet.model.graph import Numbered

Neighbours = Any  # (m, m) booleans: listener i hears source j; a dense or a sparse SciPy array


def of_pairs(vehicles: int, listeners: Numbered, sources: Numbered) -> Neighbours:
    """The pattern of links from lists of listeners and sources, from 0."""
    return sparse.coo_array(
        (np.ones(len(listeners), bool), (listeners, sources)), shape=(vehicles, vehicles)
    )


def circulant(vehicles: int, offsets: Iterable[int]) -> Neighbours:
    """The pattern on a ring in which i hears i + o for each offset o."""
    around = np.unique(np.array([offset % vehicles for offset in offsets], int))
    listeners = np.arange(vehicles).repeat(len(around))
    return of_pairs(vehicles, listeners, (listeners + np.tile(around, vehicles)) % vehicles)


def lattice(vehicles: int, neighbours: int) -> Neighbours:
    """Pattern on a ring in which each vehicle hears its nearest neighbours, half on each side."""
    near = range(1, neighbours // 2 + 1)
    return circulant(vehicles, [*near, *(-offset for offset in near)])


def grid(rows: int, columns: int, torus: bool) -> Neighbours:
    """A grid's pattern, numbered row by row; in a torus the ends of each line hear each other."""
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
    """A ring lattice with links rewired at random.

    For each offset and vehicle, the link moves to another random vehicle with probability
    `rewired`. Source: Watts and Strogatz, Collective dynamics of small-world networks, 1998.
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
    """The pattern of a random regular graph, drawn by random pairing of free link ends.

    Nearly uniform. Source: Steger and Wormald, Generating random regular graphs quickly, 1999.
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
            free = sorted(set(left))
            possible = any((i, j) not in pairs for i in free for j in free if i != j)
            if len(left) == len(ends) and not possible:
                break
            ends = np.array(left, int)
        else:
            return of_pairs(vehicles, *zip(*pairs, strict=True))
