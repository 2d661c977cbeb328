"""Sobol's indices: the part of a variance that each group of random numbers contributes.

`first_i = mean(b (ab_i - a)) / var` and `total_i = mean((a - ab_i)²) / (2 var)` (Saltelli and
others, 2010). The values a and b are from independent draws. The values ab_i are from the draws of
a, but with group i from the draws of b. SciPy has these estimators for numbers of rows that are a
power of two. A failed lane breaks that condition. Intervals are bootstrap intervals as in `fits`.
They are blank if few rows make up the variance.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxnet.statistics.fits import draw_resamples, percentile_interval

LEAST_VARIATION = 1e-9  # of the greatest value and of 1 m; values with a smaller range are constant
RESAMPLES_AT_ONCE = 50  # evaluated side by side
FEWEST_ROWS = 30  # for an index
FEWEST_VARYING = 75  # rows that make up the variance, for an interval


class Indices(NamedTuple):
    """First-order (row 0) and total (row 1) indices of each group, with their 95 % intervals."""

    estimate: Float[np.ndarray, "2 groups"]
    low: Float[np.ndarray, "2 groups"]
    high: Float[np.ndarray, "2 groups"]


def sobol_indices(
    a: Float[np.ndarray, " rows"],
    b: Float[np.ndarray, " rows"],
    mixed: Float[np.ndarray, "groups rows"],
) -> Indices:
    """Return the indices from values at the draws a, b and ab_i.

    Indices are not-a-number for few rows and for constant values. Ends of intervals are also
    not-a-number if few rows make up the variance.
    """
    if len(a) < FEWEST_ROWS or not np.ptp([a, b]) > LEAST_VARIATION * max(1.0, np.abs(a).max()):
        return Indices(*np.full((3, 2, len(mixed)), np.nan))
    # squares of great values overflow
    size = np.abs(np.concatenate([a[None], b[None], mixed])).max()
    a, b, mixed = a / size, b / size, mixed / size
    centre = np.mean([a, b])
    a, b, mixed = a - centre, b - centre, mixed - centre
    terms = np.concatenate(
        [b * (mixed - a), (a - mixed) ** 2 / 2, [(a + b) / 2, (a**2 + b**2) / 2]]
    )

    def ratios(weights: Float[np.ndarray, "some rows"]) -> Float[np.ndarray, "some indices"]:
        means = weights @ terms.T / len(a)
        variance = (means[:, -1] - means[:, -2] ** 2)[:, None]
        # a resample of equal rows has no variance
        return means[:, :-2] / np.where(variance > 0, variance, np.nan)

    found = ratios(np.ones((1, len(a))))[0]
    blank = np.full_like(found, np.nan)
    if effective_rows(np.concatenate([a, b])) < 2 * FEWEST_VARYING:
        return Indices(*(each.reshape(2, -1) for each in (found, blank, blank)))
    resampled = np.concatenate(
        [ratios(counts.astype(float)) for counts in draw_resamples(len(a), RESAMPLES_AT_ONCE)]
    )
    found = found, *percentile_interval(resampled)
    return Indices(*(each.reshape(2, -1) for each in found))


def effective_rows(values: Float[np.ndarray, " n"]) -> float:
    """Number of values, with mean 0, that make up their variance: n over the kurtosis."""
    squares = np.square(values / np.abs(values).max())
    return float(squares.sum() ** 2 / np.square(squares).sum())
