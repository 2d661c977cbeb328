"""Patterns of links between vehicles: entry (i, j) says whether vehicle i + 1 hears vehicle j + 1."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from jaxnet.model.graph import Neighbours


def circulant(vehicles: int, offsets: Iterable[int]) -> Neighbours:
    """Who hears whom where i hears i + o for each offset o, around the ring."""
    heard, everyone = np.zeros((vehicles, vehicles), bool), np.arange(vehicles)
    for offset in offsets:
        heard[everyone, (everyone + offset) % vehicles] = True
    return heard


def lattice(vehicles: int, neighbours: int) -> Neighbours:
    """Who hears whom where each hears the nearest on a ring, half of them on each side."""
    near = range(1, neighbours // 2 + 1)
    return circulant(vehicles, [*near, *(-offset for offset in near)])


def grid(rows: int, columns: int, torus: bool) -> Neighbours:
    """Who hears whom in rows and columns, numbered row by row; of a torus the last also hears the first."""
    place = np.arange(rows * columns).reshape(rows, columns)
    heard = np.zeros((place.size, place.size), bool)
    for lines in (place, place.T):
        ahead = np.roll(lines, -1, axis=0)
        here, there = (lines, ahead) if torus else (lines[:-1], ahead[:-1])
        heard[here, there] = heard[there, here] = True
    return heard & ~np.eye(place.size, dtype=bool)


def small_world(vehicles: int, neighbours: int, rewired: float, random: np.random.Generator) -> Neighbours:
    """A ring lattice whose links, offset by offset, are each joined to another vehicle with a probability.

    Source: Watts and Strogatz, Collective dynamics of small-world networks, 1998.
    """
    heard = lattice(vehicles, neighbours)
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
        heard = np.zeros((vehicles, vehicles), bool)
        ends = np.repeat(np.arange(vehicles), degree)
        while len(ends):
            ends = random.permutation(ends)
            left = []
            for i, j in ends.reshape(-1, 2):
                if i == j or heard[i, j]:
                    left += [i, j]
                else:
                    heard[i, j] = heard[j, i] = True
            if len(left) == len(ends) and not any_pair(heard, left):
                break
            ends = np.array(left, int)
        else:
            return heard


def any_pair(heard: Neighbours, ends: list[Any]) -> bool:
    """Whether two of these free ends may still be joined."""
    free = np.unique(ends)
    return bool((~heard[np.ix_(free, free)] & ~np.eye(len(free), dtype=bool)).any())
