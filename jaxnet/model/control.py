"""The law: from what a vehicle knows of itself and what it hears, the jerk that it wants.

    z_i^(k) = Σ_j w_ij (y_j^(k) + a_ij^(k)),      ε = y - z
    L q = a0 ⊗ y_0‴ + d‴ - (k0 ε + k1 ε̇ + k2 ε̈),      q = y‴

It is the paper's `M u = …` with ψ taken out: 2m unknowns in one dense system become m with two right-hand
sides. `definition` has the original.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

Own = Float[Array, "3 m 2"]
Desired = Float[Array, "4 m 2"]
Weights = Float[Array, "m sources"]


def desired_signal(
    own: Own, navigator: Float[Array, "4 2"], corruption: Desired, weights: Weights
) -> Desired:
    """Jets of `z`, the weighted mean of what is heard, lies (`corruption`, d) included.

    The vehicles' own third derivatives are what the law solves for; z‴ leaves them out.
    """
    vehicles = jnp.concatenate([own, jnp.zeros_like(own[:1])])
    sources = jnp.concatenate([navigator[:, None], vehicles], axis=1)
    return jnp.einsum("is,ksx->kix", weights, sources) + corruption


def desired_jerk(
    own: Own,
    desired: Desired,
    laplacian_inverse: Float[Array, "m m"],
    gain: Float[Array, "3"],
) -> Float[Array, "m 2"]:
    """`q = L⁻¹ [z‴ - (k0 ε + k1 ε̇ + k2 ε̈)]` for the weights in force."""
    feedback = jnp.tensordot(gain, own - desired[:3], axes=1)
    return laplacian_inverse @ (desired[3] - feedback)


def invert_laplacian(weights: Weights) -> tuple[Float[Array, "m m"], Float[Array, ""]]:
    """`L⁻¹` and how far `L⁻¹ a0` is from 1.

    The two agree just when the navigator reaches every vehicle over the weights in force, so the residual
    tells a disconnected graph, where it is of order 1 or not a number.
    """
    inverse = jnp.linalg.inv(jnp.eye(len(weights)) - weights[:, 1:])
    return inverse, jnp.abs(inverse @ weights[:, 0] - 1.0).max()
