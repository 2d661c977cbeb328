"""Iterative solution with a certified error, for large graphs without a narrow order.

L is an M-matrix, and its inverse has no negative entry. Hence `‖L⁻¹‖ = max L⁻¹ 1`, in the maximum
norm. Any v with `L v > 0` gives a bound, from which the error of a solution follows:

    ‖L⁻¹‖ ≤ max v / min L v,      ‖x - L⁻¹ b‖ ≤ ‖L⁻¹‖ ‖b - L x‖.

The iteration is restarted BiCGSTAB (van der Vorst), slot by slot without a matrix. L is not
symmetric, and its spectrum is not known beforehand. Each column of each axis and lane stops as soon
as its own residual is small enough. No result therefore depends on the other lanes of the batch.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxnet.model.hearing import AxisWeights, Hearing
from jaxnet.model.shapes import LoopIndex
from jaxnet.solvers.solver import Columns, PlaneVector, Solver

ACCURACY = 1e-12  # wanted error of a solution, relative to its greatest component
LOOSEST = 1e-6  # relative error from which a solution counts as not found
CERTIFICATE = 0.25  # tolerated distance of `L v` from 1
STARTS = 8
ROUNDS = 4  # maximum number of steps of a start, in multiples of m

Unknowns = Float[Array, "m columns axes lanes"]
Sizes = Float[Array, "columns axes lanes"]
Map = Callable[[Unknowns], Unknowns]
Allowance = Callable[[Sizes], Sizes]  # tolerated residual norm, by the norm of x


class Bounded(NamedTuple):
    """Weights and a norm bound of one L for repeated solves by iteration."""

    weights: AxisWeights  # weights of vehicles, without the navigator
    bound: Float[Array, "axes lanes"]  # of ‖L⁻¹‖


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Iterative(Solver[Bounded]):
    """BiCGSTAB until the certified error of each column is small enough."""

    starts: ClassVar[bool] = True

    def solve(self, hearing, weights, right):
        """Solve for several columns b. The residual is a bound on the relative error."""
        factors, residual = self.factorise(hearing, weights)
        solution, error = certified(hearing, factors, right, jnp.zeros_like(right))
        return solution, jnp.maximum(residual, error.max(axis=(0, 1)))

    def factorise(self, hearing, weights):
        """Weights and norm bound. The residual is infinite where a vehicle is cut off, else 0.

        The bound is infinite there too. It is NaN if the iteration found no bound.
        """
        keeps_drive = (weights == 0).all(axis=1)  # counts as reached
        reached = hearing.reached(weights > 0, keeps_drive).all(axis=(0, 1))
        of_vehicles = (jnp.asarray(hearing.carried_sources) > 0)[None, :, :, None]
        theirs = jnp.where(of_vehicles, weights, 0.0)
        times = laplacian_of(hearing, theirs)
        right = jnp.ones((weights.shape[2], 1, len(weights), weights.shape[-1]))
        allowed = jnp.where(reached, CERTIFICATE, jnp.inf)[None, None]
        v = iterated(times, right, right, lambda _: allowed)[0]
        greatest = greatest_of(v)[0]
        least = times(v).min(axis=0)[0] - rounding(hearing) * greatest
        bound = jnp.where(least > 0, greatest / least, jnp.nan)
        bound = jnp.where(reached[None], bound, jnp.inf)
        return Bounded(theirs, bound), jnp.where(jnp.isinf(bound).any(axis=0), jnp.inf, 0.0)

    def apply(self, hearing, factors, right, start):
        axes = len(factors.weights)

        def as_columns(vector: PlaneVector) -> Columns:
            return vector.reshape(axes, -1, *vector.shape[1:]).transpose(2, 1, 0, 3)

        guess = jnp.zeros_like(right) if start is None else start
        found, _ = certified(hearing, factors, as_columns(right), as_columns(guess))
        return found.transpose(2, 1, 0, 3).reshape(right.shape)


def certified(
    hearing: Hearing, factors: Bounded, right: Unknowns, start: Unknowns
) -> tuple[Unknowns, Sizes]:
    """Solve `L x = b` from an initial guess, and return x and a bound on its relative error.

    The solution is NaN in three cases: b is not finite, the norm bound is not finite, or the error
    is at least LOOSEST. The error bound of a NaN solution is 0.
    """
    bound, size = factors.bound, greatest_of(right)
    limited = jnp.isfinite(bound)[None]
    share = jnp.maximum(ACCURACY / bound, rounding(hearing))[None]
    unit = jnp.where(size > 0, size, 1.0)[None]

    def allowed(reached: Sizes) -> Sizes:
        return jnp.where(limited, share * reached, jnp.inf)

    times = laplacian_of(hearing, factors.weights)
    x, left = iterated(times, right / unit, start / unit, allowed)
    error = jnp.where(left == 0.0, 0.0, bound[None] * left / greatest_of(x))
    found = limited & (error < LOOSEST)
    return jnp.where(found[None], x * unit, jnp.nan), jnp.where(found, error, 0.0)


def laplacian_of(hearing: Hearing, weights: AxisWeights) -> Map:
    """The function x → L x, from weights of vehicles only."""
    sources = jnp.maximum(jnp.asarray(hearing.carried_sources) - 1, 0)
    heard = jnp.moveaxis(weights, 0, 2)

    def times(x: Unknowns) -> Unknowns:
        def less(slot: LoopIndex, total: Unknowns) -> Unknowns:
            carried = x.at[sources[slot]].get(mode="promise_in_bounds")
            return total - heard[slot][:, None] * carried

        return jax.lax.fori_loop(0, len(sources), less, x)

    return times


def rounding(hearing: Hearing) -> float:
    """The greatest rounding error of the computed `b - L x`, relative to x."""
    return (4 + len(hearing.carried_sources) / 2) * float(np.finfo(float).eps)


def iterated(
    times: Map, right: Unknowns, x: Unknowns, allowed: Allowance
) -> tuple[Unknowns, Sizes]:
    """Improve x by restarted BiCGSTAB, and return the best x and the norm of its residual.

    The iteration ends when `allowed` admits the residual, or after STARTS starts. Each start
    continues from the best solution with a different shadow vector. The shadow vector is dense,
    with components of both signs. The usual choice, the residual itself, fails in graphs without
    cycles such as trees: the residual can be orthogonal to its images.
    """

    def start(carry: Any) -> Any:
        number, x, left, size, going = carry
        shadow = jnp.cos(((number + 1) * jnp.arange(len(right)) ** 2).astype(float))
        shadow = jnp.broadcast_to(shadow[:, None, None, None], left.shape)
        found = stabilised(times, x, left, shadow, going, allowed)
        rest = right - times(found)
        better = going & (greatest_of(rest) < size)
        x, left = jnp.where(better[None], found, x), jnp.where(better[None], rest, left)
        size = jnp.where(better, greatest_of(rest), size)
        return number + 1, x, left, size, going & (size > allowed(greatest_of(x)))

    left = right - times(x)
    size = greatest_of(left)
    carry = jnp.asarray(0), x, left, size, size > allowed(greatest_of(x))
    _, x, _, size, _ = jax.lax.while_loop(
        lambda carry: (carry[0] < STARTS) & carry[4].any(), start, carry
    )
    return x, size


def stabilised(
    times: Map, x: Unknowns, left: Unknowns, shadow: Unknowns, going: Any, allowed: Allowance
) -> Unknowns:
    """Run BiCGSTAB from x in the columns `going`, until `allowed` admits the estimated residual.

    `left` is the residual of x, and `shadow` is the shadow vector.
    """

    def inner(x: Unknowns, y: Unknowns) -> Float[Array, "1 columns axes lanes"]:
        return (x * y).sum(axis=0, keepdims=True)

    def step(carry: Any) -> Any:
        number, x, left, direction, along, going = carry
        image = times(direction)
        alpha = jnp.where(going, along / inner(shadow, image), 0.0)
        half = left - alpha * image
        turned = times(half)
        square = inner(turned, turned)
        omega = jnp.where(going & (square > 0), inner(turned, half) / square, 0.0)
        x = jnp.where(going, x + alpha * direction + omega * half, x)
        left = half - omega * turned
        following = inner(shadow, left)
        beta = following / along * (alpha / omega)
        direction = left + beta * (direction - omega * image)
        over = greatest_of(left) > allowed(greatest_of(x))
        return number + 1, x, left, direction, following, going & over[None] & jnp.isfinite(beta)

    carry = jnp.asarray(0), x, left, left, inner(shadow, left), going[None]
    return jax.lax.while_loop(
        lambda carry: (carry[0] < ROUNDS * len(x)) & carry[5].any(), step, carry
    )[1]


def greatest_of(x: Unknowns) -> Sizes:
    return jnp.abs(x).max(axis=0)
