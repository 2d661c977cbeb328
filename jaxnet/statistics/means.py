"""Interval of the mean of bounded numbers, valid even if most of the numbers are 0.

Let z be n numbers of at most `most`, and `most` itself, and let D be uniform over the n + 1 weights that sum
to 1. The upper end is the 1 − α/2 quantile of Σ D_i z_i; the lower end is its mirror image (Gaffke, 2005;
Learned-Miller and Thomas, 2020). For numbers with two values this is the exact interval of Clopper and
Pearson. For other numbers a proof is missing, and no counterexample is known. Without a bound no interval
holds for all distributions: an end without a bound is not-a-number.

D is proportional to independent exponential numbers e, so P(Σ D_i z_i ≥ t) = P(Σ e_i (z_i − t) ≥ 0). The
saddlepoint approximation (Barndorff-Nielsen, 1986) gives that probability to four digits.
"""

from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import special
from scipy.optimize import brentq

Terms = Float[np.ndarray, " n"]

QUANTILE_PRECISION = (
    1e-12  # of the mean gap to the bound: precision of a quantile, and its least gap
)
LEAST_ROOT = 1e-6  # smaller saddlepoint roots are 0


def mean_interval(
    sums: Terms, least: float, most: float, confidence: float, counts: Terms | None = None
) -> tuple[float, float]:
    """Both ends of the interval of the mean of independent numbers between `least` and `most`.

    An end is not-a-number where its bound is infinite, where a number is not finite, or where there is none.

    Parameters
    ----------
    sums
        The numbers, or sums of `counts` numbers each. Sums are independent; numbers within one need not be.
    least, most
        Bounds of the numbers. A number outside takes the bound's place.
    counts
        How many numbers each sum has, none of them 0. The mean is that of all numbers.

    Examples
    --------
    >>> low, high = mean_interval(np.array([1.0] * 3 + [0.0] * 27), 0.0, 1.0, 0.95)
    >>> print(f"{low:.3f} {high:.3f}")
    0.021 0.265
    """
    counts = np.ones(len(sums)) if counts is None else counts
    if not len(sums) or not np.isfinite(sums).all():
        return np.nan, np.nan
    return 0.0 - upper_end(-sums, counts, -least, confidence), upper_end(
        sums, counts, most, confidence
    )


def upper_end(sums: Terms, counts: Terms, most: float, confidence: float) -> float:
    """Return the upper end of the interval; not-a-number without a bound."""
    most, size = max(most, (sums / counts).max()), max(abs(most), np.abs(sums / counts).max())
    if not 0 < size < np.inf:
        return np.nan if size else 0.0
    gaps, weights = (
        np.append(most / size * counts - sums / size, 0.0),
        np.append(counts, counts.max()),
    )
    if not gaps.any():
        return float(most)
    middle = gaps.sum() / weights.sum()
    wanted = special.ndtri((1 + confidence) / 2)
    gap: Any = brentq(
        lambda gap: saddlepoint_quantile(gap * weights - gaps) - wanted,
        QUANTILE_PRECISION * middle,
        middle,
        xtol=QUANTILE_PRECISION * middle,
    )
    return float(size * (most / size - gap))


def saddlepoint_quantile(terms: Terms) -> float:
    """Return the normal quantile of P(Σ e_i c_i < 0) for terms c.

    The sum of the terms is not positive, and one term is positive.
    """
    terms = terms / terms.max()
    if terms.sum() >= 0:
        return 0.0
    tilt: Any = brentq(lambda s: ((1 - s) * terms / (1 - s * terms)).sum(), 0.0, 1.0 - 1e-15)
    tilted = terms / (1 - tilt * terms)
    likelihood_root = np.sqrt(2 * np.log1p(-tilt * terms).sum())
    if likelihood_root < LEAST_ROOT:
        return 0.0
    correction = np.log(tilt * np.sqrt(np.square(tilted).sum()) / likelihood_root)
    return likelihood_root + correction / likelihood_root
