"""The best curve through errors of samples at magnitudes: least squares, pinball, envelope.

All of it minimises Σ_j G_j(u_j) over the curves u of `curves`, where G_j collects the errors per ā,
r_js = y_js/x_j, at magnitude x_j, each with its sample's weight n_s:

    least squares  G_j(u) = Σ_s n_s (r_js − u)²/2            of y with weights 1/x²
    pinball        G_j(u) = Σ_s n_s ρ_q(r_js − u)            of y with weights 1/x; ρ_q(r) = r (q − 1[r < 0])
    envelope       G_j(u) = Σ_s n_s u where u ≥ max_s r_js   what pinball comes to as q → 1: its "quantile 1"

A loss tells the best scale for a given shape, and the shape is searched along one line. Where it is searched
no minimum is lost: G_j falls down to its own minimiser m_j and rises from there, and two curves of a family
cross once; so a curve bent more than all those through two of the points (x_j, m_j) gains at every magnitude
when it is bent less, about the place where it crosses them.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jaxnet.study.curves import BENT, Curve, Number, Values

Index = Int[Array, ""]

STRIDES = 64  # from the least shape that may be best to the greatest


class Effort(NamedTuple):
    """How closely a minimum is sought."""

    stride: Index | int  # a shape is looked at every so many STRIDES first, for there may be several minima
    shapes: Index | int  # halvings of the bracket of the best shape then
    scales: Index | int  # halvings of the bracket of the best scale for a shape


class Data(NamedTuple):
    """Errors per ā by magnitude, ascending, and whose they are; inf where a lane failed."""

    x: Float[Any, " j"]
    ratios: Float[Any, "j s"]
    sample: Int[Any, "j s"]


class Best(NamedTuple):
    """The best scale for some offset and growth."""

    scale: Number
    loss: Number
    pull: Values  # a multiple of the G_j' with Σ_j G_j'·growth_j = 0, of the subgradients one


class Loss(NamedTuple):
    """What is minimised."""

    weights: Values
    least: Values  # minimisers m_j of the G_j
    best: Callable[[Values, Values], Best]  # of offset and growth


def squares(data: Data, samples: Float[Array, " s"]) -> Loss:
    """Least squares, which see of the data the weights and the means; Σ_s n_s (r_js − m_j)² is left out."""
    weight, ratio = weighted(data, samples)
    weights = jnp.sum(weight, axis=1)
    means = jnp.sum(ratio, axis=1) / jnp.maximum(weights, 1.0)

    def best(offset: Values, growth: Values) -> Best:
        scale = jnp.sum(weights * growth * (means - offset)) / jnp.sum(weights * growth**2)
        residual = offset + scale * growth - means
        return Best(scale, jnp.sum(weights * residual**2) / 2, weights * residual)

    return Loss(weights, means, best)


def pinball(data: Data, samples: Float[Array, " s"], quantile: Number, halvings: Index | int) -> Loss:
    """Quantile regression; the best scale is a weighted quantile of (r_js − offset_j)/growth_j.

    Of `Σ_s n_s ρ_q(r_js − u) = q Σ_s n_s r_js + u (Σ_{r ≤ u} n_s − q Σ_s n_s) − Σ_{r ≤ u} n_s r_js` the
    first term is left out: beside a few great errors it would drown what many small ones differ by. The
    envelope is a convex program in (b, s), (log c, p) and (1/c, 1/(c a0)).
    """
    # Weights and weighted ratios up to a rank: [:, k] is the sum of the k least.
    weight, ratio = (jnp.pad(jnp.cumsum(w, axis=1), ((0, 0), (1, 0))) for w in weighted(data, samples))
    weights = weight[:, -1]
    first = jnp.sum(weight[:, 1:] < quantile * weights[:, None], axis=1)
    least = at(data.ratios, jnp.minimum(first, data.ratios.shape[1] - 1))

    def best(offset: Values, growth: Values) -> Best:
        own = (least - offset) / growth

        def halve(_: Index, bracket: tuple[Number, Number]) -> tuple[Number, Number]:
            low, high = bracket
            between = (own > low) & (own < high) & (weights > 0)
            scale = jnp.mean(own, where=between | ~between.any())
            scale = jnp.where(between.any(), scale, (low + high) / 2)
            below = at(weight, ranks(data.ratios, offset + scale * growth))
            short = jnp.sum(growth * (below - quantile * weights)) < 0
            return jnp.where(short, scale, low), jnp.where(short, high, scale)

        there = weights > 0
        ends = jnp.min(own, initial=jnp.inf, where=there), jnp.max(own, initial=-jnp.inf, where=there)
        low, high = lax.fori_loop(0, halvings, halve, ends)
        under, over = (ranks(data.ratios, offset + scale * growth) for scale in (low, high))
        falling, rising = (at(weight, rank) - quantile * weights for rank in (under, over))
        rising = jnp.where(quantile < 1, rising, weights)
        short, long = -jnp.sum(growth * falling), jnp.sum(growth * rising)
        share = jnp.where(short > 0, long / short, 0.0)  # of falling that holds rising in balance
        scale = jnp.where(quantile < 1, low + (high - low) / (1 + share), high)
        u = offset + scale * growth
        loss = jnp.where(quantile < 1, u * falling - at(ratio, under), u * weights)
        return Best(scale, jnp.sum(loss), rising + share * falling)

    return Loss(weights, least, best)


def weighted(data: Data, samples: Float[Array, " s"]) -> tuple[Float[Array, "j s"], Float[Array, "j s"]]:
    """Weights of the ratios, and weighted ratios; 0 where a lane failed."""
    there = jnp.isfinite(data.ratios)
    weight = jnp.where(there, samples[data.sample], 0.0)
    return weight, weight * jnp.where(there, data.ratios, 0.0)


def ranks(ratios: Float[Array, "j s"], u: Values) -> Int[Array, " j"]:
    """How many ratios of each magnitude are at most u; twice as fast here as `jnp.searchsorted`."""
    width = ratios.shape[1]
    rank = jnp.zeros(u.shape, int)
    for bit in reversed(range(width.bit_length())):
        further = rank + (1 << bit)
        reached = at(ratios, jnp.minimum(further, width) - 1) <= u
        rank = jnp.where((further <= width) & reached, further, rank)
    return rank


def at(table: Float[Array, "j n"], column: Int[Array, " j"]) -> Values:
    """One column of each row."""
    return jnp.take_along_axis(table, column[:, None], axis=1, mode="promise_in_bounds")[:, 0]


class Search(NamedTuple):
    """A bracket of the best shape, the lowest loss of a row, and where the search looked last."""

    low: Number
    high: Number
    loss: Number
    shape: Number
    scale: Number


def fitted(
    data: Data, loss: Loss, effort: Effort, models: tuple[str, ...]
) -> dict[str, Float[Array, " parameters"]]:
    """Parameters of the best curve of some models."""
    straight = loss.best(jnp.zeros_like(data.x), jnp.ones_like(data.x)).scale
    curves = [BENT[model] for model in models if model in BENT]
    if not curves:
        return {"proportional": straight[None]}
    found = jax.vmap(lambda kind: search(curves, kind, data.x, loss, effort))(jnp.arange(len(curves)))
    ends = zip(curves, found.shape, found.scale, strict=True)
    read = [jnp.stack(curve.read(data.x, shape, scale)) for curve, shape, scale in ends]
    return dict(zip(models, [straight[None], *read], strict=True))


def search(curves: list[Curve], kind: Index, x: Values, loss: Loss, effort: Effort) -> Search:
    """The best shape: the lowest of a row, then halved by the sign of the slope between its neighbours.

    Where all slopes point to an end of the bracket, that end is the answer.
    """
    every = shapes(curves, kind, x, loss)
    looked_at = jnp.arange(STRIDES + 1) % effort.stride == 0
    first = STRIDES // effort.stride - 1
    last = first + effort.shapes

    def step(number: Index, search: Search) -> Search:
        in_row = number < first
        middle = (search.low + search.high) / 2
        end = jnp.where(search.low == every[0], every[0], middle)
        end = jnp.where(search.high == every[-1], every[-1], end)
        in_turn = every[jnp.minimum((number + 1) * effort.stride, STRIDES)]
        shape = jnp.where(in_row, in_turn, jnp.where(number < last, middle, end))
        best, slope = look(curves, kind, x, loss, shape)
        lowest = in_row & (best.loss < search.loss)
        below = jnp.max(every, initial=every[0], where=looked_at & (every < shape))
        above = jnp.min(every, initial=every[-1], where=looked_at & (every > shape))
        return Search(
            jnp.where(lowest, below, jnp.where(in_row | (slope > 0), search.low, shape)),
            jnp.where(lowest, above, jnp.where(in_row | (slope < 0), search.high, shape)),
            jnp.where(lowest, best.loss, search.loss),
            shape,
            best.scale,
        )

    begin = Search(every[0], every[-1], jnp.full_like(every[0], jnp.inf), every[0], every[0])
    return lax.fori_loop(0, last + 1, step, begin)


def shapes(curves: list[Curve], kind: Index, x: Values, loss: Loss) -> Float[Array, " shapes"]:
    """Shapes of the curves through two minimisers: STRIDES quantiles, from the least; 0 if there are none.

    Quantiles, for what two near magnitudes tell of a shape scatters a thousand times as far as the rest.
    """
    pairs = np.triu_indices(len(x), 1)
    there = jnp.all(loss.weights[jnp.stack(pairs)] > 0, axis=0)
    through = lax.switch(kind, [curve.through for curve in curves], x, loss.least)[pairs]
    greatest = jnp.max(through, initial=-jnp.inf, where=there)
    ascending = jnp.sort(jnp.where(there, through, greatest))
    last = jnp.maximum(jnp.sum(there) - 1, 0).astype(float)
    quantiles = jnp.interp(
        last * jnp.linspace(0, 1, STRIDES + 1), jnp.arange(len(ascending), dtype=float), ascending
    )
    return jnp.where(there.any(), quantiles, 0.0)


def look(curves: list[Curve], kind: Index, x: Values, loss: Loss, shape: Number) -> tuple[Best, Number]:
    """The best scale for a shape, and a multiple of the slope of its loss with the shape."""

    def bent(shape: Number) -> tuple[Values, Values]:
        return lax.switch(kind, [curve.bent for curve in curves], x, shape)

    (offset, growth), (offset_bends, growth_bends) = jax.jvp(bent, (shape,), (jnp.ones_like(shape),))
    best = loss.best(offset, growth)
    return best, jnp.sum(best.pull * (offset_bends + best.scale * growth_bends))


@functools.partial(jax.jit, static_argnames="models")
def least_squares(
    data: Data, samples: Float[Array, "n s"], effort: Effort, models: tuple[str, ...]
) -> dict[str, Float[Array, "n parameters"]]:
    """Parameters of some models, the proportional one first, for each row of weights of the samples."""
    return jax.vmap(lambda samples: fitted(data, squares(data, samples), effort, models))(samples)


@functools.partial(jax.jit, static_argnames="models")
def quantile_regression(
    data: Data,
    samples: Float[Array, "n s"],
    quantile: Float[Array, " n"],
    effort: Effort,
    models: tuple[str, ...],
) -> dict[str, Float[Array, "n parameters"]]:
    """As `least_squares`, at quantiles up to 1."""

    def one(samples: Float[Array, " s"], quantile: Number) -> dict[str, Float[Array, " parameters"]]:
        return fitted(data, pinball(data, samples, quantile, effort.scales), effort, models)

    return jax.vmap(one)(samples, quantile)
