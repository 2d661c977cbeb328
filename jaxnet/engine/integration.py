"""The nonlinear vehicles under the law, integrated adaptively: the reference for the other engines.

The engine evaluates the law from the received jets and solves the law with the weights in force. The engine
does not presuppose the exact cancellation that the law achieves. Vehicles decide at ticks which sources to
retain, and keep the decision between ticks. With `Plan.in_field` vehicles decide inside the vector field, the
literal reading of the paper.

The lanes are the last axis of every array. Each lane has its own time and step: `advance` attempts one step
of every lane. A few vehicles of a lane may need shorter steps, and take them within that step (`multirate`).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine import multirate, stepper, tick
from jaxnet.engine.loop import LaneFlags, Motion, PerVehicle, Tick, Ticks
from jaxnet.engine.plan import CONNECTED, Plan
from jaxnet.engine.signals import Signals, signals
from jaxnet.engine.status import LEAST_SPEED, Code, Status, fail
from jaxnet.engine.stepper import States
from jaxnet.engine.subset import LaneIndices, for_each, picked, put, select
from jaxnet.engine.tick import DecisionState, Drive, Instants
from jaxnet.kinds.vehicles import SPEED
from jaxnet.model import control, plane, signal
from jaxnet.model.hearing import AxisWeights
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Basis, Vectors
from jaxnet.solvers.choice import factorised_at_once

Jerk = Float[Array, "2 m lanes"]


class FollowedLaw(NamedTuple):
    """Weights, factors and jerk that vehicles follow until the next tick. Absent parts are None."""

    weights: AxisWeights
    factors: Any  # by the network's solver, of these weights' Laplacian; None where a jerk is held
    jerk: Jerk | None  # held until the next tick
    response: Vectors | None  # L⁻¹ d, from which an iteration starts


class IntegrationState(NamedTuple):
    """State of the lanes under way."""

    state: States
    slope: States  # the vector field at this state
    signals: Signals
    step: Instants  # [s] proposed for the next attempt
    steps: Int[Array, " lanes"]  # attempts so far, kept and refused
    followed: FollowedLaw


HoldCarry = tuple[
    FollowedLaw, States, Instants, LaneFlags
]  # law, slope, step, and lanes with a vehicle cut off


class Integration(Motion[IntegrationState]):
    """Motion of the nonlinear vehicles under the law, by adaptive steps. `numbers` are the tolerances."""

    def begin(self) -> IntegrationState:
        """Return the state at t = 0; nothing is followed yet."""
        lane, zero = self.lane, jnp.zeros_like(self.lane.attack_scale)
        shapes = jax.eval_shape(self.followed_first)
        return IntegrationState(
            state=lane.initial,
            slope=jnp.zeros_like(lane.initial),
            signals=signals(lane, zero),
            step=zero + self.clock.interval,
            steps=jnp.zeros(zero.shape, int),
            followed=jax.tree.map(lambda leaf: jnp.zeros(leaf.shape), shapes),
        )

    def followed_first(self) -> FollowedLaw:
        """Return the law followed before the first tick, needed for its shapes alone."""
        lane, network, plan = self.lane, self.network, self.plan
        decided = tick.before_first(lane, network, plan)
        if lane.law.holds:
            return FollowedLaw(
                tick.drive(lane, decided, plan).weights, None, jnp.zeros_like(lane.initial[:2]), None
            )
        return follow_weights(lane, network, decided, plan)[0]

    def errors(self, state: IntegrationState) -> Jets:
        """Return E and its first two derivatives now."""
        return plane.relative(self.lane.vehicle.output_jets(state.state), state.signals.navigator)

    def basis(self, state: IntegrationState) -> tuple[Instants, Basis]:
        """Return the time [s] and the attacks' functions now."""
        return state.signals.time, state.signals.basis

    def seen(self, state: IntegrationState) -> tuple[PerVehicle, PerVehicle, States]:
        """Return speed [m/s] and turn rate [rad/s], (m, lanes), and the vehicles' states (n, m, lanes)."""
        return *self.lane.vehicle.pace(state.state), state.state

    def drive(self, state: IntegrationState, decided: DecisionState) -> Drive:
        """Return the weights and attack vectors that the motion follows now."""
        if self.plan.in_field:
            return tick.drive(self.lane, decided, self.plan)
        vectors = tick.attack_vectors(self.lane, decided)
        return Drive(state.followed.weights, vectors, decided.noise, decided.reception)

    def drive_now(self, state: IntegrationState, decided: DecisionState) -> Float[Array, "2 m lanes"]:
        """Return `y‴ + P(ŷ)`, with y‴ of the vector field."""
        return tick.drive_along(self.lane, state.state, state.slope, decided.noise)

    def steps(self, state: IntegrationState) -> Int[Array, " lanes"]:
        """Return the number of attempts so far."""
        return state.steps

    def hold(
        self, state: IntegrationState, decided: DecisionState, at: Tick
    ) -> tuple[IntegrationState, LaneFlags]:
        """Factorise the Laplacian where a weight changed, and evaluate the vector field again.

        Where the law holds a jerk, vehicles exchange the jerk at every tick instead.
        """
        lane, network, plan = self.lane, self.network, self.plan

        def some(few: LaneIndices, carry: HoldCarry) -> HoldCarry:
            followed, slope, step, cut_off = carry
            part, now, chosen, tolerated = jax.tree.map(
                lambda leaf: picked(leaf, few), (lane, state.signals, decided, self.numbers)
            )
            states = picked(state.state, few)
            if lane.law.holds:
                new, connected = exchanged(
                    part,
                    network,
                    chosen,
                    jax.tree.map(lambda leaf: picked(leaf, few), followed.jerk),
                    now,
                    states,
                    plan,
                )
            else:
                new, connected = follow_weights(part, network, chosen, plan)
            there = vector_field(part, network, new, chosen, now, states, plan)
            proposed = stepper.first_step(states, there, tolerated)
            proposed = jnp.where(picked(at.first, few) & (proposed > 0), proposed, picked(step, few))
            followed = jax.tree.map(lambda all_lanes, theirs: put(all_lanes, few, theirs), followed, new)
            return followed, put(slope, few, there), put(step, few, proposed), put(cut_off, few, ~connected)

        flagged = at.here if lane.law.holds or lane.sensor is not None else at.anew
        carry = state.followed, state.slope, state.step, jnp.zeros_like(at.here)
        at_once = factorised_at_once(lane.initial.shape[1])
        followed, slope, step, cut_off = for_each(flagged, at_once, some, carry)
        return state._replace(followed=followed, slope=slope, step=step), cut_off

    def advance(
        self, state: IntegrationState, decided: DecisionState, ticks: Ticks, status: Code
    ) -> tuple[IntegrationState, Code, LaneFlags]:
        """Attempt one step of the lanes that have neither failed nor reached the horizon."""
        lane, network, clock, plan = self.lane, self.network, self.clock, self.plan
        tolerances, time, rule = self.numbers, state.signals.time, stepper.method(plan.options[0])
        last = clock.outputs * clock.ticks
        going = (status == Status.ok) & (ticks < last)
        goal = clock.at(ticks + 1)
        end = stepper.towards(goal, time, state.step)
        trial = stepper.attempt(
            lambda now, states: vector_field(lane, network, state.followed, decided, now, states, plan),
            lambda time: signals(lane, time),
            rule,
            time,
            end,
            state.state,
            state.slope,
            tolerances,
        )
        if multirate.suits(lane, plan):
            trial = multirate.refined(trial, going, time, end, state.state, lane, tolerances, rule)
        kept, steps = going & (trial.error < 1.0), state.steps + going.astype(int)
        proposed = stepper.next_step(end - time, trial.error, rule)
        states = jnp.where(kept[None, None], trial.state, state.state)
        still = (states[SPEED] * jnp.sign(lane.initial[SPEED]) < LEAST_SPEED).any(axis=0)
        stuck = going & ~kept & (proposed <= stepper.LEAST_RELATIVE_STEP * jnp.maximum(goal, 1.0))
        arrived = kept & (end == goal)
        status = fail(status, Status.singular, going & still)
        status = fail(status, Status.nonfinite, stuck & ~trial.finite)
        spent = going & (steps >= tolerances.max_steps) & (ticks + arrived.astype(int) < last)
        state = state._replace(
            state=states,
            slope=jnp.where(kept[None, None], trial.slope, state.slope),
            signals=select(kept, trial.signals, state.signals),
            step=jnp.where(going, proposed, state.step),
            steps=steps,
        )
        return state, fail(status, Status.max_steps, spent | stuck), arrived


