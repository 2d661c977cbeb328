"""Curves of errors over magnitudes: least squares, quantile regression, and the envelope.

A model f(x) of the errors is fitted as u(x) = f(x)/x to the errors per ā, r = y/x:

    least squares  Σ (r − u)²/2           of y with weights 1/x²
    quantile q     Σ ρ_q(r − u)           of y with weights 1/x; ρ_q(r) = r (q − 1[r < 0])
    envelope       Σ u where u ≥ r        the limit of q → 1: its "quantile 1"

Every model is u = offset + scale·growth, bent by a number called shape. For a given shape the best
scale is known. The best shape is looked for on a grid between curves through two magnitudes each,
and then by golden section.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

MODELS = {"proportional": ("s",), "affine": ("b", "s"), "power": ("c", "p")}
ENVELOPE = 1.0
STEEPEST = 100.0  # greatest |shape| of a power: far beyond data, and without overflow
GRID = np.linspace(0, 1, 33)  # of the shapes through pairs of magnitudes
GOLDEN, SECTIONS = (np.sqrt(5) - 1) / 2, 64
MOST_BINS = 4096  # of one magnitude; with more lanes, neighbours share their mean

PerFit = Float[np.ndarray, "n j"]  # a row per fit, a column per magnitude
Shapes = Float[np.ndarray, " n"]
# best scale and its loss, of offset and growth
FitLoss = Callable[[PerFit, PerFit], tuple[Shapes, Shapes]]


class Errors(NamedTuple):
    """Errors [m] at magnitudes x > 0, by sample; not-a-number where a lane failed."""

    x: Float[np.ndarray, " j"]
    y: Float[np.ndarray, "j samples"]

    @property
    def ratios(self) -> Float[np.ndarray, "j samples"]:
        return self.y / self.x[:, None]

    @property
    def models(self) -> tuple[str, ...]:
        """Models with at most as many parameters as there are magnitudes."""
        known = np.isfinite(self.y).any(axis=1).sum()
        return tuple(model for model, names in MODELS.items() if len(names) <= known)


def model_value(model: str, x: Float[np.ndarray, " n"], parameters: object) -> np.ndarray:
    """Evaluate a model by name: s x, b + s x, c x^p, or a constant."""
    first, second = (*np.atleast_1d(np.asarray(parameters, float)), 0.0)[:2]
    match model:
        case "power":
            return first * x**second
        case "affine":
            return first + second * x
        case "constant":
            return np.full_like(x, first)
    return first * x


def least_squares(errors: Errors, counts: Int[np.ndarray, "n samples"]) -> dict[str, np.ndarray]:
    """Parameters of all models by least squares, for each row of the samples' counts."""
    ratios, finite = errors.ratios, np.isfinite(errors.y)
    weights = counts @ finite.T.astype(float)
    with np.errstate(invalid="ignore"):  # a magnitude without a lane
        means = (counts @ np.where(finite, ratios, 0.0).T) / weights
    means = np.where(weights > 0, means, 0.0)

    def loss(offset: PerFit, growth: PerFit) -> tuple[Shapes, Shapes]:
        squares = (weights * growth**2).sum(axis=1)
        scale = ((means - offset) * weights * growth).sum(axis=1) / squares
        apart = offset + scale[:, None] * growth - means
        return scale, (weights * apart**2).sum(axis=1)

    found = fitted(errors, loss, np.where(weights > 0, means, np.nan))
    if "affine" in found:
        found["affine"] = straight_line(errors.x, means, weights)
    return found


def straight_line(x: Float[np.ndarray, " j"], means: PerFit, weights: PerFit) -> np.ndarray:
    """Parameters b and s of u = s + b/x by the normal equations."""
    steps, total = x.min() / x, weights.sum(axis=1)
    centre, level = (weights @ steps) / total, (weights * means).sum(axis=1) / total
    apart = steps - centre[:, None]
    with np.errstate(invalid="ignore"):  # lanes at one magnitude alone
        rise = (weights * apart * (means - level[:, None])).sum(axis=1) / (weights * apart**2).sum(
            axis=1
        )
    return np.stack([rise * x.min(), level - rise * centre], axis=1)


