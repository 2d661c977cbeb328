"""Lanes of the exact engine in which a vehicle stands still between two ticks.

With probability 1, the velocity of a vehicle becomes 0 only if the vehicle has moved on a straight
line since the start. Lanes in which no vehicle moves on a line any more are not searched. In all
other lanes, each tick searches the interval since the previous tick.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.engine import flow, standstill
from jaxnet.engine.flow import Durations
from jaxnet.engine.moment import LaneFlags, VehicleFlags
from jaxnet.engine.plan import Plan
from jaxnet.engine.status import Code, Status, fail
from jaxnet.engine.subset import LaneIndices, for_each, picked, put, run_if
from jaxnet.model import control, plane, signal
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Jets, Plane, length
from jaxnet.model.signal import Vectors

FEW = 16  # lanes that are searched at once


def stopped(
    straight: LaneFlags,
    status: Code,
    lead: Callable[[], tuple[Plane, Plane]],
    stood: Callable[[LaneIndices], LaneFlags],
) -> tuple[Code, LaneFlags]:
    """The status, and the lanes in which some vehicle may have gone straight on, a tick later.

    `lead()` returns the vehicles' lead and its derivative. `stood(few)` returns which of a few
    lanes have a vehicle that stood still in the tick before now.
    """

    def some(few: LaneIndices, status: Code) -> Code:
        return put(status, few, fail(picked(status, few), Status.singular, stood(few)))

    def work(carry: Any) -> Any:
        status, straight = carry
        straight = straight & standstill.straight(*lead()) & (status == Status.ok)
        return for_each(straight, FEW, some, status), straight

    return run_if(straight.any(), work, (status, straight))


class Parts(NamedTuple):
    """What may drive vehicles, in this order."""

    idle: int  # functions of attacks that drive nobody, since all words are late
    attacks: int  # functions of attacks
    leads: bool  # whether the navigator's path, two functions, comes next
    powers: int  # powers of the share of a tick

    @property
    def functions(self) -> int:
        """The number of functions of time that drive vehicles."""
        return self.attacks + 2 * self.leads


def stood(
    errors: Jets,
    forced: Vectors,
    effect: Float[Array, "r all lanes"],
    lane: Lane,
    reach: Float[Array, "r lanes"],
    time: Durations,
    apart: VehicleFlags,
    parts: Parts,
    interval: Any,
    plan: Plan,
) -> LaneFlags:
    """The lanes in which a vehicle stood still in the interval before now, from E and G now.

    The vehicles `apart` are not searched.

    The search goes back in time. `E^(r) = -P(E) + K R(β)` with attack vectors K. A bound on y^(r)
    follows from E and its derivatives now, and the greatest norms of the navigator's r-th
    derivative and the attack's functions.
    """
    (path, functions), order = lane.sizes, len(lane.gain)
    of_attacks, of_path, known = jnp.split(forced, (parts.attacks, parts.functions), axis=2)
    pull = norm(of_attacks) * greatest_drive(lane.gain, functions)
    pull = pull + norm(of_path) * greatest_drive(lane.gain, path)
    pull = pull + sum(length(known[:, :, k]) / math.factorial(k) for k in range(parts.powers))
    pull = pull * (1.0 + interval * reach[-1])[None]
    highest = (
        path[order][None] + pull + sum(reach[k][None] * length(errors[k]) for k in range(order))
    )
    forced, since = forced[:, :, : parts.functions], time - interval

    def driven(effect: Float[Array, "r all lanes"]) -> Jets:
        return signal.jets(forced, effect[:, parts.idle :])

    free = tuple(jet - other for jet, other in zip(errors, driven(effect), strict=True))

    def pace(state: Any) -> standstill.Pace:
        now, free, effect = state
        path = (each[:, None] for each in lane.path(now)[: len(free)])
        jets = plane.plus(plane.plus(free, driven(effect)), tuple(path))
        return standstill.backwards(lane.vehicle, jets, highest, apart)

    def go_back(state: Any, step: Durations) -> Any:
        (now, free, effect), over = state, flow.brief(lane.gain, -step)
        if plan.consistent:
            effect = lane.basis(now - step)[:order]
        else:
            responses = flow.brief_responses(lane.gain, -step)
            effect = flow.passed_on(effect, over, responses, lane, now, -step)
        free = flow.propagate(over, free)
        if parts.powers:
            shares = (each / interval for each in (now - since, -step))
            pushed = flow.power_responses(lane.gain, -step, parts.powers, *shares)
            free = plane.plus(free, signal.jets(known, pushed))
        return now - step, free, effect

    return standstill.stands(
        pace, go_back, (time, free, effect), interval, flow.longest(lane.gain)
    )[0]


def norm(vectors: Vectors) -> Float[Array, "m lanes"]:
    return jnp.sqrt((vectors**2).sum(axis=(0, 2)))


def greatest_drive(
    gain: control.Gain, sizes: Float[Array, "derivatives lanes"]
) -> Float[Array, "1 lanes"]:
    """A bound on R of a signal, from bounds on the signal and its derivatives."""
    return control.driven(control.norms(gain), sizes)[None]


def stood_held(
    vehicle: Any, jets: Jets, held: Vectors, apart: VehicleFlags, interval: Any
) -> LaneFlags:
    """The lanes in which a vehicle stood still in the interval before now, while it held the r-th
    derivative. The vehicles `apart` are not searched.
    """
    highest = length(held[:, :, 0])

    def pace(jets: Jets) -> standstill.Pace:
        return standstill.backwards(vehicle, jets, highest, apart)

    def go_back(jets: Jets, step: Durations) -> Jets:
        free = flow.propagate(flow.of_integrators(-step, len(jets)), jets)
        return plane.plus(free, signal.jets(held, flow.held_input(-step, len(jets))))

    return standstill.stands(pace, go_back, jets, interval, jnp.full(highest.shape[1:], interval))[
        0
    ]
