"""Intervals: of a share, of a quantile, of a mean.

- A share has the exact binomial interval of Clopper and Pearson (1934).
- A quantile has the exact interval of order statistics, which holds for every distribution (David
  and Nagaraja, Order Statistics, 2003, section 7.1).
- A mean has Student's interval where n ≥ 28 + 25 G², G being the sample's skewness (Sugden, Smith
  and Jones, 2000), widened for skewness (Hall, The Bootstrap and Edgeworth Expansion, 1992) and for
  gaps between numbers. Elsewhere it has none: no interval of a mean holds for all distributions.
"""

import functools

import numpy as np
from jaxtyping import Float, Int

from jaxnet.lazy import special

CONFIDENCE = 0.95
LEAST_LANES, LANES_PER_SKEWNESS = 28, 25  # of the rule for means
ROUNDING_SPREAD = 1e-9  # of the greatest number; numbers that differ by less are alike

Ends = tuple[float, float]
UNKNOWN: Ends = (np.nan, np.nan)
Values = Float[np.ndarray, " n"]
UnitSums = Float[np.ndarray, " units"]


def clopper_pearson(
    successes: Int[np.ndarray, "*n"],
    trials: Int[np.ndarray, "*n"],
    confidence: float | Float[np.ndarray, "*n"],
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """Both ends of the exact interval of a share; 0 and 1 without a trial."""
    tail = (1.0 - confidence) / 2
    with np.errstate(invalid="ignore"):
        low = special.betaincinv(successes, trials - successes + 1.0, tail)
        high = special.betaincinv(successes + 1.0, trials - successes, 1.0 - tail)
    return np.where(successes == 0, 0.0, low), np.where(successes == trials, 1.0, high)


def below_greatest(draws: int) -> float:
    """Share of all draws that, with 95 % confidence, stay below the greatest of n draws.

    The share is 0.05^(1/n), about 1 - 3/n (an order statistic; Wilks, 1941).
    """
    return float((1 - CONFIDENCE) ** (1 / draws))


def quantile_interval(values: Values, quantile: float, confidence: float) -> Ends:
    """Interval of a quantile from independent values, for every distribution.

    The ends are order statistics. An end is not-a-number if there are too few values for it.

    Examples
    --------
    >>> quantile_interval(np.arange(10.0), 0.5, 0.95)
    (1.0, 8.0)
    """
    ordered = np.sort(values)
    low, high = quantile_ranks(len(values), quantile, confidence)
    return (
        float(ordered[low]) if low >= 0 else np.nan,
        float(ordered[high]) if high < len(ordered) else np.nan,
    )


@functools.lru_cache
def quantile_ranks(count: int, quantile: float, confidence: float) -> tuple[int, int]:
    """Ranks from 0 of the order statistics at both ends; -1 and `count` if there is none."""
    tails = np.array([(1.0 - confidence) / 2, (1.0 + confidence) / 2])
    first = np.ceil(special.bdtrik(tails, count, quantile))  # may be one too great
    before = np.maximum(first - 1, 0)
    low, high = np.where(special.bdtr(before, count, quantile) >= tails, before, first)
    return int(low) - 1, int(high)


def mean_interval(
    values: Values, confidence: float, units: Int[np.ndarray, " n"] | None = None
) -> Ends:
    """`student_interval` of the mean of lanes.

    `units` are the independent units of the lanes, None if the lanes are independent.
    """
    if units is None:
        return student_interval(values, values, np.ones(len(values)), confidence)
    _, number, counts = np.unique(units, return_inverse=True, return_counts=True)
    return student_interval(values, np.bincount(number, values), counts.astype(float), confidence)


def student_interval(values: Values, sums: UnitSums, counts: UnitSums, confidence: float) -> Ends:
    """Student's interval of the mean of all numbers, from independent sums of `counts` each.

    The interval is not-a-number unless n ≥ 28 + 25 G², G being the skewness of the n `values`. The
    factor 1 + G² (t⁴ + 2t² - 3)/(18n) is Edgeworth's first term for G (Hall, 1992, section 2.6).
    The mean of clustered values goes in steps of gap/n: half a step corrects for continuity.
    """
    lanes, units, size = len(values), len(sums), np.abs(values).max(initial=0)
    if lanes < LEAST_LANES or not np.isfinite(size) or np.ptp(values) <= ROUNDING_SPREAD * size:
        return UNKNOWN
    apart = np.sort(values / size)
    gap = np.diff(apart).max()
    apart -= apart.mean()
    skewed = (np.mean(apart**3) / np.mean(apart**2) ** 1.5) ** 2
    if lanes < LEAST_LANES + LANES_PER_SKEWNESS * skewed:
        return UNKNOWN
    mean = (sums / size).sum() / counts.sum()
    squares = np.square(sums / size - mean * counts).sum() * units / (units - 1)
    t = special.stdtrit(units - 1, (1 + confidence) / 2)
    half = t * np.sqrt(squares) / counts.sum() * (1 + skewed * (t**4 + 2 * t**2 - 3) / (18 * lanes))
    half += gap / (2 * lanes)
    return float(size * (mean - half)), float(size * (mean + half))


def paired_share_interval(up: int, down: int, pairs: int, confidence: float) -> Ends:
    """Interval of the difference of two shares over pairs, `up` and `down` of which changed sides.

    The difference is ψ (2π - 1): ψ is the share of pairs that changed, π the share of these that
    went up. Both have their exact interval. The interval leaves out 0 exactly where McNemar's exact
    test does.
    """
    changed = up + down
    low, high = clopper_pearson(np.array([up, changed]), np.array([changed, pairs]), confidence)
    upwards, moved = (2 * np.array([low[0], high[0]]) - 1), np.array([low[1], high[1]])
    ends = np.outer(upwards, moved)
    return float(ends.min()), float(ends.max())
