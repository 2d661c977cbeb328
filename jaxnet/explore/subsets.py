"""Probabilities too small to count: subset simulation (Au and Beck, 2001).

What is drawn is standard normal. The share over a level is a product of shares that are not small: of the
points over the last threshold, a tenth is over the next. From that tenth Markov chains go on, which keep the
normal law and stay over the threshold: x ← √(1 − b²) x + b ξ, unless that is below (Papaioannou, Betz,
Zwirglmaier and Straub, 2015). b follows how many steps are taken.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import stats

from jaxnet.statistics.recovery import CONFIDENCE

PART = 0.1  # of the points that go on
CHAIN = round(1 / PART)  # points of a chain, its first included
MOST_LEVELS = 12
WANTED = 0.44  # share of steps that are taken

Normals = Float[np.ndarray, "points coordinates"]
Heights = Float[np.ndarray, " points"]
Height = Callable[
    [Normals, Int[np.ndarray, " points"]], Heights
]  # of points, and the chains that they are of


class Estimate(NamedTuple):
    """A share from independent repeats: their mean with its t interval, and what it took."""

    share: float
    low: float
    high: float
    levels: int  # at most
    evaluations: int


def estimate(
    height: Height, coordinates: int, level: float, points: int, repeats: int, random: np.random.Generator
) -> Estimate:
    """The share of points whose height is over a level; the height of what failed is minus infinity."""
    found = [estimate_once(height, coordinates, level, points, number, random) for number in range(repeats)]
    shares = np.array([share for share, *_ in found])
    half = stats.t.ppf((1 + CONFIDENCE) / 2, repeats - 1) * shares.std(ddof=1) / np.sqrt(repeats)
    low, high = max(0.0, shares.mean() - half), shares.mean() + half
    levels, spent = max(levels for _, levels, _ in found), sum(spent for *_, spent in found)
    return Estimate(float(shares.mean()), float(low), float(high), levels, spent)


def estimate_once(
    height: Height, coordinates: int, level: float, points: int, repeat: int, random: np.random.Generator
) -> tuple[float, int, int]:
    """One repeat: the share, how many levels it took, and how many points were looked at."""
    where, chains = random.standard_normal((points, coordinates)), repeat * points + np.arange(points)
    heights, share, step, spent = height(where, chains), 1.0, 0.5, points
    for number in range(1, MOST_LEVELS + 1):
        order = np.argsort(-heights, kind="stable")
        seeds = order[: points // CHAIN]
        threshold = heights[order[points // CHAIN]]
        if threshold >= level or number == MOST_LEVELS:
            return share * float((heights > level).mean()), number, spent
        share *= float((heights > threshold).mean())
        where, heights, chains = where[seeds], heights[seeds], chains[seeds]
        parts = [(where, heights, chains)]
        for _ in range(CHAIN - 1):
            tried = np.sqrt(1 - step**2) * where + step * random.standard_normal(where.shape)
            theirs = height(tried, chains)
            over = theirs > threshold
            where, heights = np.where(over[:, None], tried, where), np.where(over, theirs, heights)
            step = float(np.clip(step * np.exp(over.mean() - WANTED), 0.02, 1.0))
            parts.append((where, heights, chains))
            spent += len(tried)
        where, heights, chains = (np.concatenate(each) for each in zip(*parts, strict=True))
    raise AssertionError
