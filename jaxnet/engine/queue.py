"""A queue of lanes in a fixed number of places: the next lanes replace those that have ended.

A lane that takes many steps delays no other lane. The places stay busy until the queue runs out.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from jaxnet.engine.subset import picked, put, select

SPARE = 16  # a refill waits until one place in so many is idle

QueueNumbers = Int[Array, " places"]


QueuedLanes = TypeVar("QueuedLanes")  # pytrees, lanes last
PlaceState = TypeVar("PlaceState")
PassRecord = TypeVar("PassRecord")
LaneResult = TypeVar("LaneResult")
LaneTree = TypeVar("LaneTree")


class Places(NamedTuple):
    """Lanes side by side, each under way or ended; the last axis of every array is over places."""

    number: QueueNumbers  # of the lane in the queue; past the queue's end in an empty place
    inputs: Any  # a pytree
    state: Any  # a pytree


@dataclass(frozen=True)
class Work(Generic[QueuedLanes, PlaceState, PassRecord, LaneResult]):
    """Functions that start, advance and end lanes side by side."""

    start: Callable[[QueuedLanes], PlaceState]
    advance: Callable[[Places, PassRecord], tuple[PlaceState, PassRecord]]  # one pass
    under_way: Callable[[PlaceState], Bool[Array, " places"]]  # the lanes that have not ended
    end: Callable[[QueuedLanes, PlaceState], LaneResult]  # of lanes that have ended


def work_off(
    queue: QueuedLanes,
    count: Int[Array, ""] | int,
    places: int,
    work: Work[QueuedLanes, PlaceState, PassRecord, LaneResult],
    record: PassRecord,
) -> tuple[LaneResult, PassRecord]:
    """Advance the first `count` lanes of a queue to their end. Return their results and the record.

    Each pass updates the record. Every leaf of the queue and of the results has a last axis over
    the queue's lanes.
    """
    length = jax.tree.leaves(queue)[0].shape[-1]
    start, end = jax.jit(work.start, inline=True), jax.jit(work.end, inline=True)  # traced once

    def busy(now: Places) -> Bool[Array, " places"]:
        return (now.number < count) & work.under_way(now.state)

    def refill(now: Places, taken: Int[Array, ""]) -> tuple[Places, Int[Array, ""]]:
        idle = ~busy(now)
        number = jnp.where(idle, taken + jnp.cumsum(idle) - 1, now.number)
        inputs = jax.tree.map(lambda leaf: picked(leaf, number), queue)
        state = select(idle, start(inputs), now.state)
        return Places(number, inputs, state), taken + idle.sum()

    def until_some_end(
        carry: tuple[Places, Int[Array, ""], LaneResult, PassRecord],
    ) -> tuple[Places, Int[Array, ""], LaneResult, PassRecord]:
        now, taken, left, record = carry
        now, taken = refill(now, taken)
        few = jnp.where(taken < count, places - max(1, places // SPARE), 0)

        def advance(carry: tuple[Places, PassRecord]) -> tuple[Places, PassRecord]:
            now, record = carry
            state, record = work.advance(now, record)
            return now._replace(state=state), record

        now, record = jax.lax.while_loop(
            lambda carry: busy(carry[0]).sum() > few, advance, (now, record)
        )
        done = jnp.where(busy(now), length, now.number)
        ends = end(now.inputs, now.state)
        return now, taken, jax.tree.map(lambda leaf, end: put(leaf, done, end), left, ends), record

    def nothing(shapes: LaneTree, lanes: int) -> LaneTree:
        return jax.tree.map(lambda leaf: jnp.zeros((*leaf.shape[:-1], lanes), leaf.dtype), shapes)

    some = nothing(queue, places)
    state = jax.eval_shape(start, some)
    nobody = Places(jnp.full(places, length), some, nothing(state, places))
    left = nothing(jax.eval_shape(end, some, state), length)
    carry = nobody, jnp.asarray(0), left, record
    carry = jax.lax.while_loop(
        lambda carry: busy(carry[0]).any() | (carry[1] < count), until_some_end, carry
    )
    return carry[2], carry[3]
