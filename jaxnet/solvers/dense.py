"""One dense matrix of all vehicles, for small fleets and for graphs that no order makes narrow."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.model.elimination import eliminated, identity, product
from jaxnet.model.hearing import AxisWeights, Hearing
from jaxnet.solvers.solver import Columns, PlaneVector, Residual, Solver, off_one
from jaxnet.solvers.table import add_weights

InverseColumns = Float[Array, "m axes m lanes"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Dense(Solver[InverseColumns]):
    """Gauss–Jordan elimination of one dense matrix. Its factors are the columns of the inverse."""

    def solve(self, hearing: Hearing, weights: AxisWeights, right: Columns) -> tuple[Columns, Residual]:
        """Solve for several columns b, and return the solution and the residual of `L⁻¹ a0 = 1`."""
        laplacian, navigator = dense_laplacian(hearing, weights)
        solution = eliminated(jnp.concatenate([laplacian, right, navigator], axis=1))
        return solution[:, :-1], off_one(solution[:, -1])

    def factorise(self, hearing: Hearing, weights: AxisWeights) -> tuple[InverseColumns, Residual]:
        """Return the columns of `L⁻¹`, and the residual of `L⁻¹ a0 = 1`."""
        laplacian, navigator = dense_laplacian(hearing, weights)
        inverse = jnp.moveaxis(eliminated(jnp.concatenate([laplacian, identity(laplacian)], axis=1)), 0, 2)
        reached = product(inverse, navigator[:, 0].swapaxes(0, 1))
        return inverse, off_one(reached.swapaxes(0, 1))

    def apply(
        self, hearing: Hearing, factors: InverseColumns, right: PlaneVector, start: PlaneVector | None
    ) -> PlaneVector:
        """Return `L⁻¹` times one vector on each axis."""
        return product(factors, right)


def dense_laplacian(
    hearing: Hearing, weights: AxisWeights
) -> tuple[Float[Array, "m m axes lanes"], Float[Array, "m 1 axes lanes"]]:
    """Return L and a0, the weights of the navigator."""
    m = hearing.carried_sources.shape[1]
    nothing = jnp.zeros((1, m, 1 + m, len(weights), weights.shape[-1]))
    heard = jnp.moveaxis(weights, 0, 2)[:, None]
    table = add_weights(nothing, jnp.asarray(hearing.carried_sources)[:, None], heard)[0]
    return identity(table[:, 1:]) - table[:, 1:], table[:, :1]
