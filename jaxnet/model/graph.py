"""Who hears whom, with what weight (paper, section 2), in NumPy: a graph is settled before anything runs.

A graph of m vehicles is one array `weights` (m, m + 1): row i - 1 holds what vehicle i hears, column j the
weight w_ij of source j, the navigator's w_i0 first, that is `[a0 | A]`. Rows sum to 1, or to 0 where a
vehicle hears nobody.
"""

from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Bool, Float, Int

Weights = Float[np.ndarray, "m sources"]
Links = Bool[np.ndarray, "m sources"]


def star(vehicles: int) -> Weights:
    """Every vehicle hears the navigator alone."""
    weights = np.zeros((vehicles, vehicles + 1))
    weights[:, 0] = 1.0
    return weights


def cyclic(vehicles: int, navigator_weight: float) -> Weights:
    """Every vehicle hears the navigator and, with equal weights, both its neighbours on a ring."""
    weights = np.zeros((vehicles, vehicles + 1))
    weights[:, 0] = navigator_weight
    rows = np.arange(vehicles)
    for step in (-1, 1):
        weights[rows, (rows + step) % vehicles + 1] += (1.0 - navigator_weight) / 2
    return weights


def path(vehicles: int) -> Weights:
    """Vehicle 1 hears the navigator, vehicle i hears i - 1."""
    return np.eye(vehicles, vehicles + 1)


def figure1() -> Weights:
    """The paper's Fig. 1 (m = 5): 1, 4 and 5 hear 0, 2 hears 1, 3 hears 2, 4 and 5 hear each other."""
    heard = [(1, 0), (4, 0), (5, 0), (2, 1), (3, 2), (4, 5), (5, 4)]
    return weighted(5, [(listener, source, 1.0) for listener, source in heard])


def weighted(vehicles: int, edges: Iterable[tuple[int, int, float]]) -> Weights:
    """Graph of the edges (i, j, w), "i hears j with weight w", each row normalised to sum 1."""
    weights = np.zeros((vehicles, vehicles + 1))
    for listener, source, weight in edges:
        weights[listener - 1, source] = weight
    total = weights.sum(axis=1, keepdims=True)
    return np.divide(weights, total, out=np.zeros_like(weights), where=total > 0)


def laplacian(weights: Weights) -> Float[np.ndarray, "m m"]:
    """`L = I - A`; where everybody hears somebody, nonsingular just if the navigator reaches everybody."""
    return np.eye(len(weights)) - weights[:, 1:]


def unreachable(weights: Weights) -> list[int]:
    """Vehicles that nothing the navigator says can reach."""
    heard = weights[:, 1:] > 0
    reached = weights[:, 0] > 0
    newest = reached
    while newest.any():
        newest = heard[:, newest].any(axis=1) & ~reached
        reached = reached | newest
    return [int(i) for i in np.flatnonzero(~reached) + 1]


def hears_vehicles(weights: Weights) -> bool:
    """Whether any vehicle hears another one."""
    return bool((weights[:, 1:] > 0).any())


def attacked_links(weights: Weights, vehicles: Iterable[int], channel: str) -> Links:
    """Links that carry an attack.

    `neighbour` corrupts everything that the listed vehicles transmit, `navigator` what they hear from 0,
    `auto` is `navigator` where no vehicle hears another.
    """
    if channel == "auto":
        channel = "neighbour" if hears_vehicles(weights) else "navigator"
    listed = np.array(sorted(vehicles), dtype=int)
    links = np.zeros(weights.shape, dtype=bool)
    if channel == "neighbour":
        links[:, listed] = True
    else:
        links[listed - 1, 0] = True
    return links & (weights > 0)


def trusted_links(weights: Weights, trusted: Mapping[int, Iterable[int]]) -> Links:
    """Links whose source the listener trusts: the navigator wherever it is heard, and the listed ones."""
    links = np.zeros(weights.shape, dtype=bool)
    links[:, 0] = True
    for listener, sources in trusted.items():
        links[listener - 1, list(sources)] = True
    return links & (weights > 0)


def protected(weights: Weights, trusted: Links, theta: Int[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
    """Vehicles that meet the trimming condition: at least 2ϑ + 1 heard and ϑ trusted sources."""
    heard = (weights > 0).sum(axis=1)
    return (heard >= 2 * theta + 1) & (trusted.sum(axis=1) >= theta)