def follow_weights(
    lane: Lane, network: Network, decided: DecisionState, plan: Plan
) -> tuple[FollowedLaw, Bool[Array, " few"]]:
    """Return the law with weights and factors, and whether the navigator reaches every vehicle."""
    drive = tick.drive(lane, decided, plan)
    factors, residual = network.solver.factorise(network.hearing, drive.weights)
    followed = FollowedLaw(drive.weights, factors, None, None)
    if network.solver.starts:
        followed = followed._replace(response=response(drive.vectors, followed, network))
    if drive.reception is None:
        return followed, residual < CONNECTED
    return followed, ~tick.cut_off(lane, network, decided, plan)


def response(vectors: Vectors, followed: FollowedLaw, network: Network) -> Vectors:
    """Return `L⁻¹ d` for the attacks' vectors."""

    def of_one(vector: Jerk) -> Jerk:
        right = network.hearing.mean_added(followed.weights, vector)
        return network.solver.apply(network.hearing, followed.factors, right, None)

    return jnp.moveaxis(jax.lax.map(of_one, jnp.moveaxis(vectors, 2, 0)), 0, 2)


def exchanged(
    lane: Lane,
    network: Network,
    decided: DecisionState,
    last: Jerk,
    now: Signals,
    states: States,
    plan: Plan,
) -> tuple[FollowedLaw, Bool[Array, " few"]]:
    """Return the law with weights and exchanged jerk, and whether the navigator reaches every vehicle."""
    drive, own = tick.drive(lane, decided, plan), lane.vehicle.output_jets(states)
    attack = signal.combined(drive.vectors, now.drive)
    jerk = tick.exchange(lane, network, drive, own, now.path, attack, last)
    return FollowedLaw(drive.weights, None, jerk, None), ~tick.cut_off(lane, network, decided, plan)


