"""The flat engine: the closed loop solved exactly from tick to tick (SCIENCE O2, O2b), no integrator.

In `E_i = y_i - y_0` and its derivatives the loop is linear. While the kept sets are held,

    E(t) = e(t) + G(t),      e(t + h) = expm(A_c h) e(t),      G = L⁻¹ d,

where d is what the lies add and G so what they do to the fleet. d is a harmonic, as the vehicles' signals
are, so G is one too, with vectors `L⁻¹ d` that change only when a kept set does: then they are solved for
anew, for the lanes concerned alone, and e takes up the difference, since E does not jump.

The lanes are the last axis of every array. What a pass of a loop needs of an instant's angles it finds in
the carry: a number computed where it is used would be computed once for each vehicle that uses it.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine.metrics import SERIES, Gathered, Observation
from jaxnet.engine.plan import CONNECTED, Clock, Inputs, Outcome, Plan
from jaxnet.engine.status import LEAST_SPEED, Code, Status, fail
from jaxnet.engine.subset import for_each, picked, put
from jaxnet.model import attack, control, robot
from jaxnet.model.attack import Harmonic
from jaxnet.model.circle import circle
from jaxnet.model.lane import Lane, Network

SOLVED = 16  # lanes whose Laplacians are solved at once


class Flow(NamedTuple):
    """`expm(A_c h)` over one tick h."""

    flow: Float[Array, "3 3 *lanes"]


Angle = tuple[Float[Array, "*n"], Float[Array, "*n"]]  # its cosine and sine


class Fleet(NamedTuple):
    """Lanes under way, at a tick whose decision is taken but not yet followed."""

    free: robot.Jets  # e and its derivatives
    forced: Float[Array, "2 2 m lanes"]  # vectors of G, cosine and sine
    followed: Bool[Array, "slots m lanes"]  # dropped slots for which `forced` holds
    decided: Bool[Array, "slots m lanes"]  # slots dropped at this tick
    angle: Angle  # cos ωt and sin ωt now
    next_angle: Angle  # and at the next tick
    switches: Int[Array, "lanes"]
    status: Code


def simulate(inputs: Inputs, count: Int[Array, ""], network: Network, clock: Clock, plan: Plan) -> Outcome:
    """Lanes from 0 to the horizon, all side by side; what stands after the first `count` is filling."""
    (lane, numbers), zero = inputs, jnp.asarray(0)

    def tick(n: Int[Array, ""], fleet: Fleet) -> Fleet:
        fleet = settle(fleet, n == 0, lane, network)
        after = lane.attack.frequency * clock.at(n + 2)
        moved = fleet._replace(
            free=flown(numbers, fleet.free), angle=fleet.next_angle, next_angle=circle(after)
        )
        return decide(moved, lane, network)

    def output(number: Int[Array, ""], carry: Any) -> Any:
        fleet, gathered, series, navigator = carry
        gathered, series = measure(fleet, gathered, series, navigator, number)
        now, rest = number * clock.ticks, jnp.where(number < clock.outputs, clock.ticks, 1)
        fleet = jax.lax.fori_loop(now, now + rest, tick, fleet)
        return fleet, gathered, series, lane.navigator.angle(instant(number + 1))

    def measure(fleet: Fleet, gathered: Gathered, series: Any, navigator: Angle, number: Any) -> Any:
        seen, ok = observe(fleet, lane, network, navigator), fleet.status == Status.ok
        series = {
            name: jax.lax.dynamic_update_index_in_dim(
                kept, jnp.where(ok, SERIES[name](seen, network.hearing), jnp.nan), number, 0
            )
            for name, kept in series.items()
        }
        return gathered.add(seen, network.hearing, jnp.ones_like(ok), clock.in_tail(number)), series

    def instant(number: Any) -> Float[Array, "lanes"]:
        return jnp.broadcast_to(clock.at(number * clock.ticks), lane.tolerance.shape)

    def first() -> Any:
        seen = observe(start(lane, network, clock), lane, network, lane.navigator.angle(instant(zero)))
        return {name: SERIES[name](seen, network.hearing) for name in plan.save}

    fleet = start(lane, network, clock)
    series = jax.tree.map(lambda one: jnp.zeros((plan.rows, *one.shape)), jax.eval_shape(first))
    gathered = Gathered.start(lane.initial.shape[1:])
    carry = fleet, gathered, series, lane.navigator.angle(instant(zero))
    fleet, gathered, series, _ = jax.lax.fori_loop(zero, clock.outputs + 1, output, carry)
    status = fail(fleet.status, Status.singular, (gathered.min_speed < LEAST_SPEED).any(axis=0))
    status = fail(status, Status.nonfinite, ~gathered.finite())
    return Outcome(
        status,
        gathered.metrics(clock.tail_outputs, status == Status.ok),
        jnp.zeros_like(status),
        fleet.switches,
        series,
    )


def start(lane: Lane, network: Network, clock: Clock) -> Fleet:
    """The lanes at t = 0 with their first decision taken, all of E still free."""
    lanes, zero = lane.tolerance.shape[0], jnp.asarray(0)
    navigator = lane.navigator.jets(jnp.zeros(lanes))
    still = (jnp.abs(lane.initial[robot.SPEED]) < LEAST_SPEED).any(axis=0)
    status = fail(jnp.zeros(lanes, int), Status.singular, still)
    status = fail(status, Status.nonfinite, ~jnp.isfinite(lane.initial).all(axis=(0, 1)))
    nobody = jnp.zeros(lane.weights.shape, bool)
    fleet = Fleet(
        free=plus(robot.output_jets(lane.initial), [-jet[:, None] for jet in navigator]),
        forced=jnp.zeros((2, *lane.initial.shape))[:, :2],
        followed=nobody,
        decided=nobody,
        angle=circle(lane.attack.frequency * clock.at(zero)),
        next_angle=circle(lane.attack.frequency * clock.at(zero + 1)),
        switches=jnp.zeros(lanes, int),
        status=status,
    )
    return decide(fleet, lane, network)


def decide(fleet: Fleet, lane: Lane, network: Network) -> Fleet:
    """Hear and decide whom to keep; differences of positions do not depend on where the navigator is."""
    lies = lane.attack.at(*fleet.angle)[0]
    error = fleet.free[0] + forced(fleet.forced, lane.attack.frequency, fleet.angle)[0]
    sources = jnp.concatenate([jnp.zeros_like(error[:, :1]), error], axis=1)
    heard = network.hearing.heard(sources, lies)
    dropped = network.defence.decide(lane.weights, heard, fleet.followed, lane.tolerance)
    return fleet._replace(decided=dropped)


def settle(fleet: Fleet, first: Bool[Array, ""], lane: Lane, network: Network) -> Fleet:
    """Follow the decision in the lanes where it changed, and count the vehicles that changed their mind.

    The first decision is no change, and followed in every lane.
    """
    changed = (fleet.decided != fleet.followed).any(axis=0).sum(axis=0)
    alive = fleet.status == Status.ok
    counted = fleet._replace(switches=fleet.switches + jnp.where(alive & ~first, changed, 0))
    return follow(counted, alive & (first | (changed > 0)), lane, network)


def follow(fleet: Fleet, flagged: Bool[Array, "lanes"], lane: Lane, network: Network) -> Fleet:
    """The flagged lanes with what the lies do to them for the kept sets decided; E does not jump."""

    def some(few: Any, carry: Any) -> Any:
        free, vectors, status = carry
        weights = network.defence.in_force(picked(lane.weights, few), picked(fleet.decided, few))
        lies = Harmonic(*(picked(part, few) for part in lane.attack))
        arriving, residual = arrive(lies, weights, network)
        cosine, sine = (picked(part, few) for part in fleet.angle)
        jump = forced(picked(vectors, few) - arriving, lies.frequency, (cosine, sine))
        cut_off = fail(picked(status, few), Status.disconnected, ~(residual < CONNECTED))
        free = tuple(e.at[..., few].add(by, mode="drop") for e, by in zip(free, jump, strict=False))
        return free, put(vectors, few, arriving), put(status, few, cut_off)

    carry = for_each(flagged, SOLVED, some, (fleet.free, fleet.forced, fleet.status))
    free, vectors, status = carry
    return fleet._replace(free=free, forced=vectors, status=status, followed=fleet.decided)


def arrive(signal: Harmonic, weights: Float[Array, "slots m few"], network: Network) -> Any:
    """Vectors `L⁻¹ d` (2, 2, m, few) of the attack, and how far `L⁻¹ a0` is from 1."""
    lies = [network.hearing.lies(vectors) for vectors in (signal.cosine, signal.sine)]
    corruption = [jnp.sum(weights[None] * each, axis=1) for each in lies]
    right = jnp.concatenate(corruption).swapaxes(0, 1)
    vectors, residual = control.solve(network.hearing.matrix(weights), right)
    return vectors.swapaxes(0, 1).reshape(2, 2, *vectors.shape[::2]), residual


def flown(numbers: Flow, jets: robot.Jets) -> robot.Jets:
    """`expm(A_c h)` times the jets, for each vehicle and axis."""
    y, velocity, acceleration = jets
    rows = ((row[0][None, None], row[1][None, None], row[2][None, None]) for row in numbers.flow)
    a, b, c = (k[0] * y + k[1] * velocity + k[2] * acceleration for k in rows)
    return a, b, c


def plus(jets: Any, others: Any) -> robot.Jets:
    """Sum of two signals' jets."""
    return jets[0] + others[0], jets[1] + others[1], jets[2] + others[2]


def forced(vectors: Float[Array, "2 2 m n"], frequency: Float[Array, "n"], angle: Angle) -> attack.Jets:
    """Jets of G from its vectors."""
    return Harmonic(frequency, vectors[0], vectors[1]).at(*angle)


def observe(fleet: Fleet, lane: Lane, network: Network, navigator: Angle) -> Observation:
    """The fleets as they are measured now."""
    errors = plus(fleet.free, forced(fleet.forced, lane.attack.frequency, fleet.angle))
    jets = plus(errors, [jet[:, None] for jet in lane.navigator.at(*navigator)])
    return Observation(
        errors[0],
        *robot.pace(jets),
        robot.state_of(jets),
        lane.attack.at(*fleet.angle)[0],
        network.defence.in_force(lane.weights, fleet.decided),
    )