def quantile_regression(errors: Errors, quantile: float) -> dict[str, np.ndarray]:
    """Parameters of all models at a quantile below 1, or of the envelope."""
    binned = [neighbours(np.sort(row[np.isfinite(row)])) for row in errors.ratios]
    place = np.repeat(np.arange(len(binned)), [len(means) for means, _ in binned])
    ratios, weights = (np.concatenate(each) for each in zip(*binned, strict=True))
    total = np.bincount(place, weights, len(binned))
    least = [quantile_at(means, counts, quantile) for means, counts in binned]

    def pinball(offset: PerFit, growth: PerFit) -> tuple[Shapes, Shapes]:
        steep = growth[0, place]
        scales = (ratios - offset[0, place]) / steep
        scale = quantile_at(scales, weights * steep, quantile)
        curve = offset + scale * growth
        below = scales <= scale
        # Without q Σ r: beside few large errors it would swamp differences between small ones.
        loss = (weights * (curve[0, place] - ratios))[below].sum() - quantile * (
            total * curve
        ).sum()
        return np.array([scale]), np.array([loss])

    def envelope(offset: PerFit, growth: PerFit) -> tuple[Shapes, Shapes]:
        known = total > 0
        scale = ((np.array(least) - offset) / growth)[:, known].max(axis=1)
        return scale, (total * (offset + scale[:, None] * growth)).sum(axis=1)

    loss = envelope if quantile == ENVELOPE else pinball
    return fitted(errors, loss, np.where(total > 0, least, np.nan)[None])


