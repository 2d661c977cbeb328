"""Products and Gauss–Jordan elimination of small matrices, vectorised over lanes, the last axis.

A matrix (n, c, axes, lanes) has n rows and c columns. Elimination does not search for pivots: it is
for diagonally dominant and for positive definite matrices.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.model import xla
from jaxnet.model.shapes import LoopIndex

# Pivot rows, or columns of a product, in a pass: 1.3 times, trimming, 12 vehicles; 1.04, 1,000.
AT_ONCE = 4
# Most removals of finished columns, a program each: 1.07 times, trimming, 12 vehicles.
LEFT_OUT = 6

Matrix = Float[Array, "n c axes lanes"]


def identity(matrix: Float[Array, "... n n axes lanes"]) -> Float[Array, "... n n axes lanes"]:
    """The identity matrix in the shape of square matrices, equal for each axis and lane."""
    return jnp.broadcast_to(jnp.eye(matrix.shape[-3])[:, :, None, None], matrix.shape)


def multiplied(left: Float[Array, "n n axes lanes"], right: Matrix) -> Matrix:
    total = left[:, :1] * right[:1]
    for n in range(1, len(right)):
        total = total + left[:, n : n + 1] * right[n : n + 1]
    return total


def product(
    columns: Float[Array, "n axes m lanes"], vectors: Float[Array, "components n lanes"]
) -> Float[Array, "components m lanes"]:
    """Multiply a matrix, given by its columns, with vectors in each lane.

    The matrix has one axis for both components, or one for each component. The batched product of
    XLA handles one lane at a time. This loop makes the nonlinear engine 1.9 times as fast, plain,
    12 vehicles.
    """
    at_once = max(n for n in range(1, AT_ONCE + 1) if len(columns) % n == 0)

    def add(block: LoopIndex, total: jax.Array) -> jax.Array:
        for number in range(at_once):
            j = block * at_once + number
            total = total + columns[j] * jax.lax.dynamic_index_in_dim(vectors, j, axis=1)
        return total

    nothing = jnp.zeros((len(vectors), *columns.shape[2:]))
    return jax.lax.fori_loop(0, len(columns) // at_once, add, nothing)


def eliminated(whole: Matrix) -> Float[Array, "n r axes lanes"]:
    """`M⁻¹ B` for `[M | B]` by blocked Gauss–Jordan elimination, vectorised over lanes.

    AT_ONCE pivot rows at the front eliminate the other rows and then move to the back. Most of the
    time goes into passes over the other rows. Several pivot rows therefore share one pass.

    The function removes finished columns. It does so at every pass for small matrices, and after
    several passes for large ones. Each removal changes the shape and compiles another program.
    """
    passes, rest = divmod(len(whole), AT_ONCE)
    at_a_time = max(1, -(-passes // LEFT_OUT))

    def one(_: LoopIndex, rows: jax.Array) -> jax.Array:
        return jnp.concatenate([eliminate(rows, AT_ONCE), rows[:, :AT_ONCE]], axis=1)

    for done in range(0, passes, at_a_time):
        number = min(at_a_time, passes - done)
        if number > 1:
            whole = jax.lax.fori_loop(1, number, one, whole)
        whole = eliminate(whole, AT_ONCE)
        whole = whole[:, : whole.shape[1] - (number - 1) * AT_ONCE]
    return eliminate(whole, rest) if rest else whole


def eliminate(rows: Matrix, first: int) -> Float[Array, "n r axes lanes"]:
    """Eliminate with the `first` pivot rows, move them to the back and remove their columns."""
    if len(rows) == first:
        return reduced(rows)
    pivots = xla.materialised(lambda: reduced(rows[:first]))  # 1.09 times, trimming, 12 vehicles
    return jnp.concatenate([without(rows[first:], pivots), pivots])


def reduced(rows: Float[Array, "k c axes lanes"]) -> Float[Array, "k r axes lanes"]:
    """`P⁻¹ R` for `[P | R]` with few rows."""
    if len(rows) == 1:
        return rows[:, 1:] / rows[:, :1]
    if len(rows) == 2:
        (a, b), (c, d) = rows[0, :2], rows[1, :2]
        inverse = 1 / (a * d - b * c)
        a, b, c, d = (each[None] * inverse[None] for each in (a, b, c, d))
        return jnp.stack([d * rows[0, 2:] - b * rows[1, 2:], a * rows[1, 2:] - c * rows[0, 2:]])
    first = reduced(rows[:2])
    others = reduced(without(rows[2:], first))
    return jnp.concatenate([without(first, others), others])


def without(rows: Matrix, pivots: Float[Array, "k r axes lanes"]) -> Float[Array, "n r axes lanes"]:
    """Subtract multiples of k pivot rows, and remove the first k columns, which become 0."""
    left = rows[:, len(pivots) :]
    for n, pivot in enumerate(pivots):
        left = left - rows[:, n : n + 1] * pivot[None]
    return left
