"""Direct solution of `L x = b` for the graph in force.

A reverse Cuthill–McKee order places vehicles that hear each other close together. Blocks of that order hear
only vehicles of their own block and of the two adjacent blocks. L is then block tridiagonal, and elimination
from block to block takes a time linear in the number of vehicles.

- If no order gives several small blocks, all vehicles form one block.
- If the blocks would be too large, `iteration` solves instead.
- Retained sources are a subset of the sources that a vehicle hears. One order therefore serves all lanes and
  ticks.
- L is a row diagonally dominant M-matrix. Elimination therefore needs no pivot search.

The navigator reaches every vehicle over the weights in force if and only if `L⁻¹ a0 = 1`. The residual is the
distance of `L⁻¹ a0` from 1. It is of the order of rounding if the graph is connected. It is of order 1 or NaN
if a vehicle is cut off. For iteration, the residual is a bound on the error, infinite if a vehicle is cut
off.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxnet.model import iteration, xla
from jaxnet.model.hearing import AxisWeights, Hearing

AT_ONCE = 4  # pivot rows, or columns of a product, in one pass over the other rows
LEFT_OUT = 6  # maximum number of removals of finished columns; each compiles another program
SMALL = 2  # vehicles in a block, up to which recomputation is faster than storage
LEAST_BLOCKS = 8  # fewer blocks are no faster than one block
LARGEST_BLOCK = 96  # vehicles; iteration is faster than larger blocks

Columns = Float[Array, "m columns axes lanes"]
Blocks = Float[Array, "blocks size _ axes lanes"]
RightSides = Float[Array, "blocks axes size lanes"]
Products = Float[Array, "blocks size axes size lanes"]
Residual = Float[Array, " lanes"]


class Order(NamedTuple):
    """Vehicles in blocks; each block hears only vehicles of itself and of the two adjacent blocks."""

    vehicles: Int[Any, "blocks size"]  # vehicle at each place, from 0; m at an unused place
    place: Int[Any, " m"]  # place of each vehicle, counted through all blocks


class NoOrder(NamedTuple):
    """The absence of an order with small enough blocks; the solver then iterates."""


class Factors(NamedTuple):
    """Factors of one L for repeated solves, with matrices stored by columns.

    The forward pass over the blocks is `x_k = inverse b_k + before x_{k-1}`. The backward pass is `x_k +
    after x_{k+1}`. A single block needs only `inverse`.
    """

    inverse: Products
    before: Products
    after: Products


class Weighted(NamedTuple):
    """Weights and a norm bound of one L for repeated solves by iteration."""

    weights: AxisWeights  # weights of vehicles, without the navigator
    bound: iteration.InverseBound


def order_of(sources: Int[np.ndarray, "slots m"], one_block: int) -> Order | NoOrder:
    """Return the reverse Cuthill–McKee order, with the bandwidth of the graph as block size.

    Up to `one_block` vehicles form one block. A graph with fewer than LEAST_BLOCKS blocks also becomes one
    block. The result is NoOrder if a block would exceed LARGEST_BLOCK vehicles.
    """
    m = sources.shape[1]
    if m > one_block:
        vehicles, place, size = near_each_other(sources)
        blocks = -(-m // size)
        if min(m, size if blocks >= LEAST_BLOCKS else m) > LARGEST_BLOCK:
            return NoOrder()
        if blocks >= LEAST_BLOCKS:
            filled = np.append(vehicles, np.full(blocks * size - m, m))
            return Order(filled.reshape(blocks, size), place)
    return Order(np.arange(m)[None], np.arange(m))


def near_each_other(sources: Int[np.ndarray, "slots m"]) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the vehicles in reverse Cuthill–McKee order, the place of each vehicle, and the bandwidth.

    The bandwidth is the greatest distance in that order between a listener and its source, at least 2.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    m = sources.shape[1]
    listeners, heard = np.nonzero(sources > 0)[1], sources[sources > 0] - 1
    pairs = np.concatenate([[listeners, heard], [heard, listeners]], axis=1)
    mutual = csr_array((np.ones(pairs.shape[1]), pairs), shape=(m, m))
    vehicles = np.asarray(reverse_cuthill_mckee(mutual, symmetric_mode=True), dtype=int)
    place = np.argsort(vehicles)
    return vehicles, place, max(2, int(np.abs(place[listeners] - place[heard]).max(initial=0)))


def solve(
    order: Order | NoOrder, hearing: Hearing, weights: AxisWeights, right: Columns
) -> tuple[Columns, Residual]:
    """Solve `L x = b` for several columns b, and return the solution and the residual of `L⁻¹ a0 = 1`."""
    if isinstance(order, NoOrder):
        factors, residual = made_ready(hearing, weights)
        solution, error = iteration.certified(hearing, *factors, right, jnp.zeros_like(right))
        return solution, jnp.maximum(residual, error.max(axis=(0, 1)))
    before, own, after, navigator = spread_out(order, hearing, weights)
    whole = jnp.concatenate([in_blocks(order, right), navigator], axis=2)
    if len(own) == 1:
        found = eliminated(jnp.concatenate([own[0], whole[0]], axis=1))[None]
    else:
        found = from_block_to_block(before, own, after, whole)
    solution = by_vehicle(order, found)
    return solution[:, :-1], off_one(solution[:, -1])


def from_block_to_block(before: Blocks, own: Blocks, after: Blocks, right: Blocks) -> Blocks:
    """Solve a block tridiagonal system for several columns, by a forward and a backward pass."""
    size = own.shape[1]

    def there(last: Any, block: Any) -> tuple[Any, Any]:
        before, own, beyond = block

        def rest() -> jax.Array:
            carried = multiplied(before, last)
            beside = beyond.at[:, size:].add(carried[:, size:])
            return jnp.concatenate([own - carried[:, :size], beside], axis=1)

        found = eliminated(rest() if size <= SMALL else xla.materialised(rest))
        return found, found

    def back(following: Any, block: Any) -> tuple[Any, Any]:
        found = block[:, size:] + multiplied(block[:, :size], following)
        return found, found

    beyond = jnp.concatenate([after, right], axis=2)
    _, parts = jax.lax.scan(there, jnp.zeros_like(beyond[0]), (before, own, beyond))
    return jax.lax.scan(back, jnp.zeros_like(right[0]), parts, reverse=True)[1]


def factorised(
    order: Order | NoOrder, hearing: Hearing, weights: AxisWeights
) -> tuple[Factors | Weighted, Residual]:
    """Factorise L for repeated solves, and return the factors and the residual of `L⁻¹ a0 = 1`."""
    if isinstance(order, NoOrder):
        return made_ready(hearing, weights)
    before, own, after, navigator = spread_out(order, hearing, weights)
    eye = identity(own)[0]

    def there(last: Any, block: Any) -> tuple[Any, Any]:
        before, own, after = block
        rest = jnp.concatenate([own - multiplied(before, last), eye, before, after], axis=1)
        found = jnp.split(eliminated(rest), 3, axis=1)
        return found[2], tuple(found)

    if len(own) == 1:
        found = eliminated(jnp.concatenate([own[0], eye], axis=1))[None], before, after
    else:
        _, found = jax.lax.scan(there, jnp.zeros_like(own[0]), (before, own, after))
    factors = Factors(*(jnp.moveaxis(each, 1, 3) for each in found))
    reached = through(factors, navigator[:, :, 0].swapaxes(1, 2))
    return factors, off_one(by_vehicle(order, reached.swapaxes(1, 2)))


def made_ready(hearing: Hearing, weights: AxisWeights) -> tuple[Weighted, Residual]:
    """Return weights and norm bound of L for repeated solves by iteration, and a residual.

    The residual is infinite where a vehicle is cut off, and 0 elsewhere.
    """
    bound = iteration.inverse_bound(hearing, weights)
    cut_off = jnp.isinf(bound).any(axis=0)
    return Weighted(iteration.of_vehicles(hearing, weights), bound), jnp.where(cut_off, jnp.inf, 0.0)


def applied(
    order: Order | NoOrder,
    hearing: Hearing,
    factors: Factors | Weighted,
    right: Float[Array, "2 m lanes"],
    start: Any,
) -> Float[Array, "2 m lanes"]:
    """Return `L⁻¹` times one vector on each axis.

    `start` is the initial guess of the iteration, None for 0. Direct solution ignores `start`.
    """
    if isinstance(factors, Weighted):
        start = jnp.zeros_like(right) if start is None else start
        right, start = (
            jnp.moveaxis(each.reshape(len(factors.weights), -1, *each.shape[1:]), 2, 0).swapaxes(1, 2)
            for each in (right, start)
        )
        found = iteration.certified(hearing, *factors, right, start)[0]
        found = jnp.moveaxis(found.swapaxes(1, 2), 0, 2)
        return found.reshape(2, *found.shape[2:])
    assert isinstance(order, Order)
    found = through(factors, in_blocks(order, right.swapaxes(0, 1)).swapaxes(1, 2))
    return by_vehicle(order, found.swapaxes(1, 2)).swapaxes(0, 1)


def through(factors: Factors, right: RightSides) -> RightSides:
    """Solve with the factors of L, by a forward and a backward pass over the blocks."""
    if len(right) == 1:
        return product(factors.inverse[0], right[0])[None]

    def there(last: Any, block: Any) -> tuple[Any, Any]:
        inverse, before, right = block
        found = product(inverse, right) + product(before, last)
        return found, found

    def back(following: Any, block: Any) -> tuple[Any, Any]:
        after, right = block
        found = right + product(after, following)
        return found, found

    nothing = jnp.zeros_like(right[0])
    _, halfway = jax.lax.scan(there, nothing, (factors.inverse, factors.before, right))
    return jax.lax.scan(back, nothing, (factors.after, halfway), reverse=True)[1]


def spread_out(order: Order, hearing: Hearing, weights: AxisWeights) -> tuple[Blocks, Blocks, Blocks, Blocks]:
    """Return the blocks of L and the weights of the navigator.

    The four arrays are:

    - the weights of vehicles in the previous block,
    - L within the block,
    - the weights of vehicles in the next block,
    - a0, the weights of the navigator.

    A single block has empty arrays for the previous and the next block.
    """
    blocks, size = order.vehicles.shape
    carried_sources = hearing.carried_sources.at[:, order.vehicles].get(mode="fill", fill_value=0)
    heard = jnp.moveaxis(weights, 0, 2).at[:, order.vehicles].get(mode="fill", fill_value=0.0)
    first = (jnp.arange(blocks)[:, None] - int(blocks > 1)) * size  # place of the first column after a0
    columns = jnp.where(
        carried_sources > 0, jnp.asarray(order.place)[carried_sources - 1] - first[None] + 1, 0
    )
    width = 1 + (size if blocks == 1 else 3 * size)
    nothing = jnp.zeros((blocks, size, width, *heard.shape[3:]))
    table = summed(nothing, columns, heard)
    navigator, rest = table[:, :, :1], table[:, :, 1:]
    before, own, after = (rest[:, :, :0], rest, rest[:, :, :0]) if blocks == 1 else jnp.split(rest, 3, axis=2)
    return before, identity(own) - own, after, navigator


def summed(table: Blocks, columns: Int[Any, "slots blocks size"], heard: Any) -> Blocks:
    """Add the weight of each slot to its column of a table of blocks.

    `heard` has the shape (slots, blocks, size, axes, lanes).
    """
    blocks, size = table.shape[:2]

    def one(number: Any, table: Blocks) -> Blocks:
        slot, row = jnp.divmod(number, blocks * size)
        block, row = jnp.divmod(row, size)
        place = block, row, columns[slot, block, row]
        return xla.add_slice(table, place, heard[slot, block, row][None, None, None])

    rows = np.arange(blocks)[None, :, None], np.arange(size)[None, None]
    return xla.on_cpus(
        lambda: jax.lax.fori_loop(0, columns.size, one, table),
        lambda: table.at[(*rows, columns)].add(heard, mode="promise_in_bounds"),
    )


def identity(blocks: Blocks) -> Blocks:
    """Return the identity matrix in the shape of the blocks, equal for each axis and lane."""
    eye = jnp.eye(blocks.shape[1])
    return jnp.broadcast_to(eye[None, :, :, None, None], blocks.shape)


def in_blocks(order: Order, by_vehicle: Any) -> Any:
    """Arrange values of vehicles by block and place, with 0 at unused places."""
    if len(order.vehicles) == 1:
        return by_vehicle[None]
    return by_vehicle.at[order.vehicles].get(mode="fill", fill_value=0.0)


def by_vehicle(order: Order, blocks: Any) -> Any:
    """Arrange values of blocks and places by vehicle."""
    if len(order.vehicles) == 1:
        return blocks[0]
    return blocks.reshape(-1, *blocks.shape[2:]).at[order.place].get(mode="promise_in_bounds")


def off_one(reached: Float[Array, "m axes lanes"]) -> Residual:
    """Return the greatest distance of `L⁻¹ a0` from 1 in each lane."""
    return jnp.abs(reached - 1.0).max(axis=(0, 1))


def multiplied(left: Float[Array, "n n axes lanes"], right: Float[Array, "n c axes lanes"]) -> Any:
    """Return the product of two small matrices, for each axis and lane."""
    total = left[:, :1] * right[:1]
    for n in range(1, len(right)):
        total = total + left[:, n : n + 1] * right[n : n + 1]
    return total


def product(columns: Float[Array, "n axes m lanes"], vectors: Float[Array, "components n lanes"]) -> Any:
    """Multiply a matrix, given by its columns, with vectors in each lane.

    The matrix has one axis for both components, or one for each component. The batched product of XLA handles
    one lane at a time; for small matrices it is several times slower than this loop.
    """
    at_once = in_one_pass(len(columns))

    def add(block: Any, total: jax.Array) -> jax.Array:
        for number in range(at_once):
            j = block * at_once + number
            total = total + columns[j] * jax.lax.dynamic_index_in_dim(vectors, j, axis=1)
        return total

    nothing = jnp.zeros((len(vectors), *columns.shape[2:]))
    return jax.lax.fori_loop(0, len(columns) // at_once, add, nothing)


def in_one_pass(number: int) -> int:
    """Return the number of columns for one pass: the greatest divisor up to AT_ONCE."""
    return max(n for n in range(1, AT_ONCE + 1) if number % n == 0)


def eliminated(whole: Float[Array, "n c axes lanes"]) -> Float[Array, "n r axes lanes"]:
    """Return `M⁻¹ B` for `[M | B]` by blocked Gauss–Jordan elimination, vectorised over lanes.

    AT_ONCE pivot rows at the front eliminate the other rows and then move to the back. Most of the time goes
    into passes over the other rows. Several pivot rows therefore share one pass.

    The function removes finished columns. It does so at every pass for small matrices, and after several
    passes for large ones. Each removal changes the shape and compiles another program.
    """
    passes, rest = divmod(len(whole), AT_ONCE)
    at_a_time = max(1, -(-passes // LEFT_OUT))

    def one(_: Any, rows: jax.Array) -> jax.Array:
        return jnp.concatenate([eliminate(rows, AT_ONCE), rows[:, :AT_ONCE]], axis=1)

    for done in range(0, passes, at_a_time):
        number = min(at_a_time, passes - done)
        whole = eliminate(jax.lax.fori_loop(1, number, one, whole) if number > 1 else whole, AT_ONCE)
        whole = whole[:, : whole.shape[1] - (number - 1) * AT_ONCE]
    return eliminate(whole, rest) if rest else whole


def eliminate(rows: Float[Array, "n c axes lanes"], first: int) -> Float[Array, "n r axes lanes"]:
    """Eliminate with the first rows, move these rows to the back, and remove their columns.

    `first` is the number of pivot rows.
    """
    if len(rows) == first:
        return reduced(rows)
    pivots = xla.materialised(lambda: reduced(rows[:first]))
    return jnp.concatenate([without(rows[first:], pivots), pivots])


def reduced(rows: Float[Array, "k c axes lanes"]) -> Float[Array, "k r axes lanes"]:
    """Return `P⁻¹ R` for `[P | R]` with few rows."""
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


def without(rows: Float[Array, "n c axes lanes"], pivots: Float[Array, "k r axes lanes"]) -> Any:
    """Subtract multiples of k pivot rows from rows, and remove the first k columns, which become 0."""
    left = rows[:, len(pivots) :]
    for n, pivot in enumerate(pivots):
        left = left - rows[:, n : n + 1] * pivot[None]
    return left
