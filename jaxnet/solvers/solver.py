"""The interface of all solvers, and the shapes of their arrays."""

from abc import ABC, abstractmethod
from typing import ClassVar, Generic, NamedTuple, TypeVar

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxnet.model.hearing import AxisWeights, Hearing, SlotWeights
from jaxnet.model.signal import ByFunction, Vectors

Columns = Float[Array, "m columns axes lanes"]
PlaneVector = Float[Array, "2 m lanes"]
Residual = Float[Array, " lanes"]
SolvedLanes = Bool[Array, " lanes"]
SolvedVehicles = Bool[Array, "m lanes"]
Factors = TypeVar("Factors")


class System(NamedTuple):
    """Hearing, weights, decisions and attack vectors, from which L and b of lanes follow."""

    hearing: Hearing
    weights: SlotWeights
    decision: Bool[Array, "axes slots m lanes"]  # axes: 1 if both share a decision, else 2
    vectors: Vectors  # of the attacks


class Solver(ABC, Generic[Factors]):
    """A way to solve `L x = b`: arrays are leaves of a pytree, and its type is the choice."""

    starts: ClassVar[bool] = False  # whether `apply` uses an initial guess

    @abstractmethod
    def solve(
        self, hearing: Hearing, weights: AxisWeights, right: Columns
    ) -> tuple[Columns, Residual]:
        """Solve for several columns b, and return the solution and the residual of `L⁻¹ a0 = 1`."""

    @abstractmethod
    def factorise(self, hearing: Hearing, weights: AxisWeights) -> tuple[Factors, Residual]:
        """Factorise L for repeated solves; return factors and the residual of `L⁻¹ a0 = 1`."""

    @abstractmethod
    def apply(
        self, hearing: Hearing, factors: Factors, right: PlaneVector, start: PlaneVector | None
    ) -> PlaneVector:
        """`L⁻¹` times one vector on each axis. `start` is an initial guess, None for 0."""

    def update(
        self, system: System, x: ByFunction, flagged: SolvedLanes, changed: SolvedVehicles
    ) -> tuple[ByFunction, SolvedLanes]:
        """Update x in flagged lanes where the rows of few vehicles changed.

        Return x, and the flagged lanes that still must be solved: all of them, unless a solver
        overrides this method.
        """
        return x, flagged


def off_one(reached: Float[Array, "m axes lanes"]) -> Residual:
    """The greatest distance of `L⁻¹ a0` from 1 in each lane."""
    return jnp.abs(reached - 1.0).max(axis=(0, 1))
