"""Workarounds for XLA on CPUs.

- XLA on CPUs compiles a loop as one function if a flag says so (`runs.cache`) and the loop has no
  scatter. Otherwise it runs the loop operation by operation.
- XLA on CPUs computes a value again in every expression that uses it, and for every element of that
  expression. A barrier does not prevent this.

On accelerators, scatter is fast and each pass of a loop has a cost.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from jaxnet.model.shapes import LoopIndex

Tree = TypeVar("Tree", bound=Any)


def on_cpus(work: Callable[[], Tree], elsewhere: Callable[[], Tree]) -> Tree:
    """Result of `work` on CPUs, of `elsewhere` on accelerators; both must give the same value."""
    device = jax.config.values["jax_default_device"] or jax.devices()[0]  # the target of the trace
    platform = getattr(device, "platform", device)  # a default device may be a platform's name
    return work() if platform == "cpu" else elsewhere()


def materialised(work: Callable[[], Tree]) -> Tree:
    """The result of `work`, computed only once: on CPUs, by a loop of one pass."""

    def in_a_loop() -> Tree:
        traced_once = jax.jit(work)
        shapes = jax.eval_shape(traced_once)
        nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
        more, done = jnp.ones((), bool), jnp.zeros((), bool)
        carry = more, nothing
        return jax.lax.while_loop(lambda carry: carry[0], lambda _: (done, traced_once()), carry)[1]

    return on_cpus(in_a_loop, work)


def stored(values: Tree) -> Tree:
    """Values, each computed only once."""
    return materialised(lambda: values)


def add_slice(array: jax.Array, place: tuple[int | LoopIndex, ...], by: jax.Array) -> jax.Array:
    """Add `by` to a slice of an array without a scatter, and return the array.

    `place` holds the start of the slice on the first axes; the slice starts at 0 on the other axes.
    """
    start = (*place, *[0] * (array.ndim - len(place)))
    before = jax.lax.dynamic_slice(array, start, by.shape)
    return jax.lax.dynamic_update_slice(array, before + by, start)


def in_any_row(flags: jax.Array) -> jax.Array:
    """For each lane, the last axis, whether any of its flags is set."""
    rows = flags.reshape(-1, flags.shape[-1])
    return on_cpus(  # 10 times, 36 rows
        lambda: row_by_row(jnp.bitwise_or, rows, jnp.zeros(rows.shape[-1:], bool)),
        lambda: rows.any(axis=0),
    )


def rows_set(flags: jax.Array) -> jax.Array:
    """For each lane, the last axis, how many of its flags are set."""
    rows = flags.reshape(-1, flags.shape[-1])
    return on_cpus(
        lambda: row_by_row(jnp.add, rows, jnp.zeros(rows.shape[-1:], int)), lambda: rows.sum(axis=0)
    )


def row_by_row(
    join: Callable[[jax.Array, jax.Array], jax.Array], rows: jax.Array, start: jax.Array
) -> jax.Array:
    def one(number: LoopIndex, found: jax.Array) -> jax.Array:
        return join(found, rows[number].astype(start.dtype))

    return jax.lax.fori_loop(0, len(rows), one, start)
