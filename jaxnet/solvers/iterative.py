"""Iterative solution with a certified error, for large graphs without a narrow order."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp

from jaxnet.model.hearing import AxisWeights, Hearing
from jaxnet.solvers.bound import InverseBound, inverse_bound, rounding
from jaxnet.solvers.iteration import (
    Sizes,
    Unknowns,
    apply_laplacian,
    iterated,
    of_vehicles,
    residual_norm,
)
from jaxnet.solvers.solver import Columns, PlaneVector, Residual, Solver

ACCURACY = 1e-12  # wanted error of a solution, relative to its greatest component
LOOSEST = 1e-6  # relative error from which a solution counts as not found


class Bounded(NamedTuple):
    """Weights and a norm bound of one L for repeated solves by iteration."""

    weights: AxisWeights  # weights of vehicles, without the navigator
    bound: InverseBound


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Iterative(Solver[Bounded]):
    """BiCGSTAB until the certified error of each column is small enough."""

    starts: ClassVar[bool] = True

    def solve(
        self, hearing: Hearing, weights: AxisWeights, right: Columns
    ) -> tuple[Columns, Residual]:
        """Solve for several columns b. The residual is a bound on the relative error."""
        factors, residual = self.factorise(hearing, weights)
        solution, error = certified(hearing, factors, right, jnp.zeros_like(right))
        return solution, jnp.maximum(residual, error.max(axis=(0, 1)))

    def factorise(self, hearing: Hearing, weights: AxisWeights) -> tuple[Bounded, Residual]:
        """Weights and norm bound. The residual is infinite where a vehicle is cut off, else 0."""
        bound = inverse_bound(hearing, weights)
        cut_off = jnp.isinf(bound).any(axis=0)
        return Bounded(of_vehicles(hearing, weights), bound), jnp.where(cut_off, jnp.inf, 0.0)

    def apply(
        self, hearing: Hearing, factors: Bounded, right: PlaneVector, start: PlaneVector | None
    ) -> PlaneVector:
        columns, guess = (
            jnp.moveaxis(each.reshape(len(factors.weights), -1, *each.shape[1:]), 2, 0).swapaxes(
                1, 2
            )
            for each in (right, jnp.zeros_like(right) if start is None else start)
        )
        found, _ = certified(hearing, factors, columns, guess)
        return jnp.moveaxis(found.swapaxes(1, 2), 0, 2).reshape(right.shape)


def certified(
    hearing: Hearing, factors: Bounded, right: Unknowns, start: Unknowns
) -> tuple[Unknowns, Sizes]:
    """Solve `L x = b` from an initial guess, and return x and a bound on its relative error.

    The solution is NaN in three cases: b is not finite, the norm bound is not finite, or the error
    is at least LOOSEST. The error bound of a NaN solution is 0.
    """
    weights, bound = factors
    times, size, limited = (
        apply_laplacian(hearing, weights),
        residual_norm(right),
        jnp.isfinite(bound)[None],
    )
    share = jnp.maximum(ACCURACY / bound, rounding(hearing))[None]
    unit = jnp.where(size > 0, size, 1.0)[None]
    x, left = iterated(
        times,
        right / unit,
        start / unit,
        lambda reached: jnp.where(limited, share * reached, jnp.inf),
    )
    error = jnp.where(left == 0.0, 0.0, bound[None] * left / residual_norm(x))
    found = limited & (error < LOOSEST)
    return jnp.where(found[None], x * unit, jnp.nan), jnp.where(found, error, 0.0)
