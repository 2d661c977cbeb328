"""Lyapunov's constants of one axis: `limsup ‖η‖ ≤ c sup ‖ρ‖` for η̇ = A_c η + B ρ.

With `A_c'P + P A_c = -Q`, `V = η'Pη` falls wherever `‖η‖ > 2‖PB‖ / λ_min(Q) · sup ‖ρ‖`. The paper takes this
radius for the ultimate bound; but η leaves that ball again along the longest axis of the ellipsoid around
it, which needs the further factor √κ(P), κ = λ_max / λ_min (Khalil, Nonlinear Systems, theorem 4.18). Without
it the bound is false in general, though true at gain (1, 3, 3) (SCIENCE O5).
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float
from scipy.linalg import solve_continuous_lyapunov

from jaxnet.theory import exact
from jaxnet.theory.response import Gain

Weight = Float[np.ndarray, "3 3"]

IDENTITY = np.eye(3)
STEPS = 2000
RATE = 0.1
BELOW = np.tril_indices(3)


def solution(gain: Gain, Q: Weight = IDENTITY) -> Weight:
    """`P`, for which `A_c'P + P A_c = -Q`."""
    return solve_continuous_lyapunov(exact.companion(gain).T, -Q)


def printed(gain: Gain, Q: Weight = IDENTITY) -> float:
    """`2‖PB‖ / λ_min(Q)`, the paper's constant, which is false in general."""
    return float(2 * np.linalg.norm(solution(gain, Q)[:, 2]) / np.linalg.eigvalsh(Q)[0])


def corrected(gain: Gain, Q: Weight = IDENTITY) -> float:
    """`√κ(P) · 2‖PB‖ / λ_min(Q)`, which is a bound for every Q ≻ 0."""
    return printed(gain, Q) * float(np.sqrt(np.linalg.cond(solution(gain, Q))))


def best(gain: Gain) -> float:
    """The corrected constant, minimised over Q ≻ 0."""
    return best_known(tuple(gain.tolist()))


@functools.cache
def best_known(gain: tuple[float, ...]) -> float:
    """The same, remembered. The Q found is judged in NumPy, so the search can be lazy but not wrong."""
    given = np.array(gain)
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):  # optax counts in 32 bits
        Q = np.asarray(best_form(jnp.asarray(exact.companion(given))))
    return min(corrected(given), corrected(given, Q))


@jax.jit
def best_form(matrix: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """Q of the least corrected constant met on a descent (Adam) from the identity."""
    adam = optax.adam(optax.cosine_decay_schedule(RATE, STEPS))

    def step(carry: Any, _: None) -> tuple[Any, None]:
        place, state, least, lowest = carry
        height, slope = jax.value_and_grad(log_constant)(place, matrix)
        lower = height < lowest
        update, state = adam.update(slope, state)
        met = jnp.where(lower, place, least), jnp.where(lower, height, lowest)
        return (optax.apply_updates(place, update), state, *met), None

    start = jnp.zeros(6)
    carry = start, adam.init(start), start, log_constant(start, matrix)
    return weight(jax.lax.scan(step, carry, None, length=STEPS)[0][2])


def weight(place: Float[Array, "6"]) -> Float[Array, "3 3"]:
    """`Q = F F'` of a lower triangular F, its diagonal given by logarithms."""
    lower = jnp.zeros((3, 3)).at[BELOW].set(place)
    factor = jnp.tril(lower, -1) + jnp.diag(jnp.exp(jnp.diag(lower)))
    return factor @ factor.T


def log_constant(place: Float[Array, "6"], matrix: Float[Array, "3 3"]) -> Float[Array, ""]:
    """Logarithm of the corrected constant."""
    Q, one = weight(place), jnp.eye(3)
    equation = jnp.kron(matrix.T, one) + jnp.kron(one, matrix.T)
    P = jnp.linalg.solve(equation, -Q.reshape(9)).reshape(3, 3)
    axes = jnp.linalg.eigvalsh((P + P.T) / 2)
    radius = 2 * jnp.linalg.norm(P[:, 2]) / jnp.linalg.eigvalsh(Q)[0]
    return jnp.log(radius) + (jnp.log(axes[2]) - jnp.log(axes[0])) / 2
