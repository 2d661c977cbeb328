"""Where XLA is to compute something once.

Left to itself, it computes what several expressions use anew in each of them, and for each of their elements
that uses it; a barrier does not keep it from that on CPUs.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

Tree = TypeVar("Tree", bound=Any)


def computed(work: Callable[[], Tree]) -> Tree:
    """What the work gives, by a loop of one pass."""
    nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), jax.eval_shape(work))
    more, done = jnp.ones((), bool), jnp.zeros((), bool)
    return jax.lax.while_loop(lambda carry: carry[0], lambda _: (done, work()), (more, nothing))[1]
