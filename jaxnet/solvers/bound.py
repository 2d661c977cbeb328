"""A bound on `‖L⁻¹‖`, from which the error of an iterative solution follows.

L is an M-matrix, and its inverse has no negative entry. Hence `‖L⁻¹‖ = max L⁻¹ 1`, in the maximum
norm. Any v with `L v > 0` gives the bound

    ‖L⁻¹‖ ≤ max v / min L v,      ‖x - L⁻¹ b‖ ≤ ‖L⁻¹‖ ‖b - L x‖.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxnet.model.hearing import AxisWeights, Hearing
from jaxnet.solvers.iteration import apply_laplacian, iterated, of_vehicles, residual_norm

CERTIFICATE = 0.25  # tolerated distance of `L v` from 1

InverseBound = Float[Array, "axes lanes"]


def inverse_bound(hearing: Hearing, weights: AxisWeights) -> InverseBound:
    """A bound on `‖L⁻¹‖` from the weights of all sources.

    The bound is infinite if the navigator does not reach every vehicle. It is NaN if the iteration
    found no bound.
    """
    reached = hearing.all_reached(weights)
    times = apply_laplacian(hearing, of_vehicles(hearing, weights))
    m, axes, lanes = weights.shape[2], len(weights), weights.shape[-1]
    right = jnp.ones((m, 1, axes, lanes))
    v = iterated(
        times, right, right, lambda _: jnp.where(reached, CERTIFICATE, jnp.inf)[None, None]
    )[0]
    greatest = residual_norm(v)[0]
    least = times(v).min(axis=0)[0] - rounding(hearing) * greatest
    bound = jnp.where(least > 0, greatest / least, jnp.nan)
    return jnp.where(reached[None], bound, jnp.inf)


def rounding(hearing: Hearing) -> float:
    """The greatest rounding error of the computed `b - L x`, relative to x."""
    return (4 + len(hearing.carried_sources) / 2) * float(np.finfo(float).eps)
