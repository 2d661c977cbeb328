"""Work on the few lanes that need it, some at a time, without touching the others."""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from jaxnet.model import xla

Carry = TypeVar("Carry")
LaneIndices = Int[Array, " few"]  # numbers of lanes


def for_each(
    flagged: Bool[Array, "lanes"], width: int, work: Callable[[LaneIndices, Carry], Carry], carry: Carry
) -> Carry:
    """The carry after `work` on the flagged lanes, `width` of them at a time, told by their numbers.

    A number past the last lane fills up: `picked` clips it, `put` drops it.
    """
    up_to, at_once = jnp.cumsum(flagged), min(width, flagged.size)

    def some(state: tuple[Int[Array, ""], Carry]) -> tuple[Int[Array, ""], Carry]:
        done, carry = state
        return done + at_once, work(numbered(up_to, done, at_once), carry)

    return jax.lax.while_loop(lambda state: state[0] < up_to[-1], some, (jnp.zeros((), int), carry))[1]


def numbered(up_to: Int[Array, " all"], done: Any, number: int) -> LaneIndices:
    """Numbers of so many flagged ones after the first `done`; one past the last where there are fewer.

    `up_to` says how many are flagged up to each one.
    """
    return (up_to[None] <= done + jnp.arange(number)[:, None]).sum(axis=1)


def run_if(flag: Bool[Array, ""], work: Callable[[Carry], Carry], carry: Carry) -> Carry:
    """The carry after `work` where the flag is set, by a loop: XLA would copy what a `cond` passes on."""

    def one(state: tuple[Bool[Array, ""], Carry]) -> tuple[Bool[Array, ""], Carry]:
        return jnp.zeros_like(state[0]), work(state[1])

    return jax.lax.while_loop(lambda state: state[0], one, (flag, carry))[1]


def select(flagged: Bool[Array, "lanes"], new: Carry, old: Carry) -> Carry:
    """Return the new tree in the flagged lanes, the old one elsewhere; lanes last."""
    return jax.tree.map(lambda a, b: jnp.where(flagged.reshape(*[1] * (a.ndim - 1), -1), a, b), new, old)


def picked(array: jax.Array, few: LaneIndices) -> jax.Array:
    """These lanes of an array."""
    return array.at[..., few].get(mode="clip")


def put(array: jax.Array, few: LaneIndices, lanes: jax.Array) -> jax.Array:
    """The array with these lanes replaced."""

    def one(number: Any, array: jax.Array) -> jax.Array:
        place = few[number]
        new, old = (
            jax.lax.dynamic_index_in_dim(*each, axis=-1) for each in ((lanes, number), (array, place))
        )
        lane = jnp.where(place < array.shape[-1], new, old)  # a place past the last lane is taken for that
        return jax.lax.dynamic_update_index_in_dim(array, lane, place, axis=-1)

    return xla.on_cpus(
        lambda: jax.lax.fori_loop(0, few.size, one, array),
        lambda: array.at[..., few].set(lanes, mode="drop"),
    )
