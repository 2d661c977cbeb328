"""A queue of lanes in a fixed number of places: the next lanes replace those that have ended.

A lane that takes many steps delays no other lane. The places stay busy until the queue runs out.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from jaxnet.engine.subset import picked, put, select

SPARE = 16  # a refill waits until one place in so many is idle

Scalar = Int[Array, ""]
LaneTree = Any  # a pytree


class Places(NamedTuple):
    """Lanes side by side, each under way or ended; the last axis of every array is over places."""

    number: Int[Array, " places"]  # of the lane in the queue; past its end in an empty place
    inputs: LaneTree
    state: LaneTree


class Work(NamedTuple):
    """Functions that start, advance and end lanes side by side."""

    start: Callable[[LaneTree], LaneTree]  # from inputs to states
    advance: Callable[[Places, LaneTree], tuple[LaneTree, LaneTree]]  # one pass: states and record
    under_way: Callable[[LaneTree], Bool[Array, " places"]]  # the lanes that have not ended
    end: Callable[[LaneTree, LaneTree], LaneTree]  # from inputs and states to results


WorkCarry = tuple[Places, Scalar, LaneTree, LaneTree]  # lanes taken, results and record


def work_off(
    queue: LaneTree, count: Scalar | int, places: int, work: Work, record: LaneTree
) -> tuple[LaneTree, LaneTree]:
    """Advance the first `count` lanes of a queue to their end. Return their results and the record.

    Each pass updates the record. Every leaf of the queue and of the results has a last axis over
    the queue's lanes.
    """
    length = jax.tree.leaves(queue)[0].shape[-1]
    start, end = jax.jit(work.start, inline=True), jax.jit(work.end, inline=True)  # traced once

    def busy(now: Places) -> Bool[Array, " places"]:
        return (now.number < count) & work.under_way(now.state)

    def refill(now: Places, taken: Scalar) -> tuple[Places, Scalar]:
        idle = ~busy(now)
        number = jnp.where(idle, taken + jnp.cumsum(idle) - 1, now.number)
        inputs = jax.tree.map(lambda leaf: picked(leaf, number), queue)
        return Places(number, inputs, select(idle, start(inputs), now.state)), taken + idle.sum()

    def advance(carry: tuple[Places, LaneTree]) -> tuple[Places, LaneTree]:
        state, record = work.advance(*carry)
        return carry[0]._replace(state=state), record

    def until_some_end(carry: WorkCarry) -> WorkCarry:
        now, taken, left, record = carry
        now, taken = refill(now, taken)
        few = jnp.where(taken < count, places - max(1, places // SPARE), 0)
        now, record = jax.lax.while_loop(
            lambda carry: busy(carry[0]).sum() > few, advance, (now, record)
        )
        done, ends = jnp.where(busy(now), length, now.number), end(now.inputs, now.state)
        return now, taken, jax.tree.map(lambda leaf, end: put(leaf, done, end), left, ends), record

    def nothing(shapes: LaneTree, lanes: int) -> LaneTree:
        return jax.tree.map(lambda leaf: jnp.zeros((*leaf.shape[:-1], lanes), leaf.dtype), shapes)

    some = nothing(queue, places)
    state = jax.eval_shape(start, some)
    nobody = Places(jnp.full(places, length), some, nothing(state, places))
    begin = nobody, jnp.asarray(0), nothing(jax.eval_shape(end, some, state), length), record
    _, _, results, record = jax.lax.while_loop(
        lambda carry: busy(carry[0]).any() | (carry[1] < count), until_some_end, begin
    )
    return results, record
