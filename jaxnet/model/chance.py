"""Random numbers that a lane draws at an instant.

A number depends on the lane, the time and the purpose alone, not on other lanes or the engine.

The bits are those of `jax.random` with the same key: Threefry 2x32 of 20 rounds (Salmon, Moraes,
Dror, Shaw, Parallel random numbers: as easy as 1, 2, 3, SC 2011). On CPUs `jax.random` runs the
rounds as a loop with the lanes first. Here the rounds are one expression with the lanes last: 2.8
times, uniform numbers; 16 times, normal numbers.
"""

import functools
import zlib
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, UInt32

from jaxnet.model import xla
from jaxnet.model.circle import polynomial

LaneValues = Float[Any, " lanes"]  # of JAX, or of NumPy where a kind is tried
Jet = Float[Array, "2 slots m lanes"]
Bits = tuple[UInt32[Array, "..."], UInt32[Array, "..."]]

ROTATIONS = ((13, 15, 26, 6), (17, 29, 16, 24))
# Of the inverse of the error function, where -log(1 - x²) is less than 5, and beyond.
INNER = (
    1.50140941,
    0.246640727,
    -0.00417768164,
    -0.00125372503,
    0.00021858087,
    -4.39150654e-06,
    -3.5233877e-06,
    3.43273939e-07,
    2.81022636e-08,
)
OUTER = (
    2.83297682,
    1.00167406,
    0.00943887047,
    -0.0076224613,
    0.00573950773,
    -0.00367342844,
    0.00134934322,
    0.000100950558,
    -0.000200214257,
)
PARITY = np.uint32(0x1BD11BDA)  # of the parts of a key


def drawn(
    key: LaneValues, time: LaneValues, purpose: str, distribution: str, shape: tuple[int, ...]
) -> Float[Array, "*shape lanes"]:
    """Random numbers of a shape for each lane.

    Uniform numbers are at least 0 and less than 1. Normal ones have mean 0 and deviation 1.

    The key of a draw derives from the key of the lane, the time and the purpose. Each lane needs a
    unique number as its key. The time [s] must be equal to the last bit in every engine.
    """
    named = jnp.full(key.shape, zlib.crc32(purpose.encode()), np.uint32)
    found = halves(key)
    for word in (named, *halves(time)):
        # Once for a lane, not for each number: 4 times.
        found = xla.materialised(functools.partial(threefry, found, (jnp.zeros_like(word), word)))
    return SAMPLERS[distribution](found, shape)


def halves(number: LaneValues) -> Bits:
    """The 64 bits of numbers as two halves of 32 bits."""
    both = jax.lax.bitcast_convert_type(number, jnp.uint32)
    return both[..., 0], both[..., 1]


def threefry(key: Bits, counter: Bits) -> Bits:
    """The two words of Threefry 2x32 for a key and a counter."""
    keys = *key, key[0] ^ key[1] ^ PARITY
    first, second = counter[0] + keys[0], counter[1] + keys[1]
    for block in range(5):
        for by in ROTATIONS[block % 2]:
            first = first + second
            second = first ^ (second << np.uint32(by) | second >> np.uint32(32 - by))
        first = first + keys[(block + 1) % 3]
        second = second + keys[(block + 2) % 3] + np.uint32(block + 1)
    return first, second


def words(key: Bits, shape: tuple[int, ...]) -> Bits:
    """Two words of 32 random bits for each number of each lane."""
    number = np.arange(np.prod(shape, dtype=int), dtype=np.uint32).reshape(*shape, 1)
    keys = [part.reshape(*[1] * len(shape), -1) for part in key]
    return threefry((keys[0], keys[1]), (jnp.zeros_like(number), jnp.asarray(number)))


def uniform(key: Bits, shape: tuple[int, ...]) -> Float[Array, "*shape lanes"]:
    """Uniform numbers of 52 random bits, at least 0 and less than 1."""
    high, low = (part.astype(jnp.uint64) for part in words(key, shape))
    mantissa = (high << np.uint64(32) | low) >> np.uint64(12)
    return jax.lax.bitcast_convert_type(mantissa | np.uint64(0x3FF0000000000000), float) - 1.0


def normal(key: Bits, shape: tuple[int, ...]) -> Float[Array, "*shape lanes"]:
    """Normal numbers of 24 random bits, at most 5.5; single precision, error below 1e-6."""
    # Bits apart from numbers: 1.1 times. Whole numbers are the same in any company.
    first = xla.materialised(lambda: words(key, shape)[0])
    odd = (first >> np.uint32(8)).astype(np.int32) * np.int32(2) - np.int32(2**24 - 1)
    return inverse_error(odd.astype(np.float32) * np.float32(2.0**-24)).astype(float) * np.sqrt(2.0)


def inverse_error(number: Float32[Array, "*some"]) -> Float32[Array, "*some"]:
    """Inverse error function (Giles, Approximating the erfinv function, GPU Computing Gems, 2011).

    Both polynomials are computed, then one is chosen: twice as fast as `jax.lax.erf_inv` (normal).
    """
    depth = -jnp.log((1 - number) * (1 + number))
    inner = polynomial(INNER, depth - np.float32(2.5))
    outer = polynomial(OUTER, jnp.sqrt(depth) - np.float32(3))
    return number * jnp.where(depth < 5, inner, outer)


SAMPLERS: dict[str, Callable[[Bits, tuple[int, ...]], Array]] = {
    "uniform": uniform,
    "normal": normal,
}


def noisy(
    jets: Sequence[Jet], size: LaneValues, key: LaneValues, time: LaneValues, first: int = 0
) -> tuple[Jet, ...]:
    """Jets with independent normal errors of standard deviation `size`.

    If all sizes are 0, the jets stay unchanged bit by bit. `first` is the order of the first jet.
    Each order has its own draws.

    The conditional computes the noisy jets once, before any use. Otherwise a compiler may compute
    them again at each use with different rounding. A source would then differ from itself in a
    comparison.
    """

    def wrong(order: int, jet: Jet) -> Jet:
        by = drawn(key, time, f"noise {order}", "normal", jet.shape[:-1])
        return jet + size[None, None, None] * by

    return tuple(
        jax.lax.cond(size.any(), functools.partial(wrong, order), lambda jet: jet, jet)
        for order, jet in enumerate(jets, first)
    )
