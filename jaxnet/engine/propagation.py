"""The closed loop solved exactly from tick to tick (SCIENCE O2, O2b), no integrator.

In `E_i = y_i - y_0` and its derivatives the loop is linear. While the retained neighbours are held,

    E(t) = e(t) + G(t),      e(t + h) = expm(A_c h) e(t),      G = L⁻¹ d,

where d is what the attacks add and G so what they do to the fleet. d is a sum of fixed vectors times scalar
functions of time, as the vehicles' signals are, so G is one too, with vectors `L⁻¹ d` that change only when
weights or attacks do: then they are solved for anew, for the lanes concerned alone, and e takes up the
difference, since E does not jump.

Where what is falsified is not a path with its derivatives, G = L⁻¹ W g with what the axis makes of the
disturbance ρ = R(β), `g‴ + P(g) = ρ`, which is summed up from tick to tick by Gauss and Legendre's rule.
Where it is, g = β solves that.

The lanes are the last axis of every array. An instant's functions are computed behind a barrier: else XLA
would compute them where they are used, once for each vehicle that uses them.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import optimization_barrier as barrier
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine import metrics, response
from jaxnet.engine import tick as ticks
from jaxnet.engine.methods.exact import Flow
from jaxnet.engine.metrics import Observation
from jaxnet.engine.plan import Clock, Inputs, Outcome, Plan
from jaxnet.engine.status import LEAST_SPEED, Code, Status, fail
from jaxnet.engine.subset import once
from jaxnet.engine.tick import Mind
from jaxnet.model import control, plane, signal
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Basis, Vectors

NODES = (np.polynomial.legendre.leggauss(8)[0] + 1) / 2  # of Gauss and Legendre's rule on [0, 1]
SHARES = np.polynomial.legendre.leggauss(8)[1] / 2

Lanes = Float[Array, "lanes"]


class Fleet(NamedTuple):
    """Lanes under way, at a tick whose decision is taken but not yet followed."""

    free: Jets  # e and its derivatives
    forced: Vectors  # of G
    followed: Mind  # for which `forced` holds
    mind: Mind  # decided at this tick
    basis: Basis  # the attacks' functions now
    made: Any  # what an axis makes of them now; () where it is they themselves
    switches: Int[Array, "lanes"]
    status: Code

    def effect(self) -> Any:
        """The scalar functions of G now, with two derivatives or more."""
        return self.basis if isinstance(self.made, tuple) else self.made


def simulate(inputs: Inputs, count: Int[Array, ""], network: Network, clock: Clock, plan: Plan) -> Outcome:
    """Lanes from 0 to the horizon, all side by side; what stands after the first `count` is filling."""
    (lane, numbers), zero = inputs, jnp.asarray(0)

    def instant(number: Any) -> Lanes:
        return jnp.broadcast_to(clock.at(jnp.asarray(number)), lane.amplitude.shape)

    def tick(n: Int[Array, ""], fleet: Fleet) -> Fleet:
        if plan.choosing:
            fleet = settle(fleet, n == 0, lane, network, plan)
        moved = fleet._replace(
            free=propagate(numbers, fleet.free),
            basis=barrier(lane.signal.basis(instant(n + 1))),
            made=() if plan.consistent else barrier(effect_after(fleet.made, instant(n))),
        )
        return decide(moved, lane, network, plan, instant(n + 1))

    def effect_after(effect: Any, time: Lanes) -> Any:
        return passed_on(effect, responses, lane, numbers, time, clock.interval)

    def output(number: Int[Array, ""], carry: Any) -> Any:
        fleet, gathered, series = carry
        gathered, series = measure(fleet, gathered, series, number)
        if plan.choosing or not plan.consistent:
            now, rest = number * clock.ticks, jnp.where(number < clock.outputs, clock.ticks, 1)
            fleet = jax.lax.fori_loop(now, now + rest, tick, fleet)
        else:
            fleet = tick(number, fleet)
        return fleet, gathered, series

    def measure(fleet: Fleet, gathered: Any, series: Any, number: Any) -> Any:
        navigator = barrier(lane.navigator.jets(instant(number * clock.ticks)))
        seen, ok = observe(fleet, lane, network, plan, navigator), fleet.status == Status.ok
        series = {
            name: jax.lax.dynamic_update_index_in_dim(series[name], jnp.where(ok, value, jnp.nan), number, 0)
            for name, value in ticks.series(plan, seen).items()
        }
        everywhere = jnp.ones_like(ok)
        return metrics.add(plan.metrics, gathered, seen, everywhere, clock.in_tail(number)), series

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
    """The lanes at t = 0 with their first decision taken, all of E still free."""
    navigator, mind = lane.navigator.jets(time), ticks.begin(lane, network, plan)
    status, basis = ticks.status_at_start(lane), lane.signal.basis(time)
    fleet = Fleet(
        free=plus(lane.vehicle.output_jets(lane.initial), [-jet[:, None] for jet in navigator]),
        forced=jnp.zeros((2, lane.weights.shape[1], *lane.vectors.shape[2:])),
        followed=mind._replace(memory=(), plot=()),
        mind=mind,
        basis=basis,
        made=() if plan.consistent else jnp.zeros_like(basis[:3]),
        switches=jnp.zeros_like(status),
        status=status,
    )
    if not plan.choosing:
        everybody = jnp.ones(lane.weights.shape[1:], bool)
        return follow(fleet, status == Status.ok, everybody, lane, network, plan)
    return decide(fleet, lane, network, plan, time)


def decide(fleet: Fleet, lane: Lane, network: Network, plan: Plan, time: Lanes) -> Fleet:
    """Have vehicles receive and decide."""
    errors = plus(fleet.free, signal.jets(fleet.forced, fleet.effect()))
    return fleet._replace(mind=ticks.decide(lane, network, plan, fleet.mind, errors, fleet.basis, time))


def settle(fleet: Fleet, first: Bool[Array, ""], lane: Lane, network: Network, plan: Plan) -> Fleet:
    """Follow the decision in the lanes where it is another one, and count the vehicles that changed theirs.

    The first decision is no change, and followed in every lane.
    """
    lanes, vehicles = ticks.changed(fleet.mind, fleet.followed, lane)
    alive = fleet.status == Status.ok
    switches = fleet.switches + jnp.where(alive & ~first, vehicles.sum(axis=0), 0)
    changed = vehicles | first
    return follow(fleet._replace(switches=switches), alive & (first | lanes), changed, lane, network, plan)


def follow(
    fleet: Fleet,
    flagged: Bool[Array, "lanes"],
    changed: Bool[Array, "m lanes"],
    lane: Lane,
    network: Network,
    plan: Plan,
) -> Fleet:
    """The flagged lanes with what the attacks do to them for the weights decided; E does not jump.

    `changed` are the vehicles that decided otherwise, if any decide.
    """

    def every(carry: Any) -> Any:
        free, before, status = carry
        forced, left = before, flagged
        if response.local(fleet.mind, network, plan):
            forced, left = response.solved_near(before, flagged, changed, fleet.mind, lane, network)
        forced, status = response.solved(forced, status, left, fleet.mind, lane, network, plan)
        return plus(free, signal.jets(before - forced, fleet.effect())), forced, status

    carry = fleet.free, fleet.forced, fleet.status
    free, forced, status = once(flagged.any(), every, carry)
    followed = fleet.mind._replace(memory=(), plot=())
    return fleet._replace(free=free, forced=forced, status=status, followed=followed)


def propagate(numbers: Flow, jets: Jets) -> Jets:
    """`expm(A_c h)` times the jets, for each vehicle and axis."""
    y, velocity, acceleration = jets
    rows = ((row[0][None, None], row[1][None, None], row[2][None, None]) for row in numbers.flow)
    a, b, c = (k[0] * y + k[1] * velocity + k[2] * acceleration for k in rows)
    return a, b, c


def impulse_responses(gain: control.Gain, interval: Any) -> Float[Array, "nodes 3 lanes"]:
    """`expm(A_c (1 - x) h) B` at the NODES x of a tick h."""
    identity = jnp.broadcast_to(jnp.eye(3)[1:, :, None], (2, *gain.shape))
    companion = jnp.concatenate([identity, -gain[None]]) * interval
    rest = companion[None] * (1 - NODES)[:, None, None, None]
    return jax.vmap(jax.vmap(jax.scipy.linalg.expm, -1, -1))(rest)[:, :, 2]


def passed_on(
    effect: Float[Array, "3 functions lanes"],
    responses: Float[Array, "nodes 3 lanes"],
    lane: Lane,
    numbers: Flow,
    time: Lanes,
    interval: Any,
) -> Float[Array, "3 functions lanes"]:
    """What an axis makes of the attacks' functions one tick on: `g‴ + P(g) = R(β)`, from g now.

    `x(t + h) = expm(A_c h) x(t) + ∫ expm(A_c (h - s)) B R(β)(t + s) ds`, exact to rounding for functions that
    are smooth within a tick.
    """
    total = jnp.einsum("klL,lbL->kbL", numbers.flow, effect)
    for node, share, answer in zip(NODES, SHARES, responses, strict=True):
        disturbance = control.driven(lane.gain, lane.signal.basis(time + node * interval))
        total = total + share * interval * answer[:, None] * disturbance[None]
    return total


def plus(jets: Any, others: Any) -> Jets:
    """Sum of two signals' jets."""
    return jets[0] + others[0], jets[1] + others[1], jets[2] + others[2]


def observe(fleet: Fleet, lane: Lane, network: Network, plan: Plan, navigator: Any) -> Observation:
    """The fleets as they are measured now."""
    errors = plus(fleet.free, signal.jets(fleet.forced, fleet.effect()))
    jets = plus(errors, [jet[:, None] for jet in navigator])
    return Observation(
        errors[0],
        *plane.pace(jets),
        lane.vehicle.state_of(jets),
        signal.combined(ticks.vectors_of(lane, fleet.mind)[:, network.shown], fleet.basis[0]),
        ticks.weights_of(lane, fleet.mind, plan),
        network.hearing,
    )
