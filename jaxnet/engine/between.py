"""Lanes of the exact engine whose vehicles stand still between two ticks.

A vehicle whose velocity passes 0 goes straight on, with probability 1: it turns round on a line. So lanes in
which everybody has turned are let go, and the others are looked at from every tick back to the one before.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from jaxnet.engine import flow, standstill
from jaxnet.engine.flow import Lanes
from jaxnet.engine.plan import Inputs, Plan
from jaxnet.engine.status import Code, Status, fail
from jaxnet.engine.subset import for_each, once, picked, put
from jaxnet.model import control, signal
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Plane, length

FEW = 16  # lanes that are looked at


def stopped(
    fleet: Any, time: Lanes, looked_at: Bool[Array, ""], inputs: Inputs, interval: Any, plan: Plan
) -> tuple[Code, Bool[Array, "lanes"]]:
    """The status, and lanes in which some vehicle may have gone straight on, a tick after the one before."""
    lane, numbers = inputs

    def some(few: Any, status: Code) -> Code:
        given = fleet.errors, fleet.forced, fleet.effect()[:3], lane, numbers.reach, time
        errors, forced, effect, *rest = jax.tree.map(lambda leaf: picked(leaf, few), given)
        still = stood(errors, forced, effect, *rest, interval=interval, plan=plan)
        return put(status, few, fail(picked(status, few), Status.singular, still))

    def work(carry: Any) -> Any:
        status, straight = carry
        path = lane.navigator.jets(time)
        motion = (fleet.errors[order] + path[order][:, None] for order in (1, 2))
        straight = straight & standstill.straight(*motion) & (status == Status.ok)
        return for_each(straight, FEW, some, status), straight

    return once(looked_at & fleet.straight.any(), work, (fleet.status, fleet.straight))


def stood(
    errors: Any,
    forced: Any,
    effect: flow.Effect,
    lane: Lane,
    reach: Any,
    time: Lanes,
    interval: Any,
    plan: Plan,
) -> Bool[Array, "lanes"]:
    """Lanes in which a vehicle stood still in the interval before now, from E and G now.

    They go back in time. E‴ is `-P(E) + K R(β)` with attack vectors K, so its bound follows from E, Ė and Ë
    now and from the greatest norms of the navigator's jerk and of the attack's functions.
    """
    path, functions = lane.sizes
    drive = control.feedback(lane.gain, functions[:3]) + functions[3]
    pull = jnp.sqrt((forced**2).sum(axis=(0, 2))) * (drive * (1.0 + interval * reach[2]))[None]
    jerk = path[3][None] + pull + sum(reach[k][None] * length(errors[k]) for k in range(3))
    forcing = signal.jets(forced, effect)
    free = tuple(jet - other for jet, other in zip(errors, forcing, strict=True))

    def pace(state: Any) -> tuple[Plane, Plane]:
        now, free, effect = state
        _, velocity, acceleration, _ = lane.navigator.jets(now)
        _, *driven = signal.jets(forced, effect)
        return velocity[:, None] + driven[0] + free[1], -(acceleration[:, None] + driven[1] + free[2])

    def go_back(state: Any, step: Lanes) -> Any:
        (now, free, effect), over = state, flow.brief(lane.gain, -step)
        if plan.consistent:
            effect = lane.signal.basis(now - step)[:3]
        else:
            responses = flow.brief_responses(lane.gain, -step)
            effect = flow.passed_on(effect, over, responses, lane, now, -step)
        return now - step, flow.propagate(over, free), effect

    longest = flow.longest(lane.gain)
    return standstill.stands(pace, go_back, (time, free, effect), jerk, interval, longest)
