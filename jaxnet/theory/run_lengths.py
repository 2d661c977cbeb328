"""Mean run lengths of detectors, and the lies that never raise an alarm (theorems.md O19).

A run is the number of ticks up to the first alarm about one link. Residuals of successive ticks are
independent and normal, with variance 1 on each axis and in each order with errors.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxnet.kinds.detectors import AlarmRule
from jaxnet.lazy import stats

GAUSS_NODES = 24  # of a panel
MOST_PIECES = 40  # of a CUSUM's range
SETTLED = 1e-12  # relative change of the rate at which runs end

Kernel = Float[np.ndarray, "states states"]


class MeanRun(NamedTuple):
    """Mean number of ticks to the first alarm, between two ends, which are equal if it is known."""

    least: float
    most: float


def mean_run(rule: AlarmRule, orders: int, lie: float = 0.0, links: int = 1) -> MeanRun | None:
    """Mean run to the first alarm about any of some links with independent errors.

    Parameters
    ----------
    rule
        The test of each link.
    orders
        Number of orders with errors.
    lie
        Length of a constant lie over the standard deviation; along the direction, if the rule has
        one.
    links
        Number of links.

    Returns
    -------
        The mean, from S = 0. Of a window of n ticks, with alarms of probability α, two ends are
        known: 1/α for overlapping sums are associated (Esary, Proschan and Walkup 1967), and n/α
        by the sums that do not overlap. None if the range of a CUSUM is too long.
    """
    degrees = 2 * orders
    if rule.drift is None:
        chance = float(law(degrees * rule.window, rule.window * lie**2).sf(rule.limit))
        first = -math.expm1(links * math.log1p(-chance)) if chance < 1 else 1.0
        return MeanRun(1 / first, rule.window / first)
    kernel = cusum(
        law(degrees, lie**2) if rule.squared else stats.norm(lie), rule.drift, rule.limit
    )
    if kernel is None:
        return None
    mean = mean_first(kernel, links)
    return MeanRun(mean, mean)


def law(degrees: int, lie: float) -> Any:
    """The χ² law of a squared residual whose mean has the squared length `lie`."""
    return stats.ncx2(degrees, lie) if lie else stats.chi2(degrees)


def cusum(law: Any, drift: float, limit: float) -> Kernel | None:
    """The step of `S ← max(0, S + z - drift)` up to the limit; z has a law of scipy.

    A row is a state, S = 0 first. The row times the values of a function at all states is its mean
    after the step. It is integrated over panels, each with the Legendre polynomials of its values
    at Gauss's nodes: a law from 0 on has a jump at S = s - drift, and functions have kinks at
    multiples of the drift. None for too many panels.
    """
    least = law.support()[0]
    width = drift if np.isfinite(least) else 1.0
    panels = math.ceil(limit / width - SETTLED)
    if panels > MOST_PIECES:
        return None
    place, share = np.polynomial.legendre.leggauss(GAUSS_NODES)
    edges = np.minimum(width * np.arange(panels + 1), limit)[:, None]
    low, high = edges[:-1], edges[1:]
    nodes = low + (high - low) * (place + 1) / 2
    states = np.append(0.0, nodes)[:, None, None]
    first = np.clip(states - drift + least, low, high)
    points = first + (high - first) * (place + 1) / 2
    density = (high - first) / 2 * share * law.pdf(points + drift - states)
    basis = np.polynomial.legendre.legvander(2 * (points - low) / (high - low) - 1, GAUSS_NODES - 1)
    values = basis @ np.linalg.inv(np.polynomial.legendre.legvander(place, GAUSS_NODES - 1))
    moved = np.einsum("spq,spqn->spn", density, values).reshape(len(states), -1)
    return np.column_stack([law.cdf(drift - states[:, 0, 0]), moved])


def mean_first(step: Kernel, links: int) -> float:
    """`Σ_t P(no alarm until t)^links` from S = 0; after a while each tick has one factor."""
    if links == 1:
        return float(np.linalg.solve(np.eye(len(step)) - step, np.ones(len(step)))[0])
    quiet, mean, last = np.ones(len(step)), 0.0, math.nan
    while (now := float(quiet[0])) ** links > 0:
        mean, quiet = mean + now**links, step @ quiet
        ratio = float(quiet[0]) / now
        if abs(ratio - last) < SETTLED:
            return mean + (now * ratio) ** links / -math.expm1(links * math.log(ratio))
        last = ratio
    return mean


class Unseen(NamedTuple):
    """Lies without alarm: the squared residuals of any K ticks in a row are at most K rate + burst.

    They are whitened. A residual of √rate at each tick, after one of √first, is seen by nobody.
    """

    rate: float
    burst: float
    first: float


def unseen(rule: AlarmRule) -> Unseen | None:
    """The lies that a rule does not see; None if it bounds none, as along one direction."""
    if not rule.squared:
        return None
    if rule.drift is not None:
        return Unseen(rule.drift, rule.limit, rule.drift + rule.limit)
    rate = rule.limit / rule.window
    return Unseen(rate, rule.limit - rate, rate)
