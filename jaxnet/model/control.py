"""The law: from what a vehicle knows of itself and what it hears, the jerk that it wants.

    ε = y - Σ_j w_ij (y_j + a_ij),      P(y) = k0 y + k1 ẏ + k2 ÿ
    L q = a0 ⊗ y_0‴ + d‴ - P(ε),        q = y‴

It is the paper's `M u = …` with ψ taken out: 2m unknowns in one dense system become m with two right-hand
sides. P is linear, so a vehicle hears `P(y_j) + P(a_ij) + a_ij‴` from each neighbour j, and from the
navigator the same with y_0‴ on top; the neighbours' own third derivatives are what is solved for.
`definition` has the original.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.model.hearing import AxisWeights, Hearing

Gain = Float[Array, "3 *lanes"]
AT_ONCE = 4  # columns of a product, or rows that eliminate, in one pass over the rest


def feedback(gain: Gain, jets: Any) -> Any:
    """`P(y) = k0 y + k1 ẏ + k2 ÿ` of a signal's jets; further derivatives are left alone."""
    lift = [1] * (jets[0].ndim + 1 - gain.ndim)
    k0, k1, k2 = (each.reshape(*lift, *each.shape) for each in gain)
    return k0 * jets[0] + k1 * jets[1] + k2 * jets[2]


def driven(gain: Gain, jets: Any) -> Any:
    """`R(y) = y‴ + P(y)` of a signal's jets, of which there are four."""
    return feedback(gain, jets) + jets[3]


def demand(
    own: Any,
    path: Float[Array, "2 *lanes"],
    attack: Float[Array, "2 signals *lanes"],
    hearing: Hearing,
    weights: AxisWeights,
    gain: Gain,
) -> Float[Array, "2 m *lanes"]:
    """`a0 ⊗ y_0‴ + d‴ - P(ε)`, from a vehicle's own jets, `R(y_0)`, and `R(a)` of what attacks add."""
    mine = feedback(gain, own)
    sources = jnp.concatenate([path[:, None], mine], axis=1)
    return hearing.mean(weights, sources, attack) - mine


def product(
    columns: Float[Array, "m axes m *lanes"], vectors: Float[Array, "2 m *lanes"]
) -> Float[Array, "2 m *lanes"]:
    """Matrix, given by its columns, of each axis or of both, times vectors, lane by lane.

    XLA's own batched product takes the lanes one by one, which for small matrices is several times slower.
    """
    m, at_once = len(columns), in_one_pass(len(columns))

    def add(block: Any, total: jax.Array) -> jax.Array:
        for number in range(at_once):
            j = block * at_once + number
            total = total + columns[j] * jax.lax.dynamic_index_in_dim(vectors, j, axis=1)
        return total

    return jax.lax.fori_loop(0, m // at_once, add, jnp.zeros_like(vectors))


def in_one_pass(m: int) -> int:
    """How many of m are taken at once."""
    return max(n for n in range(1, AT_ONCE + 1) if m % n == 0)


def solve(
    matrix: Float[Array, "m n *lanes"], right: Float[Array, "m r *lanes"]
) -> tuple[Float[Array, "m r *lanes"], Float[Array, "*lanes"]]:
    """`L⁻¹` times the right-hand sides for a graph `[a0 | A]`, and how far `L⁻¹ a0` is from 1.

    The two agree just when the navigator reaches every vehicle over the weights in force, so the residual
    tells a disconnected graph, where it is of order 1 or not a number.

    Gauss and Jordan's elimination, lane beside lane; L is a row diagonally dominant M-matrix, which needs no
    pivoting. Rows come first when their turn to eliminate has come, some at once, for most of the time goes
    into passing over the others, and go last after it.
    """
    m, at_once, lift = len(matrix), in_one_pass(len(matrix)), [1] * (matrix.ndim - 2)
    laplacian = jnp.eye(m).reshape(m, m, *lift) - matrix[:, 1:]
    whole = jnp.concatenate([laplacian, right, matrix[:, :1]], axis=1)

    def eliminate(rows: jax.Array, _: None) -> tuple[jax.Array, None]:
        pivots, others = list(rows[:at_once]), rows[at_once:, at_once:]
        for n in range(at_once):
            pivots[n] = pivots[n] / pivots[n][n][None]
            pivots = [row if k == n else row - row[n][None] * pivots[n] for k, row in enumerate(pivots)]
        for n, pivot in enumerate(pivots):
            others = others - rows[at_once:, n : n + 1] * pivot[None, at_once:]
        done = jnp.concatenate([others, jnp.stack(pivots)[:, at_once:]])
        return jnp.concatenate([done, rows[:, :at_once]], axis=1), None

    solution = jax.lax.scan(eliminate, whole, None, length=m // at_once)[0][:, : right.shape[1] + 1]
    return solution[:, :-1], jnp.abs(solution[:, -1] - 1.0).max(axis=0)


def invert(
    matrix: Float[Array, "m n *lanes"],
) -> tuple[Float[Array, "m m *lanes"], Float[Array, "*lanes"]]:
    """Columns of `L⁻¹` for the graph `[a0 | A]`, and how far `L⁻¹ a0` is from 1."""
    m, lift = len(matrix), [1] * (matrix.ndim - 2)
    eye = jnp.broadcast_to(jnp.eye(m).reshape(m, m, *lift), (m, m, *matrix.shape[2:]))
    inverse, residual = solve(matrix, eye)
    return inverse.swapaxes(0, 1), residual
