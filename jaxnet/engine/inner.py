"""States that outputs leave undetermined, integrated by ticks along the outputs' exact motion.

The vehicle steps these states over an interval from the jets at places in it, and tells the step's
error. The lanes are the last axis of every array. Each lane has its own steps.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxnet.engine import stepper, vehicles
from jaxnet.engine.moment import Instants, LaneFlags
from jaxnet.engine.subset import select
from jaxnet.kinds.vehicles import OUTPUT_PLACES
from jaxnet.model.lane import Lane

TOLERANCE = 1e-7  # of a step's error, as the vehicle estimates it
ORDER = 5  # of that error in the step's length
MOST_ATTEMPTS = 10_000  # of a tick, refused ones included


class Inner(NamedTuple):
    """The states that outputs leave undetermined, and the next step."""

    states: Float[Array, "k m lanes"]
    step: Instants  # [s]


def inner_at_start(lane: Lane, interval: Any) -> Inner | None:
    """The states at t = 0; None where the outputs determine all states."""
    if not lane.vehicle.internal:
        return None
    step = jnp.broadcast_to(interval, lane.attack_scale.shape)
    return Inner(lane.vehicle.inner(lane.initial), step)


def carried(
    motion: Any, state: Any, decided: Any, span: Instants, moves: LaneFlags
) -> tuple[Inner, LaneFlags]:
    """States a span [s] later, and the lanes among `moves` that took more than MOST_ATTEMPTS."""
    vehicle, since = motion.lane.vehicle, state.time

    def under_way(carry: Any) -> Bool[Array, ""]:
        _, passed, number = carry
        return (passed < span).any() & (number < MOST_ATTEMPTS)

    def attempt(carry: Any) -> Any:
        now, passed, number = carry
        goes, last = passed < span, now.inner
        end = stepper.towards(span, passed, jnp.minimum(last.step, motion.longest))
        step = end - passed
        places = (motion.later(now, decided, at * step, since) for at in OUTPUT_PLACES[1:])
        there = [now, *places]
        jets = [motion.all_jets(each, decided) for each in there]
        jets = [
            vehicles.in_formation(motion.lane, every, each.time)
            for every, each in zip(jets, there, strict=True)
        ]
        found, error = vehicle.inner_after(last.states, jets, step)
        error = (error / TOLERANCE).max(axis=0)
        kept = goes & ~(error >= 1.0)  # a lane whose numbers are not finite goes on
        proposed = jnp.where(goes, stepper.next_step(step, error, ORDER), last.step)
        now = select(kept, there[-1]._replace(inner=Inner(found, last.step)), now)
        now = now._replace(inner=now.inner._replace(step=proposed))
        return now, jnp.where(kept, end, passed), number + 1

    start = state, jnp.where(moves, 0.0, span), jnp.asarray(0)
    now, passed, _ = jax.lax.while_loop(under_way, attempt, start)
    return now.inner, passed < span
