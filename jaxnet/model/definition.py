"""The control law as the paper states it, stacked with Kronecker products (sections 4.2 and 4.3).

The stacked engine uses this form. Tests compare the structured solve of `control` with it. Stacked
vectors list one vehicle after the other: `ȳ = [y_1; …; y_m]` and `η_i = [ε_i; ε̇_i; ε̈_i]`. The
paper has order 3; vehicles of order r have r derivatives in η, and r in place of the third
derivative.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.model.control import Gain, is_matrix


def brunovsky(order: int) -> tuple[Float[Array, "n n"], Float[Array, "n 2"]]:
    """`𝒜` and `ℬ`, the matrices of two chains of as many integrators."""
    return jnp.kron(jnp.eye(order, k=1), jnp.eye(2)), jnp.kron(jnp.eye(order)[:, -1:], jnp.eye(2))


def stacked_feedback(gain: Gain) -> Float[Array, "2 n"]:
    """`𝒦 = -[k0 I₂, k1 I₂, …]`, the gains of the paper in the order of η; matrices as they are."""
    return -jnp.concatenate(gain, axis=1) if is_matrix(gain) else -jnp.kron(gain[None], jnp.eye(2))


def closed_loop(gain: Gain, vehicles: int) -> Float[Array, "n n"]:
    """The matrix of the closed loop, `𝐀 + 𝐁 𝐊 = I_m ⊗ (𝒜 + ℬ𝒦)`."""
    chains, entry = brunovsky(len(gain))
    return jnp.kron(jnp.eye(vehicles), chains + entry @ stacked_feedback(gain))


def stacked(psi: Float[Array, "2 2 m"]) -> Float[Array, "n n"]:
    """The block diagonal matrix `Ψ = diag{ψ_1, …, ψ_m}`."""
    return jax.scipy.linalg.block_diag(*jnp.moveaxis(psi, 2, 0))


def mixing(psi: Float[Array, "n n"], weights: Float[Array, "m sources"]) -> Float[Array, "n n"]:
    """`M = Ψ⁻¹ (I - A ⊗ I₂) Ψ`."""
    coupling = jnp.eye(len(psi)) - jnp.kron(weights[:, 1:], jnp.eye(2))
    return jnp.linalg.solve(psi, coupling @ psi)


def stacked_inputs(
    drift: Float[Array, "2 m"],
    decoupling: Float[Array, "2 2 m"],
    weights: Float[Array, "m sources"],
    received_highest: Float[Array, "2 m"],
    error: Float[Array, "r 2 m"],
    gain: Gain,
) -> Float[Array, "2 m"]:
    """Solve the dense system `M u = Ψ⁻¹ [-σ + (A ⊗ I₂) σ + a0 ⊗ y_0^(r) + d^(r) + K η]` for the
    inputs u.

    `drift` is σ of each vehicle, and `decoupling` is ψ of each vehicle. `received_highest` is `a0 ⊗
    y_0^(r) + d^(r)`. `error` holds the jets ε, ε̇, ….
    """
    vehicles, psi = drift.shape[1], stacked(decoupling)
    sigma = drift.T.reshape(-1)
    eta = error.transpose(2, 0, 1).reshape(-1)
    gains = jnp.kron(jnp.eye(vehicles), stacked_feedback(gain))
    spread = jnp.kron(weights[:, 1:], jnp.eye(2))
    demand = -sigma + spread @ sigma + received_highest.T.reshape(-1) + gains @ eta
    u = jnp.linalg.solve(mixing(psi, weights), jnp.linalg.solve(psi, demand))
    return u.reshape(vehicles, 2).T
