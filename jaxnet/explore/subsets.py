"""Subset simulation of small probabilities (Au and Beck, 2001).

The random numbers are standard normal. The probability of exceeding a level is a product of conditional
probabilities that are not small: a tenth of the points over one threshold is over the next threshold. Markov
chains start from that tenth. They preserve the normal distribution and stay over the threshold: the proposal
x ← √(1 − b²) x + b ξ is rejected below it (Papaioannou, Betz, Zwirglmaier and Straub, 2015). The step b
adapts to the share of accepted steps.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import stats

from jaxnet.statistics.intervals import CONFIDENCE

PART = 0.1  # share of the points that start chains
CHAIN = round(1 / PART)  # points of a chain, the first included
MOST_LEVELS = 12
TARGET_ACCEPTANCE = 0.44  # share of accepted steps

Normals = Float[np.ndarray, "points coordinates"]
Heights = Float[np.ndarray, " points"]
Chains = Int[np.ndarray, " points"]  # number of each point's chain
Height = Callable[[Normals, Chains], Heights]


class Estimate(NamedTuple):
    """Mean share over independent repeats, its t interval, and the effort."""

    share: float
    low: float
    high: float
    levels: int  # greatest of the repeats
    evaluations: int


def estimate(
    height: Height,
    coordinates: int,
    level: float,
    points: int,
    repeats: int,
    random: np.random.Generator,
) -> Estimate:
    """Return the share of points whose height exceeds a level.

    The height of a failed lane is minus infinity.
    """
    found = [
        estimate_once(height, coordinates, level, points, number, random)
        for number in range(repeats)
    ]
    shares = np.array([share for share, *_ in found])
    half = stats.t.ppf((1 + CONFIDENCE) / 2, repeats - 1) * shares.std(ddof=1) / np.sqrt(repeats)
    low, high = max(0.0, shares.mean() - half), shares.mean() + half
    levels, spent = max(levels for _, levels, _ in found), sum(spent for *_, spent in found)
    return Estimate(float(shares.mean()), float(low), float(high), levels, spent)


def estimate_once(
    height: Height,
    coordinates: int,
    level: float,
    points: int,
    repeat: int,
    random: np.random.Generator,
) -> tuple[float, int, int]:
    """Run one repeat and return the share, the number of levels and the number of evaluations."""
    where, chains = (
        random.standard_normal((points, coordinates)),
        repeat * points + np.arange(points),
    )
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
            proposed = np.sqrt(1 - step**2) * where + step * random.standard_normal(where.shape)
            proposed_heights = height(proposed, chains)
            over = proposed_heights > threshold
            where = np.where(over[:, None], proposed, where)
            heights = np.where(over, proposed_heights, heights)
            step = float(np.clip(step * np.exp(over.mean() - TARGET_ACCEPTANCE), 0.02, 1.0))
            parts.append((where, heights, chains))
            spent += len(proposed)
        where, heights, chains = (np.concatenate(each) for each in zip(*parts, strict=True))
    raise AssertionError
