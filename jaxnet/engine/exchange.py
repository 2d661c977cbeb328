"""The closed loop where vehicles hold a jerk from tick to tick, solved exactly (SCIENCE O12).

At each tick they receive, decide, and exchange with their neighbours what jerk to hold until the next. So
between ticks a vehicle's position is a polynomial of third degree, whatever the weights and the attacks.

The lanes are the last axis of every array. An instant's functions are computed behind a barrier, as in
`propagation`.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.lax import optimization_barrier as barrier
from jaxtyping import Array, Float, Int

from jaxnet.engine import metrics, standstill
from jaxnet.engine import tick as ticks
from jaxnet.engine.metrics import Observation
from jaxnet.engine.plan import Clock, Inputs, Outcome, Plan
from jaxnet.engine.signals import Signals, signals
from jaxnet.engine.status import LEAST_SPEED, Code, Status, fail
from jaxnet.engine.subset import for_each, once, picked, put
from jaxnet.engine.tick import Mind
from jaxnet.model import plane, signal
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets

FEW = 16  # lanes that are looked at


class Fleet(NamedTuple):
    """Lanes under way, at a tick at which vehicles have exchanged."""

    jets: Jets  # of y
    jerk: Float[Array, "2 m lanes"]  # held until the next tick
    mind: Mind
    signals: Signals  # now
    switches: Int[Array, "lanes"]
    straight: Any  # lanes where some vehicle may have gone straight on until now
    status: Code


def simulate(inputs: Inputs, count: Int[Array, ""], network: Network, clock: Clock, plan: Plan) -> Outcome:
    """Lanes from 0 to the horizon, all side by side; what stands after the first `count` is filling."""
    (lane, _), zero = inputs, jnp.asarray(0)

    def signals_at(number: Any) -> Signals:
        return signals(lane, jnp.broadcast_to(clock.at(jnp.asarray(number)), lane.amplitude.shape))

    def tick(number: Int[Array, ""], fleet: Fleet) -> Fleet:
        now = barrier(signals_at(number + 1))
        return settle(moved(fleet, clock.interval)._replace(signals=now), lane, network, plan, first=False)

    def output(number: Int[Array, ""], carry: Any) -> Any:
        fleet, gathered, series = carry
        seen, ok = observe(fleet, lane, network, plan), fleet.status == Status.ok
        series = {
            name: jax.lax.dynamic_update_index_in_dim(series[name], jnp.where(ok, value, jnp.nan), number, 0)
            for name, value in ticks.series(plan, seen).items()
        }
        gathered = metrics.add(plan.metrics, gathered, seen, jnp.ones_like(ok), clock.in_tail(number))
        now, rest = number * clock.ticks, jnp.where(number < clock.outputs, clock.ticks, 0)
        return jax.lax.fori_loop(now, now + rest, tick, fleet), gathered, series

    fleet = start(lane, network, plan, signals_at(0))
    series = ticks.room(plan, lambda: observe(fleet, lane, network, plan))
    carry = fleet, metrics.nothing(plan.metrics, lane.initial.shape[1:]), series
    fleet, gathered, series = jax.lax.fori_loop(zero, clock.outputs + 1, output, carry)
    status = fail(fleet.status, Status.singular, (gathered["min_speed"] < LEAST_SPEED).any(axis=0))
    status = fail(status, Status.nonfinite, ~metrics.finite(gathered))
    found = metrics.of_fleet(plan.metrics, gathered, clock.outputs, clock.tail_outputs, status == Status.ok)
    return Outcome(status, found, jnp.zeros_like(status), fleet.switches, series)


def start(lane: Lane, network: Network, plan: Plan, now: Signals) -> Fleet:
    """The lanes at t = 0; nobody has held a jerk yet."""
    status, jets = ticks.status_at_start(lane), lane.vehicle.output_jets(lane.initial)
    mind, jerk = ticks.begin(lane, network, plan), jnp.zeros_like(jets[0])
    fleet = Fleet(jets, jerk, mind, now, jnp.zeros_like(status), status == Status.ok, status)
    return settle(fleet, lane, network, plan, first=True)


def settle(fleet: Fleet, lane: Lane, network: Network, plan: Plan, first: bool) -> Fleet:
    """Receive, decide and exchange; count the vehicles that changed their mind. The first is no change."""
    now = fleet.signals
    mind = ticks.decide(lane, network, plan, fleet.mind, errors_of(fleet), now.basis, now.time)
    switches, status = fleet.switches, fleet.status
    if not first:
        vehicles = ticks.changed(mind, fleet.mind, lane)[1]
        switches = switches + jnp.where(status == Status.ok, vehicles.sum(axis=0), 0)
    weights = ticks.weights_of(lane, mind, plan)
    if first or plan.decides:
        status = fail(status, Status.disconnected, ~network.hearing.all_reached(weights))
    attack = signal.combined(ticks.vectors_of(lane, mind), now.drive)
    jerk = ticks.exchanged(lane, network, weights, fleet.jets, now.path, attack, fleet.jerk)
    return fleet._replace(mind=mind, jerk=jerk, switches=switches, status=status)


def moved_on(jets: Jets, jerk: Float[Array, "2 m lanes"], interval: Any) -> Jets:
    """The jets after this time with the jerk held."""
    y, velocity, acceleration = jets
    h = interval
    return (
        y + h * (velocity + h / 2 * (acceleration + h / 3 * jerk)),
        velocity + h * (acceleration + h / 2 * jerk),
        acceleration + h * jerk,
    )


def moved(fleet: Fleet, interval: Any) -> Fleet:
    """The fleets at the next tick, but for what is received there.

    Lanes are singular where a vehicle stands still on the way. Only lanes in which some vehicle has gone
    straight on until then are looked at, as in `between`.
    """
    jets = moved_on(fleet.jets, fleet.jerk, interval)

    def some(few: Any, status: Code) -> Code:
        start, held = jax.tree.map(lambda leaf: picked(leaf, few), (fleet.jets, fleet.jerk))
        longest = jnp.full(few.shape, interval)
        still = standstill.stands(
            lambda jets: jets[1:],
            lambda jets, step: moved_on(jets, held, step[None, None]),
            start,
            plane.length(held),
            interval,
            longest,
        )
        return put(status, few, fail(picked(status, few), Status.singular, still))

    def work(carry: Any) -> Any:
        status, straight = carry
        straight = straight & standstill.straight(*jets[1:]) & (status == Status.ok)
        return for_each(straight, FEW, some, status), straight

    status, straight = once(fleet.straight.any(), work, (fleet.status, fleet.straight))
    return fleet._replace(jets=jets, status=status, straight=straight)


def errors_of(fleet: Fleet) -> Jets:
    """E and its derivatives."""
    y, velocity, acceleration = (
        jet - there[:, None] for jet, there in zip(fleet.jets, fleet.signals.navigator, strict=False)
    )
    return y, velocity, acceleration


def observe(fleet: Fleet, lane: Lane, network: Network, plan: Plan) -> Observation:
    """The fleets as they are measured now."""
    return Observation(
        errors_of(fleet)[0],
        *plane.pace(fleet.jets),
        lane.vehicle.state_of(fleet.jets),
        signal.combined(ticks.vectors_of(lane, fleet.mind)[:, network.shown], fleet.signals.basis[0]),
        ticks.weights_of(lane, fleet.mind, plan),
        network.hearing,
    )
