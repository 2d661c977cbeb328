"""Who hears whom, with what weight (paper, section 2), in NumPy: a graph is settled before anything runs.

A graph of m vehicles is one array `weights` (m, m + 1): row i - 1 holds what vehicle i hears, column j the
weight w_ij of source j, the navigator's w_i0 first, that is `[a0 | A]`. Rows sum to 1, or to 0 where a
vehicle hears nobody.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

Weights = Float[np.ndarray, "m sources"]
Links = Bool[np.ndarray, "m sources"]
Neighbours = Bool[np.ndarray, "m m"]  # which vehicles each one hears


def weighted(vehicles: int, edges: Iterable[tuple[int, int, float]]) -> Weights:
    """Graph of the edges (i, j, w), "i hears j with weight w", each row normalised to sum 1."""
    weights = np.zeros((vehicles, vehicles + 1))
    for listener, source, weight in edges:
        weights[listener - 1, source] = weight
    return normalised(weights)


def normalised(weights: Weights) -> Weights:
    """The weights with rows that sum to 1, or to 0 where a vehicle hears nobody."""
    total = weights.sum(axis=1, keepdims=True)
    return np.divide(weights, total, out=np.zeros_like(weights), where=total > 0)


def laplacian(weights: Weights) -> Float[np.ndarray, "m m"]:
    """`L = I - A`; where everybody hears somebody, nonsingular just if the navigator reaches everybody."""
    return np.eye(len(weights)) - weights[:, 1:]


def hops(weights: Weights | Links) -> Float[np.ndarray, " m"]:
    """Links on the shortest way from the navigator to each vehicle, inf where there is none."""
    heard = weights[:, 1:] > 0
    newest = weights[:, 0] > 0
    found = np.where(newest, 1.0, np.inf)
    while newest.any():
        farther = found[newest].max() + 1
        newest = heard[:, newest].any(axis=1) & np.isinf(found)
        found[newest] = farther
    return found


def unreachable(weights: Weights | Links) -> list[int]:
    """Vehicles that nothing the navigator says can reach."""
    return [int(i) for i in np.flatnonzero(np.isinf(hops(weights))) + 1]


def hears_vehicles(weights: Weights) -> bool:
    """Whether any vehicle hears another one."""
    return bool((weights[:, 1:] > 0).any())


def trusted_links(weights: Weights, trusted: Mapping[int, Iterable[int]]) -> Links:
    """Links whose source the listener trusts: the navigator wherever it is heard, and the listed ones."""
    links = np.zeros(weights.shape, dtype=bool)
    links[:, 0] = True
    for listener, sources in trusted.items():
        links[listener - 1, list(sources)] = True
    return links & (weights > 0)


def least(heard: Links, values: Float[np.ndarray, "m sources"], count: Any) -> Links:
    """The `count` sources that each listener hears of the least values, of equal ones the first."""
    ranks = np.where(heard, values, np.inf).argsort(axis=1, kind="stable").argsort(axis=1)
    return heard & (ranks < np.reshape(count, (-1, 1)))


def metropolis(heard: Neighbours) -> Float[np.ndarray, "m m"]:
    """`1 / (1 + max(d_i, d_j))` where i hears j, d_i the number of vehicles that i hears.

    Symmetric where links are mutual; what is left of 1 in a row is the vehicle's own. Source: Xiao, Boyd and
    Lall, A scheme for robust distributed sensor fusion based on average consensus, 2005.
    """
    degrees = heard.sum(axis=1)
    return heard / (1.0 + np.maximum.outer(degrees, degrees))
