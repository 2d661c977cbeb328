"""`L x = b` by iteration over links, for graphs that no order makes narrow; how far off it is, is known.

The iteration is van der Vorst's BiCGSTAB, for L is not symmetric and its spectrum not known beforehand. It
goes over slots, without a matrix, and starts anew where what is left of b is still too much.

L is an M-matrix: its inverse has no negative entry, so that `‖L⁻¹‖ = max L⁻¹ 1`. Any v with `L v > 0` bounds
that by `max v / min L v`, and with it what is left of b bounds the error: `‖x - L⁻¹ b‖ ≤ ‖L⁻¹‖ ‖b - L x‖`, in
the greatest component each. Every column of every axis and lane stops by itself where its error is small
enough, so that no number depends on those beside it.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxnet.model.hearing import AxisWeights, Hearing

ACCURACY = 1e-12  # of a solution, relative to its greatest component
LOOSEST = 1e-6  # what is less accurate is none
CERTIFICATE = 0.25  # how far `L v` may be from 1
STARTS = 8
ROUNDS = 4  # of a start, times m at most

Unknowns = Float[Array, "m columns axes lanes"]
Sizes = Float[Array, "columns axes lanes"]
Map = Callable[[Unknowns], Unknowns]
Allowance = Callable[[Sizes], Sizes]  # of what may be left of b, by the size of x
InverseBound = Float[Array, "axes lanes"]


def of_vehicles(hearing: Hearing, weights: AxisWeights) -> AxisWeights:
    """The weights of vehicles, 0 where the navigator is heard."""
    return jnp.where((jnp.asarray(hearing.carried_sources) > 0)[None, :, :, None], weights, 0.0)


def apply_laplacian(hearing: Hearing, weights: AxisWeights) -> Map:
    """L, from weights of vehicles alone."""
    carried_sources, heard = (
        jnp.maximum(jnp.asarray(hearing.carried_sources) - 1, 0),
        jnp.moveaxis(weights, 0, 2),
    )

    def times(x: Unknowns) -> Unknowns:
        def less(slot: Any, total: Any) -> Any:
            return total - heard[slot][:, None] * x.at[carried_sources[slot]].get(mode="promise_in_bounds")

        return jax.lax.fori_loop(0, len(carried_sources), less, x)

    return times


def inverse_bound(hearing: Hearing, weights: AxisWeights) -> InverseBound:
    """A bound on `‖L⁻¹‖`, from weights of all sources; infinite where the navigator does not reach everybody,
    not a number where none was found.
    """
    reached = hearing.all_reached(weights)
    times = apply_laplacian(hearing, of_vehicles(hearing, weights))
    m, axes, lanes = weights.shape[2], len(weights), weights.shape[-1]
    right = jnp.ones((m, 1, axes, lanes))
    v = iterated(times, right, right, lambda _: jnp.where(reached, CERTIFICATE, jnp.inf)[None, None])[0]
    greatest = residual_norm(v)[0]
    least = times(v).min(axis=0)[0] - rounding(hearing) * greatest
    bound = jnp.where(least > 0, greatest / least, jnp.nan)
    return jnp.where(reached[None], bound, jnp.inf)


def certified(
    hearing: Hearing, weights: AxisWeights, bound: InverseBound, right: Unknowns, start: Unknowns
) -> tuple[Unknowns, Sizes]:
    """`L⁻¹ b` and a bound on its error relative to it, from weights of vehicles alone, and where to start.

    It is not a number where b is not finite, the inverse has no bound, or nothing as accurate as LOOSEST was
    found; of what is not a number no error is told.
    """
    times, size, limited = apply_laplacian(hearing, weights), residual_norm(right), jnp.isfinite(bound)[None]
    share = jnp.maximum(ACCURACY / bound, rounding(hearing))[None]
    unit = jnp.where(size > 0, size, 1.0)[None]
    x, left = iterated(
        times, right / unit, start / unit, lambda reached: jnp.where(limited, share * reached, jnp.inf)
    )
    error = jnp.where(left == 0.0, 0.0, bound[None] * left / residual_norm(x))
    found = limited & (error < LOOSEST)
    return jnp.where(found[None], x * unit, jnp.nan), jnp.where(found, error, 0.0)


def rounding(hearing: Hearing) -> float:
    """How far `b - L x` may be from what it is computed as, relative to x."""
    return (4 + len(hearing.carried_sources) / 2) * float(np.finfo(float).eps)


def iterated(times: Map, right: Unknowns, x: Unknowns, allowed: Allowance) -> tuple[Unknowns, Sizes]:
    """A better solution than x, and the size of what it leaves of the right side: what is allowed, or the
    least that was found.

    Each start goes on from the best solution, with another shadow. That is full of components of both signs:
    where nobody hears oneself again, as in trees, what is left itself would not see what it is passed on as.
    """

    def start(carry: Any) -> Any:
        number, x, left, size, going = carry
        shadow = jnp.cos(((number + 1) * jnp.arange(len(right)) ** 2).astype(float))
        shadow = jnp.broadcast_to(shadow[:, None, None, None], left.shape)
        found = stabilised(times, x, left, shadow, going, allowed)
        rest = right - times(found)
        better = going & (residual_norm(rest) < size)
        x, left = jnp.where(better[None], found, x), jnp.where(better[None], rest, left)
        size = jnp.where(better, residual_norm(rest), size)
        return number + 1, x, left, size, going & (size > allowed(residual_norm(x)))

    left = right - times(x)
    size = residual_norm(left)
    carry = jnp.asarray(0), x, left, size, size > allowed(residual_norm(x))
    _, x, _, size, _ = jax.lax.while_loop(lambda carry: (carry[0] < STARTS) & carry[4].any(), start, carry)
    return x, size


def stabilised(
    times: Map, x: Unknowns, left: Unknowns, shadow: Unknowns, going: Bool[Array, "..."], allowed: Allowance
) -> Unknowns:
    """Rounds of BiCGSTAB from x, in the columns that are going, until what is left seems to be allowed."""

    def step(carry: Any) -> Any:
        number, x, left, direction, along, going = carry
        image = times(direction)
        alpha = jnp.where(going, along / inner_product(shadow, image), 0.0)
        half = left - alpha * image
        turned = times(half)
        square = inner_product(turned, turned)
        omega = jnp.where(going & (square > 0), inner_product(turned, half) / square, 0.0)
        x = jnp.where(going, x + alpha * direction + omega * half, x)
        left = half - omega * turned
        following = inner_product(shadow, left)
        beta = following / along * (alpha / omega)
        direction = left + beta * (direction - omega * image)
        going = going & (residual_norm(left)[None] > allowed(residual_norm(x))[None]) & jnp.isfinite(beta)
        return number + 1, x, left, direction, following, going

    carry = jnp.asarray(0), x, left, left, inner_product(shadow, left), going[None]
    return jax.lax.while_loop(lambda carry: (carry[0] < ROUNDS * len(x)) & carry[5].any(), step, carry)[1]


def inner_product(x: Unknowns, y: Unknowns) -> Float[Array, "1 columns axes lanes"]:
    """The product of each column with another."""
    return (x * y).sum(axis=0, keepdims=True)


def residual_norm(x: Unknowns) -> Sizes:
    """The greatest component of each column."""
    return jnp.abs(x).max(axis=0)
