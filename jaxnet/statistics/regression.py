"""Regression of errors on magnitudes: least squares, quantile regression (pinball loss), and the envelope.

Each estimator minimises Σ_j G_j(u_j) over the curves u of `families`. G_j collects the errors per ā,
r_js = y_js/x_j, at magnitude x_j, each with its sample's weight n_s:

    least squares  G_j(u) = Σ_s n_s (r_js − u)²/2            of y with weights 1/x²
    pinball        G_j(u) = Σ_s n_s ρ_q(r_js − u)            of y with weights 1/x; ρ_q(r) = r (q − 1[r < 0])
    envelope       G_j(u) = Σ_s n_s u where u ≥ max_s r_js   the limit of pinball as q → 1: its "quantile 1"

For many lanes, neighbours in the order of r_js share their mean weight, one bin at a time. At the edges of
bins this leaves Σ_{r ≤ u} n_s unchanged. Inside a bin of w lanes the error is at most √w/2 (standard
deviation). Resamples scatter by √(q (1 − q)) times the root of the number of lanes. Least squares use the
samples' own weights.

A loss gives the best scale for a given shape, and a line search finds the shape. The search interval contains
all minima. G_j falls down to its own minimiser m_j and rises from there, and two curves of a family cross
once. Consider a curve with more bend than all curves through two of the points (x_j, m_j). Less bend about
the crossing lowers the loss at every magnitude.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int, Shaped

from jaxnet.statistics.families import CURVE_FAMILIES, CurveFamily, Number, PerMagnitude

Index = Int[Array, ""]
Ranks = Int[Array, " j"]
Bracket = tuple[Number, Number, Ranks, Ranks]  # of a scale, with the ranks of both curves

STRIDES = 64  # of the grid from the least candidate shape to the greatest


class Effort(NamedTuple):
    """Precision of the search for a minimum."""

    stride: Index | int  # STRIDES between shapes of the first grid; there may be several minima
    shapes: Index | int  # halvings of the best shape's bracket
    scales: Index | int  # halvings of the best scale's bracket, for each shape


class Data(NamedTuple):
    """Errors per ā by magnitude, ascending, in bins of lanes; infinite where there is no ok lane."""

    x: Float[Any, " j"]
    ratios: Float[Any, "j bins lanes"]
    sums: Float[Any, "j bins lanes+1"]  # cumulative sums of each bin's ratios


class Best(NamedTuple):
    """The best scale for some offset and growth."""

    scale: Number
    loss: Number
    pull: PerMagnitude  # a multiple of the subgradients G_j' with Σ_j G_j'·growth_j = 0


class FitLoss(NamedTuple):
    """The loss Σ_j G_j(u_j) to be minimised."""

    weights: PerMagnitude
    least: PerMagnitude  # minimisers m_j of the G_j
    best: Callable[[PerMagnitude, PerMagnitude], Best]  # of offset and growth


def squared_loss(weights: PerMagnitude, means: PerMagnitude) -> FitLoss:
    """Return the loss of least squares from weights and means.

    The constant Σ_s n_s (r_js − m_j)² is left out.
    """

    def best(offset: PerMagnitude, growth: PerMagnitude) -> Best:
        scale = jnp.sum(weights * growth * (means - offset)) / jnp.sum(weights * growth**2)
        residual = offset + scale * growth - means
        return Best(scale, jnp.sum(weights * residual**2) / 2, weights * residual)

    return FitLoss(weights, means, best)


class Cumulative(NamedTuple):
    """Cumulative weights of the ratios in ascending order, by magnitude; bins have a mean weight per lane."""

    data: Data
    mean: Float[Array, "j bins"]
    weight: Float[Array, "j edges"]  # [:, k] is the sum of the first k bins
    ratio: Float[Array, "j edges"]  # weighted ratios likewise

    def last_bin(self, rank: Ranks) -> Ranks:
        """Return the bin after the first `rank` ratios."""
        return jnp.minimum(rank // self.data.ratios.shape[2], self.mean.shape[1] - 1)

    def weight_of(self, rank: Ranks) -> PerMagnitude:
        """Return the weight of the first `rank` ratios."""
        last, width = self.last_bin(rank), self.data.ratios.shape[2]
        inside = (rank - last * width).astype(float)
        return take_column(self.weight, last) + take_column(self.mean, last) * inside

    def ratio_of(self, rank: Ranks) -> PerMagnitude:
        """Return the weighted sum of the first `rank` ratios."""
        last = self.last_bin(rank)
        inside = take_column(
            flatten_bins(self.data.sums), rank + last
        )  # a bin has one more sum than lanes
        return take_column(self.ratio, last) + take_column(self.mean, last) * inside

    def rank_at(self, wanted: PerMagnitude) -> Ranks:
        """Return the index of the first ratio at which the cumulative weight reaches `wanted`."""
        lanes = jnp.sum(jnp.isfinite(self.data.ratios), axis=2)
        last = jnp.sum(self.weight[:, 1:] < wanted[:, None], axis=1)
        last = jnp.minimum(last, self.mean.shape[1] - 1)
        missing = wanted - take_column(self.weight, last)
        further = jnp.ceil(
            missing / jnp.where(missing > 0, take_column(self.mean, last), 1.0)
        ).astype(int)
        first = last * self.data.ratios.shape[2]
        return first + jnp.clip(further, 1, jnp.maximum(take_column(lanes, last), 1)) - 1


def cumulate(data: Data, bins: Float[Array, "j bins"]) -> Cumulative:
    """Return the cumulative weights for weights of bins."""
    lanes = jnp.sum(jnp.isfinite(data.ratios), axis=2)
    mean = bins / jnp.maximum(lanes, 1).astype(float)
    weight, ratio = (
        jnp.pad(jnp.cumsum(each, axis=1), ((0, 0), (1, 0)))
        for each in (bins, mean * data.sums[:, :, -1])
    )
    return Cumulative(data, mean, weight, ratio)


def pinball_loss(
    data: Data, bins: Float[Array, "j bins"], quantile: Number, halvings: Index | int
) -> FitLoss:
    """Return the loss of quantile regression.

    The best scale is a weighted quantile of (r_js − offset_j)/growth_j. The loss is `Σ_s n_s ρ_q(r_js − u) =
    q Σ_s n_s r_js + u (Σ_{r ≤ u} n_s − q Σ_s n_s) − Σ_{r ≤ u} n_s r_js`. The first term is left out: with a
    few large errors it would swamp the differences between many small ones. The envelope is a convex program
    in (b, s) and (log c, p).
    """
    ratios, cumulative = flatten_bins(data.ratios), cumulate(data, bins)
    weights = cumulative.weight[:, -1]
    wanted = quantile * weights
    first = cumulative.rank_at(wanted)
    least = take_column(ratios, first)

    def best(offset: PerMagnitude, growth: PerMagnitude) -> Best:
        own = (least - offset) / growth

        def rank_of(scale: Number) -> Ranks:
            return ranks(ratios, offset + scale * growth)

        def halve(_: Index, bracket: Bracket) -> Bracket:
            low, high, under, over = bracket
            between = (own > low) & (own < high) & (weights > 0)
            scale = jnp.mean(own, where=between | ~between.any())
            scale = jnp.where(between.any(), scale, (low + high) / 2)
            rank = rank_of(scale)
            short = jnp.sum(growth * (cumulative.weight_of(rank) - wanted)) < 0
            return (
                jnp.where(short, scale, low),
                jnp.where(short, high, scale),
                jnp.where(short, rank, under),
                jnp.where(short, over, rank),
            )

        known = weights > 0
        low, high = (
            jnp.min(own, initial=jnp.inf, where=known),
            jnp.max(own, initial=-jnp.inf, where=known),
        )
        begin = low, high, jnp.minimum(rank_of(low), first), jnp.maximum(rank_of(high), first + 1)
        low, high, under, over = lax.fori_loop(0, halvings, halve, begin)
        falling, rising = (cumulative.weight_of(rank) - wanted for rank in (under, over))
        rising = jnp.where(quantile < 1, rising, weights)
        short, long = -jnp.sum(growth * falling), jnp.sum(growth * rising)
        share = jnp.where(short > 0, long / short, 0.0)  # of falling that balances rising
        scale = jnp.where(quantile < 1, low + (high - low) / (1 + share), high)
        u = offset + scale * growth
        loss = jnp.where(quantile < 1, u * falling - cumulative.ratio_of(under), u * weights)
        return Best(scale, jnp.sum(loss), rising + share * falling)

    return FitLoss(weights, least, best)


def flatten_bins(bins: Float[Array, "j bins lanes"]) -> Float[Array, "j n"]:
    """Return the ratios of each magnitude without bins."""
    return bins.reshape(len(bins), -1)


def ranks(ratios: Float[Array, "j s"], u: PerMagnitude) -> Ranks:
    """Return the number of ratios of each magnitude that are at most u, by bisection."""
    width = ratios.shape[1]
    bits = width.bit_length()

    def step(number: Index, rank: Ranks) -> Ranks:
        further = rank + (1 << (bits - 1 - number))
        reached = take_column(ratios, jnp.minimum(further, width) - 1) <= u
        return jnp.where((further <= width) & reached, further, rank)

    return lax.fori_loop(0, bits, step, jnp.zeros(u.shape, int))


def take_column(table: Shaped[Array, "j n"], column: Ranks) -> Shaped[Array, " j"]:
    """Return one column of each row."""
    return jnp.take_along_axis(table, column[:, None], axis=1, mode="promise_in_bounds")[:, 0]


class ShapeSearch(NamedTuple):
    """A bracket of the best shape, the least loss of the grid, and the last evaluation."""

    low: Number
    high: Number
    loss: Number
    shape: Number
    scale: Number


def fit_curves(
    x: PerMagnitude, loss: FitLoss, effort: Effort, models: tuple[str, ...]
) -> dict[str, Float[Array, " parameters"]]:
    """Return the parameters of the best curve of some models."""
    straight = loss.best(jnp.zeros_like(x), jnp.ones_like(x)).scale
    curves = [CURVE_FAMILIES[model] for model in models if model in CURVE_FAMILIES]
    if not curves:
        return {"proportional": straight[None]}
    found = jax.vmap(lambda kind: search_shape(curves, kind, x, loss, effort))(
        jnp.arange(len(curves))
    )
    ends = zip(curves, found.shape, found.scale, strict=True)
    read = [jnp.stack(curve.read(x, shape, scale)) for curve, shape, scale in ends]
    return dict(zip(models, [straight[None], *read], strict=True))


def search_shape(
    curves: list[CurveFamily], kind: Index, x: PerMagnitude, loss: FitLoss, effort: Effort
) -> ShapeSearch:
    """Return the best shape and its bracket.

    The search takes the lowest shape of a grid and bisects between its neighbours by the sign of the slope.
    If all slopes point to an end of the bracket, that end is the result.
    """
    every = candidate_shapes(curves, kind, x, loss)
    on_grid = jnp.arange(STRIDES + 1) % effort.stride == 0
    first = STRIDES // effort.stride - 1
    last = first + effort.shapes

    def step(number: Index, search: ShapeSearch) -> ShapeSearch:
        in_row = number < first
        middle = (search.low + search.high) / 2
        end = jnp.where(search.low == every[0], every[0], middle)
        end = jnp.where(search.high == every[-1], every[-1], end)
        in_turn = every[jnp.minimum((number + 1) * effort.stride, STRIDES)]
        shape = jnp.where(in_row, in_turn, jnp.where(number < last, middle, end))
        best, slope = evaluate_shape(curves, kind, x, loss, shape)
        lowest = in_row & (best.loss < search.loss)
        below = jnp.max(every, initial=every[0], where=on_grid & (every < shape))
        above = jnp.min(every, initial=every[-1], where=on_grid & (every > shape))
        return ShapeSearch(
            jnp.where(lowest, below, jnp.where(in_row | (slope > 0), search.low, shape)),
            jnp.where(lowest, above, jnp.where(in_row | (slope < 0), search.high, shape)),
            jnp.where(lowest, best.loss, search.loss),
            shape,
            best.scale,
        )

    begin = ShapeSearch(every[0], every[-1], jnp.full_like(every[0], jnp.inf), every[0], every[0])
    return lax.fori_loop(0, last + 1, step, begin)


def candidate_shapes(
    curves: list[CurveFamily], kind: Index, x: PerMagnitude, loss: FitLoss
) -> Float[Array, " shapes"]:
    """Return STRIDES + 1 quantiles of the shapes of curves through two minimisers; 0 if there are none.

    Quantiles are robust: shapes from two close magnitudes scatter a thousand times more than the others.
    """
    pairs = np.triu_indices(len(x), 1)
    known = jnp.all(loss.weights[jnp.stack(pairs)] > 0, axis=0)
    through = lax.switch(kind, [curve.through for curve in curves], x, loss.least)[pairs]
    greatest = jnp.max(through, initial=-jnp.inf, where=known)
    ascending = jnp.sort(jnp.where(known, through, greatest))
    last = jnp.maximum(jnp.sum(known) - 1, 0).astype(float)
    quantiles = jnp.interp(
        last * jnp.linspace(0, 1, STRIDES + 1), jnp.arange(len(ascending), dtype=float), ascending
    )
    return jnp.where(known.any(), quantiles, 0.0)


def evaluate_shape(
    curves: list[CurveFamily], kind: Index, x: PerMagnitude, loss: FitLoss, shape: Number
) -> tuple[Best, Number]:
    """Return the best scale for a shape, and a multiple of the derivative of its loss in the shape."""

    def bent(shape: Number) -> tuple[PerMagnitude, PerMagnitude]:
        return lax.switch(kind, [curve.bent for curve in curves], x, shape)

    (offset, growth), (offset_bends, growth_bends) = jax.jvp(
        bent, (shape,), (jnp.ones_like(shape),)
    )
    best = loss.best(offset, growth)
    return best, jnp.sum(best.pull * (offset_bends + best.scale * growth_bends))


@functools.partial(jax.jit, static_argnames="models")
def least_squares(
    x: PerMagnitude,
    weights: Float[Array, "n j"],
    means: Float[Array, "n j"],
    effort: Effort,
    models: tuple[str, ...],
) -> dict[str, Float[Array, "n parameters"]]:
    """Return the parameters of some models by least squares, per row of weights and weighted means.

    The proportional model is the first.
    """
    return jax.vmap(lambda *row: fit_curves(x, squared_loss(*row), effort, models))(weights, means)


@functools.partial(jax.jit, static_argnames="models")
def quantile_regression(
    data: Data,
    bins: Float[Array, "n j bins"],
    quantiles: Float[Array, " q"],
    effort: Effort,
    models: tuple[str, ...],
) -> dict[str, Float[Array, "q n parameters"]]:
    """Return the parameters of some models at quantiles up to 1, per row of bin weights."""

    def one(
        quantile: Number, bins: Float[Array, "j bins"]
    ) -> dict[str, Float[Array, " parameters"]]:
        return fit_curves(data.x, pinball_loss(data, bins, quantile, effort.scales), effort, models)

    return jax.vmap(jax.vmap(one, (None, 0)), (0, None))(quantiles, bins)
