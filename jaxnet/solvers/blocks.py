"""Block elimination, for graphs in which vehicles that hear each other stand close together.

Each block hears only vehicles of its own block and of the two adjacent blocks. L is then block
tridiagonal, and elimination from block to block takes a time linear in the number of vehicles.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxnet.model.elimination import eliminated, identity, multiplied, product
from jaxnet.model.hearing import AxisWeights, Hearing
from jaxnet.solvers.solver import Solver, off_one
from jaxnet.solvers.table import BlockTable, add_weights

RightSides = Float[Array, "blocks axes size lanes"]
Products = Float[Array, "blocks size axes size lanes"]
Side = Float[Array, "components size lanes"]  # of one block, as the next two
Product = Float[Array, "size axes size lanes"]
Block = Float[Array, "size _ axes lanes"]
ThreeBlocks = tuple[Block, Block, Block]


class BlockFactors(NamedTuple):
    """Factors of one L for repeated solves, with matrices stored by columns.

    The forward pass over the blocks is `x_k = inverse b_k + before x_{k-1}`. The backward pass is
    `x_k + after x_{k+1}`.
    """

    inverse: Products
    before: Products
    after: Products


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Blocks(Solver[BlockFactors]):
    """Elimination from block to block."""

    vehicles: Int[Any, "blocks size"]  # vehicle at each place, from 0; m at an unused place
    place: Int[Any, " m"]  # place of each vehicle, counted through all blocks

    def solve(self, hearing, weights, right):
        before, own, after, navigator = self.blocks_of(hearing, weights)
        whole = jnp.concatenate([self.in_blocks(right), navigator], axis=2)
        solution = self.by_vehicle(from_block_to_block(before, own, after, whole))
        return solution[:, :-1], off_one(solution[:, -1])

    def factorise(self, hearing, weights):
        """The factors of L from block to block, and the residual of `L⁻¹ a0 = 1`."""
        before, own, after, navigator = self.blocks_of(hearing, weights)
        eye = identity(own[0])

        def there(last: Block, block: ThreeBlocks) -> tuple[Block, ThreeBlocks]:
            before, own, after = block
            rest = jnp.concatenate([own - multiplied(before, last), eye, before, after], axis=1)
            found = jnp.split(eliminated(rest), 3, axis=1)
            return found[2], (found[0], found[1], found[2])

        _, found = jax.lax.scan(there, jnp.zeros_like(own[0]), (before, own, after))
        factors = BlockFactors(*(jnp.moveaxis(each, 1, 3) for each in found))
        reached = through(factors, navigator[:, :, 0].swapaxes(1, 2))
        return factors, off_one(self.by_vehicle(reached.swapaxes(1, 2)))

    def apply(self, hearing, factors, right, start):
        found = through(factors, self.in_blocks(right.swapaxes(0, 1)).swapaxes(1, 2))
        return self.by_vehicle(found.swapaxes(1, 2)).swapaxes(0, 1)

    def blocks_of(
        self, hearing: Hearing, weights: AxisWeights
    ) -> tuple[BlockTable, BlockTable, BlockTable, BlockTable]:
        """Weights of the previous block's vehicles, L in the block, weights of the next, and a0."""
        blocks, size = self.vehicles.shape
        carried = hearing.carried_sources.at[:, self.vehicles].get(mode="fill", fill_value=0)
        heard = jnp.moveaxis(weights, 0, 2).at[:, self.vehicles].get(mode="fill", fill_value=0.0)
        first = (jnp.arange(blocks)[:, None] - 1) * size  # place of the first column after a0
        place = jnp.asarray(self.place)[carried - 1] - first[None] + 1
        nothing = jnp.zeros((blocks, size, 1 + 3 * size, *heard.shape[3:]))
        table = add_weights(nothing, jnp.where(carried > 0, place, 0), heard)
        before, own, after = jnp.split(table[:, :, 1:], 3, axis=2)
        return before, identity(own) - own, after, table[:, :, :1]

    def in_blocks(self, by_vehicle: Float[Array, "m ..."]) -> Float[Array, "blocks size ..."]:
        """Arrange values of vehicles by block and place, with 0 at unused places."""
        return by_vehicle.at[self.vehicles].get(mode="fill", fill_value=0.0)

    def by_vehicle(self, blocks: Float[Array, "blocks size ..."]) -> Float[Array, "m ..."]:
        """Arrange values of blocks and places by vehicle."""
        return blocks.reshape(-1, *blocks.shape[2:]).at[self.place].get(mode="promise_in_bounds")


def from_block_to_block(
    before: BlockTable, own: BlockTable, after: BlockTable, right: BlockTable
) -> BlockTable:
    """Solve a block tridiagonal system for several columns, by a forward and a backward pass."""
    size = own.shape[1]

    def there(last: Block, block: ThreeBlocks) -> tuple[Block, Block]:
        before, own, beyond = block
        carried = multiplied(before, last)
        beside = beyond.at[:, size:].add(carried[:, size:])
        found = eliminated(jnp.concatenate([own - carried[:, :size], beside], axis=1))
        return found, found

    def back(following: Block, block: Block) -> tuple[Block, Block]:
        found = block[:, size:] + multiplied(block[:, :size], following)
        return found, found

    beyond = jnp.concatenate([after, right], axis=2)
    _, parts = jax.lax.scan(there, jnp.zeros_like(beyond[0]), (before, own, beyond))
    return jax.lax.scan(back, jnp.zeros_like(right[0]), parts, reverse=True)[1]


def through(factors: BlockFactors, right: RightSides) -> RightSides:
    """Solve with the factors of L, by a forward and a backward pass over the blocks."""

    def there(last: Side, block: tuple[Product, Product, Side]) -> tuple[Side, Side]:
        inverse, before, right = block
        found = product(inverse, right) + product(before, last)
        return found, found

    def back(following: Side, block: tuple[Product, Side]) -> tuple[Side, Side]:
        after, right = block
        found = right + product(after, following)
        return found, found

    nothing = jnp.zeros_like(right[0])
    _, halfway = jax.lax.scan(there, nothing, (factors.inverse, factors.before, right))
    return jax.lax.scan(back, nothing, (factors.after, halfway), reverse=True)[1]