def vector_field(
    lane: Lane,
    network: Network,
    followed: FollowedLaw,
    decided: DecisionState,
    now: Signals,
    states: States,
    plan: Plan,
) -> States:
    """Return `ẋ = f(x, u(t, x))`, with weights or a jerk held.

    With `Plan.in_field` vehicles decide at each evaluation, without memory.
    """
    if lane.law.holds:
        return lane.vehicle.motion(states, lane.vehicle.inputs_for(states, followed.jerk))
    if plan.in_field:
        before = tick.before_first(lane, network, plan)
        errors = plane.relative(lane.vehicle.output_jets(states), now.navigator)
        chosen = tick.decide(lane, network, plan, before, errors, now.basis, now.time)
        followed, _ = follow_weights(lane, network, chosen, plan)
    own = tick.sensed(lane.vehicle.output_jets(states), decided.noise)
    attack = signal.combined(tick.attack_vectors(lane, decided), now.drive)
    demand = control.demand(own, now.path, attack, network.hearing, followed.weights, lane.gain)
    if decided.reception is not None:
        demand = demand + decided.reception.kept
    start = None if followed.response is None else expected(lane, followed.response, now, own)
    jerk = network.solver.apply(network.hearing, followed.factors, demand, start)
    return lane.vehicle.motion(states, lane.vehicle.inputs_for(states, jerk))


def expected(lane: Lane, response: Vectors, now: Signals, own: Jets) -> Jerk:
    """Return the jerk of an exact cancellation: `R(y_0) - P(y)` plus the attacks' effect.

    The iteration starts from this jerk, and goes on until the jerk solves the law for the received jets.
    """
    forced = signal.combined(response, now.drive)
    return now.path[:, None] + forced - control.feedback(lane.gain, own)
