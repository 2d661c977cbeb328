"""Search for vehicles that stand still between ticks, where the law is singular.

The search covers an interval in steps and samples nothing. Velocity, acceleration and a bound on
the jerk give a time in which a vehicle cannot stand still. That time is the step. Near an instant
of rest the steps shorten as in Newton's method.

A kind of vehicle is singular where the vector `Vehicle.lead` of y^(k) is 0. The lead takes the
place of the velocity, and y^(k+1) that of the acceleration. Where y^(k+1) is the r-th derivative,
which jumps, a bound on its norm serves for the acceleration.

The lanes are the last axis of every array.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxnet.engine.moment import VehicleFlags
from jaxnet.engine.status import LEAST_MARGIN
from jaxnet.model.plane import Jets, Plane, cross, dot, length

Passing = TypeVar("Passing")
Spans = Float[Array, "lanes"]
Pace = tuple[Plane, Plane, Float[Array, "m lanes"]]  # velocity, acceleration, bound on the jerk

FLOOR = LEAST_MARGIN / 2  # so low that a step ends under LEAST_MARGIN where a vehicle stands still
TURNED = 1e-9  # sine of the angle from velocity to acceleration; rounding makes less
LEAST_PART = 2.0**-40  # shortest step over the interval; rounding hides shorter events
# Of a search; a lane that needs more counts as one in which a vehicle stands still.
MOST_SEARCH_STEPS = 100_000


def lead(vehicle: Any, jets: Jets, apart: VehicleFlags) -> tuple[Plane, Plane]:
    """Lead and its derivative, for jets up to r; the vehicles `apart` only seem to turn."""
    return seeming(apart, vehicle.lead(jets[vehicle.singular]), jets[vehicle.singular + 1])


def seeming(apart: VehicleFlags, now: Plane, following: Plane) -> tuple[Plane, Plane]:
    """A lead and its derivative, of norm 1 and at right angles for the vehicles `apart`."""
    along, across = jnp.eye(2)[..., None, None]
    return jnp.where(apart[None], along, now), jnp.where(apart[None], across, following)


def backwards(
    vehicle: Any, jets: Jets, highest: Float[Array, "m lanes"], apart: VehicleFlags
) -> Pace:
    """`onwards` back in time."""
    upto = vehicle.singular + 1
    return onwards(vehicle, (*jets[:upto], *(-jet for jet in jets[upto:])), highest, apart)


def onwards(
    vehicle: Any, jets: Jets, highest: Float[Array, "m lanes"], apart: VehicleFlags
) -> Pace:
    """The lead, its derivative, and a bound on its second one, for the jets below r.

    `highest` bounds the r-th derivative. Where the lead's derivative is the r-th one, it points to
    0 with that norm. The vehicles `apart` are not searched.
    """
    now, following = vehicle.lead(jets[vehicle.singular]), jets[vehicle.singular + 1 :]
    if following:
        bound = jnp.where(apart, 0.0, highest)
        return *seeming(apart, now, following[0]), bound
    back = -now * (highest / jnp.maximum(length(now), jnp.finfo(float).tiny))[None]
    return *seeming(apart, now, back), jnp.zeros_like(highest)


def stands(
    pace: Callable[[Passing], Pace],
    advance: Callable[[Passing, Spans], Passing],
    state: Passing,
    interval: Any,
    longest: Spans,
) -> tuple[Bool[Array, "lanes"], Passing]:
    """The lanes in which a vehicle is slower than LEAST_MARGIN at some instant of an interval.

    Return also the state at that instant, in other lanes at the end. `pace(state)` bounds the jerk
    over a step. `advance(state, step)` returns the state after a step of at most `longest`. A speed
    under FLOOR is always found, a speed over LEAST_MARGIN never.
    """

    def under_way(carry: Any) -> Any:
        passed, still, number, _ = carry
        return ((passed < interval) & ~still).any() & (number < MOST_SEARCH_STEPS)

    def move(carry: Any) -> Any:
        passed, still, number, state = carry
        velocity, acceleration, jerk = pace(state)
        still = still | (length(velocity) < LEAST_MARGIN).any(axis=0)
        step = safe(velocity, acceleration, jerk).min(axis=0)
        step = jnp.clip(step, LEAST_PART * interval, longest)
        arrives = passed + step >= interval
        step = jnp.where(still, 0.0, jnp.where(arrives, interval - passed, step))
        passed = jnp.where(still | ~arrives, passed + step, interval)
        return passed, still, number + 1, advance(state, step)

    zero = jnp.zeros_like(longest)
    passed, still, _, state = jax.lax.while_loop(
        under_way, move, (zero, zero > 0, jnp.asarray(0), state)
    )
    return still | (passed < interval) | (length(pace(state)[0]) < LEAST_MARGIN).any(axis=0), state


def straight(velocity: Plane, acceleration: Plane) -> Bool[Array, "lanes"]:
    """The lanes in which some vehicle's acceleration is along its velocity, up to rounding.

    Speeds and accelerations whose product is infinite are left out.
    """
    sizes = (1.0 + length(velocity)) * (1.0 + length(acceleration))
    along = jnp.abs(cross(velocity, acceleration)) <= TURNED * sizes
    return (along & jnp.isfinite(sizes)).any(axis=0)


def safe(
    velocity: Plane, acceleration: Plane, jerk: Float[Array, "m lanes"]
) -> Float[Array, "m lanes"]:
    """A time in which the speed stays over FLOOR, from `‖v(t) - v - a t‖ ≤ J t²/2`.

    The line `v + a t` is at least `‖v‖ - ‖a‖ t` away from 0, and nowhere nearer than at its foot.
    """
    speed, size, tiny = jnp.hypot(*velocity), jnp.hypot(*acceleration), jnp.finfo(float).tiny
    foot = jnp.abs(cross(velocity, acceleration)) / jnp.maximum(size, tiny)
    foot = jnp.where(dot(velocity, acceleration) >= 0, speed, foot)
    room, beside = jnp.maximum(speed - FLOOR, 0.0), jnp.maximum(foot - FLOOR, 0.0)
    fastest = jnp.hypot(size, jnp.sqrt(2 * jerk) * jnp.sqrt(room))  # squares might overflow
    ahead = 2 * room / jnp.maximum(size + fastest, tiny)
    return jnp.maximum(ahead, jnp.sqrt(2 * beside / jnp.maximum(jerk, tiny)))
