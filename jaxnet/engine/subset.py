"""Work on the few lanes that need it, some at a time, without touching the others."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

Carry = TypeVar("Carry")
Numbers = Int[Array, "few"]


def for_each(
    flagged: Bool[Array, "lanes"], width: int, work: Callable[[Numbers, Carry], Carry], carry: Carry
) -> Carry:
    """The carry after `work` on the flagged lanes, `width` of them at a time, told by their numbers.

    A number past the last lane fills up: `picked` clips it, `put` drops it.
    """
    lanes = flagged.shape[0]

    def some(state: tuple[Bool[Array, "lanes"], Carry]) -> tuple[Bool[Array, "lanes"], Carry]:
        left, carry = state
        numbers = jnp.nonzero(left, size=min(width, lanes), fill_value=lanes)[0]
        return left.at[numbers].set(False, mode="drop"), work(numbers, carry)

    return jax.lax.while_loop(lambda state: state[0].any(), some, (flagged, carry))[1]


def picked(array: jax.Array, numbers: Numbers) -> jax.Array:
    """These lanes of an array."""
    return array.at[..., numbers].get(mode="clip")


def put(array: jax.Array, numbers: Numbers, lanes: jax.Array) -> jax.Array:
    """The array with these lanes replaced."""
    return array.at[..., numbers].set(lanes, mode="drop")