def neighbours(ordered: Float[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
    """Means of neighbours in an order, and how many lanes each stands for."""
    if len(ordered) <= MOST_BINS:
        return ordered, np.ones(len(ordered))
    starts = np.linspace(0, len(ordered), MOST_BINS, endpoint=False).astype(int)
    counts = np.diff(starts, append=len(ordered)).astype(float)
    return np.add.reduceat(ordered, starts) / counts, counts


def quantile_at(values: np.ndarray, weights: np.ndarray, quantile: float) -> float:
    """The least value at which the share of the weights reaches a quantile; 0 without a value."""
    if not len(values):
        return 0.0
    order = np.argsort(values, kind="stable")  # which is fast where rows are in order already
    reached = np.cumsum(weights[order])
    first = np.searchsorted(reached, quantile * reached[-1] * (1 - 1e-15))
    return float(values[order[min(first, len(values) - 1)]])


@np.errstate(over="ignore", invalid="ignore")  # of the greatest numbers
def fitted(errors: Errors, loss: FitLoss, minimisers: PerFit) -> dict[str, np.ndarray]:
    """Parameters of the errors' models that minimise a loss, a row per fit.

    `minimisers` are the best u of each magnitude alone, not-a-number without a lane.
    """
    x, ones = errors.x, np.ones_like(minimisers)
    straight, _ = loss(0 * ones, ones)
    found = {"proportional": straight[:, None]}
    for model in errors.models[1:]:
        curve = BENT_CURVES[model]

        def bent(shape: Shapes, curve: "BentCurve" = curve) -> tuple[PerFit, PerFit]:
            return curve.bent(x, shape[:, None])

        shape = least_shape(lambda shape: loss(*bent(shape))[1], curve.candidates(x, minimisers))
        scale, _ = loss(*bent(shape))
        found[model] = np.stack(curve.read(x, shape, scale), axis=1)
    return found


def least_shape(loss: Callable[[Shapes], Shapes], shapes: Float[np.ndarray, "n grid"]) -> Shapes:
    """The shape of the least loss on a grid, refined by golden section between its neighbours."""
    rows, last = np.arange(len(shapes)), shapes.shape[1] - 1
    best = np.stack([loss(each) for each in shapes.T]).argmin(axis=0)
    low = shapes[rows, np.maximum(best - 1, 0)]
    high = shapes[rows, np.minimum(best + 1, last)]
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = loss(left), loss(right)
    for _ in range(SECTIONS):
        leftwards = at_left < at_right
        low, high = np.where(leftwards, low, left), np.where(leftwards, right, high)
        inner = np.where(leftwards, high - GOLDEN * (high - low), low + GOLDEN * (high - low))
        at_inner = loss(inner)
        left, right = np.where(leftwards, inner, right), np.where(leftwards, left, inner)
        at_left, at_right = (
            np.where(leftwards, at_inner, at_right),
            np.where(leftwards, at_left, at_inner),
        )
    return (low + high) / 2


class BentCurve(NamedTuple):
    """A curve of curves u(x) = offset + scale·growth by their shape."""

    bent: Callable[[np.ndarray, np.ndarray], tuple[PerFit, PerFit]]  # offset and growth
    # shapes of the curves through pairs of points
    through: Callable[[np.ndarray, PerFit], np.ndarray]
    read: Callable[[np.ndarray, Shapes, Shapes], tuple[Shapes, Shapes]]  # parameters

    def candidates(self, x: np.ndarray, minimisers: PerFit) -> Float[np.ndarray, "n grid"]:
        """Shapes of curves through two magnitudes, evenly by rank; 0 if there are none."""
        with np.errstate(all="ignore"):
            ordered = np.sort(self.through(x, minimisers), axis=1)  # not-a-number last
        known = np.isfinite(ordered).sum(axis=1)
        ranks = GRID * np.maximum(known - 1, 0)[:, None]
        below = ranks.astype(int)
        above = np.minimum(below + 1, np.maximum(known - 1, 0)[:, None])
        rows = np.arange(len(ordered))[:, None]
        low, high = ordered[rows, below], ordered[rows, above]
        return np.where(known[:, None] > 0, low + (ranks - below) * (high - low), 0.0)


def pairs_apart(values: np.ndarray) -> np.ndarray:
    first, second = np.triu_indices(values.shape[-1], 1)
    return values[..., first] - values[..., second]


def log_range(x: np.ndarray) -> tuple[float, float]:
    """Centre and width of the range of log x; the width is 1 if all x are equal."""
    low, high = np.log(x.min()), np.log(x.max())
    return (low + high) / 2, (high - low) or 1.0


def power_bent(x: np.ndarray, shape: np.ndarray) -> tuple[PerFit, PerFit]:
    """Offset and growth of u ∝ x^(p − 1); growth is 1 at the geometric centre of x."""
    centre, width = log_range(x)
    growth = np.exp(-shape * (np.log(x) - centre) / width)
    return np.zeros_like(growth), growth


def power_through(x: np.ndarray, u: PerFit) -> np.ndarray:
    """Shapes of the powers through pairs of points; 0 (proportional) where both errors are 0."""
    shapes = -log_range(x)[1] * pairs_apart(np.log(u)) / pairs_apart(np.log(x))
    zeros = pairs_apart((u == 0).astype(float)) == 0
    shapes = np.where(np.isnan(shapes) & zeros & np.isfinite(pairs_apart(u)), 0.0, shapes)
    return np.clip(shapes, -STEEPEST, STEEPEST)


def power_read(x: np.ndarray, shape: Shapes, scale: Shapes) -> tuple[Shapes, Shapes]:
    centre, width = log_range(x)
    return scale * np.exp(shape / width * centre), 1 - shape / width


BENT_CURVES = {
    "affine": BentCurve(  # u = s + b/x, whose shape is b
        lambda x, shape: (shape / x, np.ones_like(shape / x)),
        lambda x, u: pairs_apart(u) / pairs_apart(1 / x),
        lambda x, shape, scale: (shape, scale),
    ),
    "power": BentCurve(power_bent, power_through, power_read),
}
