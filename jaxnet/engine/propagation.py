"""The closed loop solved exactly from tick to tick (SCIENCE O2, O2b), no integrator.

In `E_i = y_i - y_0` and its derivatives the loop is linear. While the retained neighbours are held,

    E(t + h) = expm(A_c h) E(t) + G(t + h) - expm(A_c h) G(t),      G = L⁻¹ d,

where d is what the attacks add and G so what they do to the fleet. d is a sum of fixed vectors times scalar
functions of time, as the vehicles' signals are, so G is one too, with vectors `L⁻¹ d` that change only when
weights or attacks do: then they are solved for anew, for the lanes concerned alone, and E does not jump.

Where what is falsified is not a path with its derivatives, G = L⁻¹ W g with what the axis makes of the
disturbance ρ = R(β), `g‴ + P(g) = ρ`, which is summed up from tick to tick by Gauss and Legendre's rule.
Where it is, g = β solves that.

The lanes are the last axis of every array. An instant's functions are computed behind a barrier: else XLA
would compute them where they are used, once for each vehicle that uses them. A tick's decision is the carry
of a loop for the same reason.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.lax import optimization_barrier as barrier
from jaxtyping import Array, Bool, Int

from jaxnet.engine import between, metrics, response
from jaxnet.engine import tick as ticks
from jaxnet.engine.flow import Effect, Lanes, Transition, impulse_responses, passed_on, propagate
from jaxnet.engine.metrics import Observation
from jaxnet.engine.plan import Clock, Inputs, Outcome, Plan
from jaxnet.engine.status import LEAST_SPEED, Code, Status, fail
from jaxnet.engine.subset import once
from jaxnet.engine.tick import Mind
from jaxnet.model import plane, signal
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Basis, Vectors


class Fleet(NamedTuple):
    """Lanes under way, at a tick whose decision is taken and followed."""

    errors: Jets  # E and its derivatives
    forced: Vectors  # of G
    mind: Mind
    basis: Basis  # the attacks' functions now
    made: Any  # what an axis makes of them now; () where it is they themselves
    switches: Int[Array, "lanes"]
    straight: Bool[Array, "lanes"]  # where some vehicle may have gone straight on until now
    status: Code

    def effect(self) -> Any:
        """The scalar functions of G now, with two derivatives or more."""
        return self.basis if isinstance(self.made, tuple) else self.made


def simulate(inputs: Inputs, count: Int[Array, ""], network: Network, clock: Clock, plan: Plan) -> Outcome:
    """Lanes from 0 to the horizon, all side by side; what stands after the first `count` is filling."""
    (lane, numbers), zero = inputs, jnp.asarray(0)

    def instant(number: Any) -> Lanes:
        return jnp.broadcast_to(clock.at(jnp.asarray(number)), lane.amplitude.shape)

    def tick(number: Int[Array, ""], fleet: Fleet) -> Fleet:
        time, first = instant(number), number == 0
        flow, before = jnp.where(first, nowhere, numbers.flow), fleet.effect()
        fleet = fleet._replace(
            basis=barrier(lane.signal.basis(time)),
            made=() if plan.consistent else barrier(effect_at(number, fleet.made)),
        )
        forcing = barrier(fleet.effect()[:3] - jnp.stack(propagate(flow, before)))
        fleet, decided = go_on(fleet, flow, forcing, time, lane, network, plan)
        status, straight = between.stopped(fleet, time, ~first, inputs, clock.interval, plan)
        fleet = fleet._replace(status=status, straight=straight)
        return settle(fleet, decided, first, lane, network, plan) if plan.choosing else fleet

    def effect_at(number: Any, before: Any) -> Any:
        after = passed_on(before, numbers.flow, responses, lane, instant(number - 1), clock.interval)
        return jnp.where(number == 0, before, after)

    def output(number: Int[Array, ""], carry: Any) -> Any:
        fleet, gathered, series = carry
        if plan.choosing or not plan.consistent:
            last = number * clock.ticks
            fleet = jax.lax.fori_loop(jnp.maximum(0, last - clock.ticks + 1), last + 1, tick, fleet)
        else:
            fleet = tick(number, fleet)
        return fleet, *measure(fleet, gathered, series, number)

    def measure(fleet: Fleet, gathered: Any, series: Any, number: Any) -> Any:
        navigator = barrier(lane.navigator.jets(instant(number * clock.ticks)))
        seen, ok = observe(fleet, lane, network, plan, navigator), fleet.status == Status.ok
        series = {
            name: jax.lax.dynamic_update_index_in_dim(series[name], jnp.where(ok, value, jnp.nan), number, 0)
            for name, value in ticks.series(plan, seen).items()
        }
        everywhere = jnp.ones_like(ok)
        return metrics.add(plan.metrics, gathered, seen, everywhere, clock.in_tail(number)), series

    nowhere = jnp.eye(3)[:, :, None]  # the flow of no time, to the first tick
    responses: Any = () if plan.consistent else impulse_responses(lane.gain, clock.interval)
    fleet = start(lane, network, plan, instant(zero))
    series = ticks.room(plan, lambda: observe(fleet, lane, network, plan, lane.navigator.jets(instant(zero))))
    carry = fleet, metrics.nothing(plan.metrics, lane.initial.shape[1:]), series
    fleet, gathered, series = jax.lax.fori_loop(zero, clock.outputs + 1, output, carry)
    status = fail(fleet.status, Status.singular, (gathered["min_speed"] < LEAST_SPEED).any(axis=0))
    status = fail(status, Status.nonfinite, ~metrics.finite(gathered))
    found = metrics.of_fleet(plan.metrics, gathered, clock.outputs, clock.tail_outputs, status == Status.ok)
    return Outcome(status, found, jnp.zeros_like(status), fleet.switches, series)


def start(lane: Lane, network: Network, plan: Plan, time: Lanes) -> Fleet:
    """The lanes before their first tick, at t = 0; where nobody decides, with what the attacks do to them."""
    navigator, mind = lane.navigator.jets(time), ticks.begin(lane, network, plan)
    status, basis = ticks.status_at_start(lane), lane.signal.basis(time)
    fleet = Fleet(
        errors=plus(lane.vehicle.output_jets(lane.initial), [-jet[:, None] for jet in navigator]),
        forced=jnp.zeros((2, lane.weights.shape[1], *lane.vectors.shape[2:])),
        mind=mind,
        basis=basis,
        made=() if plan.consistent else jnp.zeros_like(basis[:3]),
        switches=jnp.zeros_like(status),
        straight=status == Status.ok,
        status=status,
    )
    if plan.choosing:
        return fleet
    everybody = jnp.ones(lane.weights.shape[1:], bool)
    return follow(fleet, status == Status.ok, everybody, lane, network, plan)


def go_on(
    fleet: Fleet, flow: Transition, forcing: Effect, time: Lanes, lane: Lane, network: Network, plan: Plan
) -> tuple[Fleet, Mind]:
    """The fleet moved to this tick, and what is received and decided there.

    `forcing` are the functions of `G(t + h) - expm(A_c h) G(t)` and its derivatives.
    """

    def work(carry: tuple[Jets, Mind]) -> tuple[Jets, Mind]:
        errors, mind = carry
        errors = plus(propagate(flow, errors), signal.jets(fleet.forced, forcing))
        return errors, ticks.decide(lane, network, plan, mind, errors, fleet.basis, time)

    errors, decided = once((fleet.status == Status.ok).any(), work, (fleet.errors, fleet.mind))
    return fleet._replace(errors=errors), decided


def settle(
    fleet: Fleet, decided: Mind, first: Bool[Array, ""], lane: Lane, network: Network, plan: Plan
) -> Fleet:
    """Follow the decision in the lanes where it is another one, and count the vehicles that changed theirs.

    The first decision is no change, and followed in every lane.
    """
    lanes, vehicles = ticks.changed(decided, fleet.mind, lane)
    alive = fleet.status == Status.ok
    switches = fleet.switches + jnp.where(alive & ~first, vehicles.sum(axis=0), 0)
    fleet, changed = fleet._replace(mind=decided, switches=switches), vehicles | first
    return follow(fleet, alive & (first | lanes), changed, lane, network, plan)


def follow(
    fleet: Fleet,
    flagged: Bool[Array, "lanes"],
    changed: Bool[Array, "m lanes"],
    lane: Lane,
    network: Network,
    plan: Plan,
) -> Fleet:
    """The flagged lanes with what the attacks do to them for the weights decided.

    `changed` are the vehicles that decided otherwise, if any decide.
    """

    def solve(carry: Any) -> Any:
        (forced, status), left = carry, flagged
        if response.local(fleet.mind, network, plan):
            forced, left = response.solved_near(forced, flagged, changed, fleet.mind, lane, network)
        return response.solved(forced, status, left, fleet.mind, lane, network, plan)

    forced, status = once(flagged.any(), solve, (fleet.forced, fleet.status))
    return fleet._replace(forced=forced, status=status)


def plus(jets: Any, others: Any) -> Jets:
    """Sum of two signals' jets."""
    return jets[0] + others[0], jets[1] + others[1], jets[2] + others[2]


def observe(fleet: Fleet, lane: Lane, network: Network, plan: Plan, navigator: Any) -> Observation:
    """The fleets as they are measured now."""
    jets = plus(fleet.errors, [jet[:, None] for jet in navigator])
    return Observation(
        fleet.errors[0],
        *plane.pace(jets),
        lane.vehicle.state_of(jets),
        signal.combined(ticks.vectors_of(lane, fleet.mind)[:, network.shown], fleet.basis[0]),
        ticks.weights_of(lane, fleet.mind, plan),
        network.hearing,
    )
