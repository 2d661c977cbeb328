"""Random numbers that a lane draws at an instant.

A number depends only on the lane, the time and the purpose. Other lanes and the engine do not change it.
"""

import functools
import zlib
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt32

LaneValues = Float[Array, " lanes"]
Jet = Float[Array, "2 slots m lanes"]


def drawn(
    key: Float[Array, " lanes"],
    time: Float[Array, " lanes"],
    purpose: str,
    sampler: Callable[[Array, tuple[int, ...]], Array],
    shape: tuple[int, ...],
) -> Float[Array, "*shape lanes"]:
    """Return `sampler(key, shape)` for each lane.

    The key of a draw derives from the key of the lane, the time and the purpose. Each lane needs a unique
    number as its key. The time [s] must be equal to the last bit in every engine.
    """

    def one(number: Float[Array, ""], instant: Float[Array, ""]) -> Array:
        found = jax.random.wrap_key_data(halves(number), impl="threefry2x32")
        for word in (np.uint32(zlib.crc32(purpose.encode())), *halves(instant)):
            found = jax.random.fold_in(found, word)
        return sampler(found, shape)

    return jax.vmap(one, -1, -1)(key, time)


def halves(number: Float[Array, ""]) -> UInt32[Array, "2"]:
    """Return the 64 bits of a number as two halves of 32 bits."""
    return jax.lax.bitcast_convert_type(number, jnp.uint32)


def noisy(
    jets: Sequence[Jet], size: LaneValues, key: LaneValues, time: LaneValues, first: int = 0
) -> tuple[Jet, ...]:
    """Return jets with independent normal errors of standard deviation `size`.

    If all sizes are 0, the jets stay unchanged bit by bit. `first` is the order of the first jet. Each order
    has its own draws.

    The conditional computes the noisy jets once, before any use. Otherwise a compiler may compute them again
    at each use with different rounding. A source would then differ from itself in a comparison.
    """

    def wrong(order: int, jet: Jet) -> Jet:
        by = drawn(key, time, f"noise {order}", jax.random.normal, jet.shape[:-1])
        return jet + size[None, None, None] * by

    return tuple(
        jax.lax.cond(size.any(), functools.partial(wrong, order), lambda jet: jet, jet)
        for order, jet in enumerate(jets, first)
    )
