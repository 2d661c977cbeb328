"""Curves of errors over magnitudes by least squares with weights 1/x².

A model f(x) of errors y is fitted as u(x) = f(x)/x to the errors per ā, y/x. Only the mean and the
number of lanes at each magnitude count.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

MODELS = {"proportional": ("s",), "affine": ("b", "s"), "power": ("c", "p")}
STEEPEST = 100.0  # greatest power of x over its whole range: far beyond data, without overflow
GRID = np.linspace(0, 1, 33)  # of the powers through pairs of magnitudes
GOLDEN, SECTIONS = (np.sqrt(5) - 1) / 2, 64

Magnitudes = Float[np.ndarray, " j"]
PerFit = Float[np.ndarray, "n j"]  # a row per fit, a column per magnitude
Parameters = Float[np.ndarray, "n 2"]
Shapes = Float[np.ndarray, " n"]


def model_value(model: str, x: Magnitudes, parameters: Sequence[float] | np.ndarray) -> Magnitudes:
    """`s x`, `b + s x`, `c x^p`, or a constant."""
    first, *more = parameters
    match model:
        case "power":
            return first * x ** more[0]
        case "affine":
            return first + more[0] * x
        case "constant":
            return np.full_like(x, first)
    return first * x


@np.errstate(invalid="ignore")  # lanes at one magnitude alone
def affine(x: Magnitudes, means: PerFit, weights: PerFit) -> Parameters:
    """`b` and `s` of u = s + b/x by the normal equations."""
    steps, total = x.min() / x, weights.sum(axis=1)
    centre, level = (weights @ steps) / total, (weights * means).sum(axis=1) / total
    apart = steps - centre[:, None]
    rise = (weights * apart * (means - level[:, None])).sum(axis=1)
    rise /= (weights * apart**2).sum(axis=1)
    return np.stack([rise * x.min(), level - rise * centre], axis=1)


@np.errstate(all="ignore")  # of the greatest numbers, and of errors of 0
def power(x: Magnitudes, means: PerFit, weights: PerFit) -> Parameters:
    """`c` and `p` of u = c x^(p - 1): c is known for each p, the best p is looked for.

    It is looked for between the powers through pairs of magnitudes: on a grid by rank, then by
    golden section.
    """
    ends = np.log(x.min()), np.log(x.max())
    logs, steepest = np.log(x) - sum(ends) / 2, STEEPEST / ((ends[1] - ends[0]) or 1.0)
    first, second = np.triu_indices(len(x), 1)
    rises = np.log(np.where(weights > 0, means, np.nan))
    pairs = (rises[:, first] - rises[:, second]) / (logs[first] - logs[second])
    known = np.isfinite(pairs).any(axis=1, keepdims=True)
    pairs = np.clip(np.where(known, pairs, 0.0), -steepest, steepest)

    def fitted(shape: Shapes) -> tuple[Shapes, Shapes]:
        growth = np.exp(shape[:, None] * logs)
        scale = (weights * means * growth).sum(axis=1) / (weights * growth**2).sum(axis=1)
        return scale, (weights * (scale[:, None] * growth - means) ** 2).sum(axis=1)

    shapes = np.nanquantile(pairs, GRID, axis=1)
    rows, best = (
        np.arange(len(means)),
        np.array([fitted(each)[1] for each in shapes]).argmin(axis=0),
    )
    low, high = (
        shapes[np.maximum(best - 1, 0), rows],
        shapes[np.minimum(best + 1, len(GRID) - 1), rows],
    )
    for _ in range(SECTIONS):
        left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        leftwards = fitted(left)[1] < fitted(right)[1]
        low, high = np.where(leftwards, low, left), np.where(leftwards, right, high)
    shape = (low + high) / 2
    return np.stack([fitted(shape)[0] * np.exp(-shape * sum(ends) / 2), 1 + shape], axis=1)
