"""What is said otherwise to XLA on CPUs.

There it compiles a loop as one function, rather than operation by operation, if it is told to by a flag
(`runs.cache`) and nothing in the loop scatters. And what several expressions use it computes anew in each of
them, and for each of their elements that uses it; a barrier does not keep it from that. Accelerators scatter
well, and there each pass of a loop costs something.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

Tree = TypeVar("Tree", bound=Any)


def on_cpus(work: Callable[[], Tree], elsewhere: Callable[[], Tree]) -> Tree:
    """What the work gives; on accelerators, what is the same said otherwise."""
    device = jax.config.values["jax_default_device"] or jax.devices()[0]  # for which it is traced
    platform = getattr(device, "platform", device)  # it may be told by its platform's name
    return work() if platform == "cpu" else elsewhere()


def materialised(work: Callable[[], Tree]) -> Tree:
    """What the work gives, computed once: on CPUs by a loop of one pass."""

    def in_a_loop() -> Tree:
        traced_once = jax.jit(work)
        shapes = jax.eval_shape(traced_once)
        nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
        more, done = jnp.ones((), bool), jnp.zeros((), bool)
        carry = more, nothing
        return jax.lax.while_loop(lambda carry: carry[0], lambda _: (done, traced_once()), carry)[1]

    return on_cpus(in_a_loop, work)


def add_slice(array: jax.Array, place: tuple[Any, ...], by: jax.Array) -> jax.Array:
    """The array with something of as many axes added from a place on, named on the first axes; no scatter."""
    start = (*place, *[0] * (array.ndim - len(place)))
    before = jax.lax.dynamic_slice(array, start, by.shape)
    return jax.lax.dynamic_update_slice(array, before + by, start)
