"""Random numbers that belong to what they are for, and to nothing else.

One uniform number belongs to (seed, the quantity's dotted name, sample, vehicle, component): it does not
change with the number of samples, the order in which lanes run, or any other key. Every distribution is its
inverse CDF of that number, so cells that differ in anything share their draws (common random numbers).
"""

import zlib
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from jaxnet.study import config

COMPONENTS = 4  # slots of one vehicle's quantity
DRAWN = 2  # components drawn, wanted or not, so that all quantities share a compiled program
BLOCK = 256  # samples drawn by one call of the compiled program

Draws = Float[np.ndarray, "samples vehicles components"]


def draw(
    number: Any,
    seed: int,
    name: str,
    samples: Sequence[int],
    vehicles: Sequence[int],
    components: int = 1,
) -> Draws:
    """Values of a number or distribution for each sample, vehicle (0: the lane's own) and component."""
    shape = (len(samples), len(vehicles), components)
    if isinstance(number, float | int):
        return np.full(shape, float(number))
    u = uniforms(seed, name, samples, vehicles, components)
    match number:
        case config.Uniform(uniform=[low, high]):
            return low + (high - low) * u
        case config.Normal(normal=[mean, deviation]):
            with jax.enable_x64(True):
                return mean + deviation * np.asarray(jax.scipy.special.ndtri(u))
        case config.Choice(choice=values):
            return np.array(values)[(u * len(values)).astype(int)]
    raise TypeError(f"not a number or distribution: {number!r}")


def uniforms(seed: int, name: str, samples: Sequence[int], vehicles: Sequence[int], components: int) -> Draws:
    """Uniform numbers inside (0, 1), in steps of 2⁻⁵³."""
    assert components <= DRAWN
    slots = np.array([[v * COMPONENTS + c for c in range(DRAWN)] for v in vehicles], np.uint32)
    padded = np.zeros(-(-len(samples) // BLOCK) * BLOCK, np.uint32)
    padded[: len(samples)] = samples
    with jax.enable_x64(True):
        key = jax.random.fold_in(jax.random.key(seed), zlib.crc32(name.encode()))
        blocks = [np.asarray(bits(key, block, slots)) for block in padded.reshape(-1, BLOCK)]
    drawn = np.concatenate(blocks)[: len(samples), :, :components]
    return ((drawn >> 11) + 0.5) * 2.0**-53


@jax.jit
def bits(key: Any, samples: Any, slots: Any) -> Any:
    """64 random bits for each sample and slot."""

    def one(sample: Any, slot: Any) -> Any:
        return jax.random.bits(jax.random.fold_in(jax.random.fold_in(key, sample), slot), (), "uint64")

    per_slot = jax.vmap(jax.vmap(one, (None, 0)), (None, 0))
    return jax.vmap(per_slot, (0, None))(samples, slots)
