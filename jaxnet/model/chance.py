"""Random numbers that a lane draws at an instant, the same whatever lanes are beside it and whoever asks."""

import functools
import zlib
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def drawn(
    key: Float[Array, " lanes"],
    time: Float[Array, " lanes"],
    purpose: str,
    sampler: Callable[[Any, Any], Any],
    shape: tuple[int, ...],
) -> Float[Array, "*shape lanes"]:
    """`sampler(key, shape)` of each lane, with a key that follows from the lane's, the time and the purpose.

    A lane's key is a number that no other lane has, a time [s] one that every engine reaches to the last bit.
    """

    def one(number: Any, instant: Any) -> Any:
        found = jax.random.wrap_key_data(halves(number), impl="threefry2x32")
        for word in (np.uint32(zlib.crc32(purpose.encode())), *halves(instant)):
            found = jax.random.fold_in(found, word)
        return sampler(found, shape)

    return jax.vmap(one, -1, -1)(key, time)


def halves(number: Float[Array, ""]) -> Any:
    """The 64 bits of a number in two halves."""
    return jax.lax.bitcast_convert_type(number, jnp.uint32)


def noisy(
    jets: Any, size: Float[Array, " lanes"], key: Float[Array, " lanes"], time: Any, first: int = 0
) -> tuple[Any, ...]:
    """Jets with independent normal errors of this standard deviation; where all are 0, bit by bit the same.

    `first` is the order of the first jet; errors of each order are drawn apart.

    They are computed before they are used: a compiler that computes them at each use may round them
    otherwise at each, and a source is then farther out than itself.
    """

    def wrong(order: int, jet: Any) -> Any:
        by = drawn(key, time, f"noise {order}", jax.random.normal, jet.shape[:-1])
        return jet + size[None, None, None] * by

    return tuple(
        jax.lax.cond(size.any(), functools.partial(wrong, order), lambda jet: jet, jet)
        for order, jet in enumerate(jets, first)
    )
