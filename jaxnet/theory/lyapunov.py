"""Lyapunov constants of one axis: `limsup ‖η‖ ≤ c sup ‖ρ‖` for η̇ = A_c η + B ρ.

With `A_c'P + P A_c = -Q`, `V = η'Pη` falls wherever `‖η‖ > 2‖PB‖ / λ_min(Q) · sup ‖ρ‖`. The paper
takes this radius as the ultimate bound. But η leaves that ball again along the longest axis of the
ellipsoid around the ball. The bound therefore needs the factor √κ(P), κ = λ_max / λ_min (Khalil,
Nonlinear Systems, theorem 4.18). Without this factor the bound is false in general, though true at
gain (1, 3, 3) (theorems.md O5).
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from jaxnet.model.axis import companion
from jaxnet.theory.response import LawGain
from jaxnet.theory.solution import Weight, lyapunov_matrix

STEPS = 2000
LEARNING_RATE = 0.1


def printed_constant(gain: LawGain, Q: Weight | None = None) -> float:
    """`2‖PB‖ / λ_min(Q)`, the paper's constant, which is false in general."""
    least = 1.0 if Q is None else np.linalg.eigvalsh(Q)[0]
    return float(2 * np.linalg.norm(lyapunov_matrix(gain, Q)[:, -1]) / least)


def corrected_constant(gain: LawGain, Q: Weight | None = None) -> float:
    """`√κ(P) · 2‖PB‖ / λ_min(Q)`, which is a bound for every Q ≻ 0."""
    return printed_constant(gain, Q) * float(np.sqrt(np.linalg.cond(lyapunov_matrix(gain, Q))))


def best_constant(gain: LawGain) -> float:
    """Corrected constant of the best Q ≻ 0 that a search finds.

    NumPy evaluates the constant of that Q. A poor search gives a greater bound, never a wrong one.
    """
    return min(
        corrected_constant(gain), corrected_constant(gain, best_weight(tuple(gain.tolist())))
    )


@functools.cache
def best_weight(gain: tuple[float, ...]) -> Weight:
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):  # optax counts in 32 bits
        return np.asarray(descended(jnp.asarray(companion(np.array(gain)))))


@jax.jit
def descended(matrix: Float[Array, "r r"]) -> Float[Array, "r r"]:
    """Q with the least corrected constant on a gradient descent (Adam) from the identity."""
    adam = optax.adam(optax.cosine_decay_schedule(LEARNING_RATE, STEPS))

    def step(carry: Any, _: None) -> tuple[Any, None]:
        place, state, least, lowest = carry
        height, slope = jax.value_and_grad(log_constant)(place, matrix)
        lower = height < lowest
        update, state = adam.update(slope, state)
        met = jnp.where(lower, place, least), jnp.where(lower, height, lowest)
        return (optax.apply_updates(place, update), state, *met), None

    order = len(matrix)
    start = jnp.zeros(order * (order + 1) // 2)
    carry = start, adam.init(start), start, log_constant(start, matrix)
    return weight_matrix(jax.lax.scan(step, carry, None, length=STEPS)[0][2], order)


def weight_matrix(place: Float[Array, " entries"], order: int) -> Float[Array, "r r"]:
    """`Q = F F'` for a lower triangular F whose diagonal is given by logarithms."""
    lower = jnp.zeros((order, order)).at[np.tril_indices(order)].set(place)
    factor = jnp.tril(lower, -1) + jnp.diag(jnp.exp(jnp.diag(lower)))
    return factor @ factor.T


def log_constant(place: Float[Array, " entries"], matrix: Float[Array, "r r"]) -> Float[Array, ""]:
    order = len(matrix)
    Q, one = weight_matrix(place, order), jnp.eye(order)
    equation = jnp.kron(matrix.T, one) + jnp.kron(one, matrix.T)
    P = jnp.linalg.solve(equation, -Q.reshape(-1)).reshape(Q.shape)
    axes = jnp.linalg.eigvalsh((P + P.T) / 2)
    radius = 2 * jnp.linalg.norm(P[:, -1]) / jnp.linalg.eigvalsh(Q)[0]
    return jnp.log(radius) + (jnp.log(axes[-1]) - jnp.log(axes[0])) / 2
