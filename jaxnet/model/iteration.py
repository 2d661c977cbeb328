"""Iterative solution of `L x = b` with a certified error, for graphs without a narrow order.

The iteration is BiCGSTAB (van der Vorst), because L is not symmetric and its spectrum is not known
beforehand. It works slot by slot without a matrix. It restarts while the residual is too large.

L is an M-matrix, and its inverse has no negative entry. Hence `‖L⁻¹‖ = max L⁻¹ 1`, in the maximum norm. Any v
with `L v > 0` gives the bound

    ‖L⁻¹‖ ≤ max v / min L v,      ‖x - L⁻¹ b‖ ≤ ‖L⁻¹‖ ‖b - L x‖.

Each column of each axis and lane stops as soon as its own error is small enough. No result therefore depends
on the other lanes of the batch.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxnet.model.hearing import AxisWeights, Hearing

ACCURACY = 1e-12  # wanted error of a solution, relative to its greatest component
LOOSEST = 1e-6  # relative error from which a solution counts as not found
CERTIFICATE = 0.25  # tolerated distance of `L v` from 1
STARTS = 8
ROUNDS = 4  # maximum number of steps of a start, in multiples of m

Unknowns = Float[Array, "m columns axes lanes"]
Sizes = Float[Array, "columns axes lanes"]
Map = Callable[[Unknowns], Unknowns]
Allowance = Callable[[Sizes], Sizes]  # tolerated residual norm, by the norm of x
InverseBound = Float[Array, "axes lanes"]


def of_vehicles(hearing: Hearing, weights: AxisWeights) -> AxisWeights:
    """Return the weights of links from vehicles, with 0 for links that carry the navigator's message."""
    return jnp.where((jnp.asarray(hearing.carried_sources) > 0)[None, :, :, None], weights, 0.0)


def apply_laplacian(hearing: Hearing, weights: AxisWeights) -> Map:
    """Return the function x → L x, from weights of vehicles only."""
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
    """Return a bound on `‖L⁻¹‖` from the weights of all sources.

    The bound is infinite if the navigator does not reach every vehicle. It is NaN if the iteration found no
    bound.
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
    """Solve `L x = b`, and return x and a bound on its relative error.

    `weights` are the weights of vehicles only, `bound` is a bound on `‖L⁻¹‖`, and `start` is the initial
    guess. The solution is NaN in three cases: b is not finite, `bound` is not finite, or the error is at
    least LOOSEST. The error bound of a NaN solution is 0.
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
    """Return the greatest rounding error of the computed `b - L x`, relative to x."""
    return (4 + len(hearing.carried_sources) / 2) * float(np.finfo(float).eps)


def iterated(times: Map, right: Unknowns, x: Unknowns, allowed: Allowance) -> tuple[Unknowns, Sizes]:
    """Improve x by restarted BiCGSTAB, and return the best x and the norm of its residual.

    The iteration ends when `allowed` admits the residual, or after STARTS starts. Each start continues from
    the best solution with a different shadow vector. The shadow vector is dense, with components of both
    signs. The usual choice, the residual itself, fails in graphs without cycles such as trees: the residual
    can be orthogonal to its images.
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
    """Run BiCGSTAB from x in the columns marked `going`, until `allowed` admits the estimated residual.

    `left` is the residual of x, and `shadow` is the shadow vector.
    """

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
    """Return the inner product of each column of x with the same column of y."""
    return (x * y).sum(axis=0, keepdims=True)


def residual_norm(x: Unknowns) -> Sizes:
    """Return the maximum norm of each column."""
    return jnp.abs(x).max(axis=0)
