"""Tables of weights by row and column, from weights by slot."""

import jax
import numpy as np
from jaxtyping import Array, Float, Int

from jaxnet.model import xla
from jaxnet.model.shapes import LoopIndex

BlockTable = Float[Array, "blocks size _ axes lanes"]


def add_weights(
    table: BlockTable,
    columns: Int[Array, "slots blocks size"],
    heard: Float[Array, "slots blocks size axes lanes"],
) -> BlockTable:
    """Add the weight of each slot to its column of a table of blocks."""
    blocks, size = table.shape[:2]

    def one(number: LoopIndex, table: BlockTable) -> BlockTable:
        slot, row = jax.numpy.divmod(number, blocks * size)
        block, row = jax.numpy.divmod(row, size)
        place = block, row, columns[slot, block, row]
        return xla.add_slice(table, place, heard[slot, block, row][None, None, None])

    rows = np.arange(blocks)[None, :, None], np.arange(size)[None, None]
    return xla.on_cpus(  # 1.7 times, trimming, 12 vehicles; 1.2 times, 1,000
        lambda: jax.lax.fori_loop(0, columns.size, one, table),
        lambda: table.at[(*rows, columns)].add(heard, mode="promise_in_bounds"),
    )
