"""Work on the few lanes that need it, a fixed number at a time; other lanes stay untouched."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from jaxnet.model import xla
from jaxnet.model.shapes import LoopIndex

SHARE = 8  # on accelerators, a pass takes one lane of so many, or more

Carry = TypeVar("Carry")
LaneIndices = Int[Array, " few"]  # numbers of lanes


class Stretch(NamedTuple):
    """Lanes next to each other."""

    first: Int[Array, ""]
    number: int


def for_each(
    flagged: Bool[Array, "lanes"],
    width: int,
    work: Callable[[LaneIndices, Carry], Carry],
    carry: Carry,
) -> Carry:
    """Apply `work` to the flagged lanes, on CPUs `width` at a time, and return the carry.

    `work` receives the numbers of the lanes. A number past the last lane is padding: `picked` clips
    it, `put` drops it.
    """
    up_to, at_once = jnp.cumsum(flagged), side_by_side(width, flagged.size)

    def some(state: tuple[Int[Array, ""], Carry]) -> tuple[Int[Array, ""], Carry]:
        done, carry = state
        return done + at_once, work(numbered(up_to, done, at_once), carry)

    begin = jnp.zeros((), int), carry
    return jax.lax.while_loop(lambda state: state[0] < up_to[-1], some, begin)[1]


def for_stretches(
    flagged: Bool[Array, "lanes"], width: int, work: Callable[[Stretch, Carry], Carry], carry: Carry
) -> Carry:
    """Apply `work` to all stretches of `width` lanes with a flagged lane, and return the carry.

    Lanes that are not flagged are worked on too. Where most lanes are flagged, this is 1.3 times as
    fast as `for_each` (trimming, lost messages, 12 vehicles).
    """
    at_once = side_by_side(width, flagged.size)

    def some(number: LoopIndex, carry: Carry) -> Carry:
        stretch = Stretch(jnp.minimum(number * at_once, flagged.size - at_once), at_once)
        return run_if(picked(flagged, stretch).any(), lambda carry: work(stretch, carry), carry)

    return jax.lax.fori_loop(0, -(-flagged.size // at_once), some, carry)


def side_by_side(width: int, lanes: int) -> int:
    """Lanes of a pass. On accelerators a pass takes as long for a few lanes as for many."""
    return min(xla.on_cpus(lambda: width, lambda: max(width, lanes // SHARE)), lanes)


def numbered(up_to: Int[Array, " all"], done: Any, number: int) -> LaneIndices:
    """The numbers of the next `number` flagged items after the first `done` flagged items.

    `up_to` counts the flagged items up to each item. Where fewer items are flagged, the other
    numbers are one past the last item.
    """
    before = done + jnp.arange(number)
    return xla.on_cpus(
        lambda: (up_to[None] <= before[:, None]).sum(axis=1),
        lambda: jnp.searchsorted(up_to, before, side="right", method="scan_unrolled"),
    )


def run_if(flag: Bool[Array, ""], work: Callable[[Carry], Carry], carry: Carry) -> Carry:
    return jax.lax.cond(flag, work, lambda same: same, carry)


def select(flagged: Bool[Array, "lanes"], new: Carry, old: Carry) -> Carry:
    """The new tree in the flagged lanes, the old one elsewhere; lanes last."""
    return jax.tree.map(
        lambda a, b: jnp.where(flagged.reshape(*[1] * (a.ndim - 1), -1), a, b), new, old
    )


def picked(array: jax.Array, few: LaneIndices | Stretch) -> jax.Array:
    """The given lanes of an array; a number past the last lane gives the last lane."""
    if isinstance(few, Stretch):
        return jax.lax.dynamic_slice_in_dim(array, few.first, few.number, axis=-1)
    return array.at[..., few].get(mode="clip")


def put(array: jax.Array, few: LaneIndices | Stretch, lanes: jax.Array) -> jax.Array:
    """The array with the given lanes replaced; numbers past the last lane change nothing."""
    if isinstance(few, Stretch):
        return jax.lax.dynamic_update_slice_in_dim(array, lanes, few.first, axis=-1)

    def one(number: Any, array: jax.Array) -> jax.Array:
        place = few[number]
        new = jax.lax.dynamic_index_in_dim(lanes, number, axis=-1)
        old = jax.lax.dynamic_index_in_dim(array, place, axis=-1)
        lane = jnp.where(place < array.shape[-1], new, old)  # JAX clips a place past the last lane
        return jax.lax.dynamic_update_index_in_dim(array, lane, place, axis=-1)

    return xla.on_cpus(  # 1.7 times, trimming, 12 vehicles; 1.3 times, 1,000
        lambda: jax.lax.fori_loop(0, few.size, one, array),
        lambda: array.at[..., few].set(lanes, mode="drop"),
    )
