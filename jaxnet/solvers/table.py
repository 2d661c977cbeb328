"""Sums into rows and columns of tables, one link after the other."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxnet.model import xla
from jaxnet.model.shapes import LoopIndex

BlockTable = Float[Array, "blocks size _ axes lanes"]
TablePlace = tuple[Any, ...]  # on the first axes of a table


def add_weights(
    table: BlockTable,
    columns: Int[Array, "slots blocks size"],
    heard: Float[Array, "slots blocks size axes lanes"],
) -> BlockTable:
    blocks, size = table.shape[:2]

    def link(number: LoopIndex) -> tuple[TablePlace, jax.Array]:
        slot, row = jnp.divmod(number, blocks * size)
        block, row = jnp.divmod(row, size)
        return (block, row, columns[slot, block, row]), heard[slot, block, row]

    # One by one: 1.7 times, trimming, 12 vehicles; 1.2 times, 1,000.
    return add_each(table, columns.size, columns.size, link)


def add_each(
    table: Float[Array, "*table"],
    most: int,
    links: LoopIndex | int,
    link: Callable[[LoopIndex], tuple[TablePlace, Float[Array, "*some"]]],
) -> Float[Array, "*table"]:
    """Add to a table what each of the first `links` links, of `most`, gives, at its place."""

    def one(number: LoopIndex, table: jax.Array) -> jax.Array:
        place, by = link(number)
        return xla.add_slice(table, place, by[(None,) * len(place)])

    def together() -> jax.Array:
        places, by = jax.vmap(link)(jnp.arange(most))
        there = jnp.arange(most) < links
        return table.at[places].add(jnp.where(there.reshape(-1, *[1] * (by.ndim - 1)), by, 0.0))

    return xla.on_cpus(lambda: jax.lax.fori_loop(0, links, one, table), together)
