"""The nonlinear vehicles under the law, integrated in their own states by adaptive Runge–Kutta steps.

Vehicles decide at ticks which sources to retain, and keep the decision between ticks. With `Plan.in_field`
vehicles decide inside the vector field, the literal reading of the paper.

The lanes are the last axis of every array. Each lane has its own time and step: `advance` attempts one step
of every lane. The fleet of a lane takes one step, that of the vehicle that needs the shortest.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxnet.engine import stepper, tick
from jaxnet.engine.following import (
    FollowedLaw,
    Following,
    exchanged,
    follow_weights,
    law_jerk,
    linearised_inputs,
)
from jaxnet.engine.loop import LaneFlags, Tick, Ticks
from jaxnet.engine.plan import Plan
from jaxnet.engine.signals import Signals, signals
from jaxnet.engine.status import LEAST_MARGIN, Code, Status, fail
from jaxnet.engine.stepper import States
from jaxnet.engine.subset import LaneIndices, for_each, picked, put, select
from jaxnet.engine.tick import DecisionState, Instants, VehicleFlags
from jaxnet.model import plane
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.solvers.choice import factorised_at_once


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


class Integration(Following[IntegrationState]):
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

    def errors(self, state: IntegrationState) -> Jets:
        """Return E and its derivatives below the order now."""
        return plane.relative(self.lane.vehicle.output_jets(state.state), state.signals.navigator)

    def states(self, state: IntegrationState) -> States:
        """Return the vehicles' states (n, m, lanes)."""
        return state.state

    def placed(
        self, state: IntegrationState, vehicles: VehicleFlags, states: States
    ) -> IntegrationState:
        """Put vehicles at rest with these states."""
        return state._replace(state=jnp.where(vehicles[None], states, state.state))

    def drive_now(
        self, state: IntegrationState, decided: DecisionState
    ) -> Float[Array, "2 m lanes"]:
        """Return `y‴ + P(ŷ)`, with y‴ of the vector field."""
        return tick.drive_along(self.lane, state.state, state.slope, decided.noise)

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
            if lane.law.needs_ticks():
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
                new, connected = follow_weights(part, network, chosen, plan, self.guesses)
            there = vector_field(part, network, new, chosen, now, states, plan)
            proposed = stepper.first_step(states, there, tolerated)
            proposed = jnp.where(
                picked(at.first, few) & (proposed > 0), proposed, picked(step, few)
            )
            followed = jax.tree.map(
                lambda all_lanes, theirs: put(all_lanes, few, theirs), followed, new
            )
            return (
                followed,
                put(slope, few, there),
                put(step, few, proposed),
                put(cut_off, few, ~connected),
            )

        flagged = at.here if lane.law.needs_ticks() or lane.sensor is not None else at.anew
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
        last, slope = clock.outputs * clock.ticks, state.slope
        if decided.frozen is not None:
            slope = jnp.where(decided.frozen[None], 0.0, slope)
        going = (status == Status.ok) & (ticks < last)
        goal = clock.at(ticks + 1)
        end = stepper.towards(goal, time, state.step)
        trial = stepper.attempt(
            lambda now, states: vector_field(
                lane, network, state.followed, decided, now, states, plan
            ),
            lambda time: signals(lane, time),
            rule,
            time,
            end,
            state.state,
            slope,
            tolerances,
        )
        kept, steps = going & (trial.error < 1.0), state.steps + going.astype(int)
        proposed = stepper.next_step(end - time, trial.error, rule.order)
        states = jnp.where(kept[None, None], trial.state, state.state)
        stuck = going & ~kept & (proposed <= stepper.LEAST_RELATIVE_STEP * jnp.maximum(goal, 1.0))
        arrived = kept & (end == goal)
        if lane.singular:
            ahead = lane.vehicle.margin(states) * jnp.sign(lane.vehicle.margin(lane.initial))
            apart = decided.may_stop
            stands = ahead < LEAST_MARGIN if apart is None else (ahead < LEAST_MARGIN) & ~apart
            status = fail(status, Status.singular, going & stands.any(axis=0))
        status = fail(status, Status.nonfinite, stuck & ~trial.finite)
        spent = going & (steps >= tolerances.max_steps) & (ticks + arrived.astype(int) < last)
        state = state._replace(
            state=states,
            slope=jnp.where(kept[None, None], trial.slope, slope),
            signals=select(kept, trial.signals, state.signals),
            step=jnp.where(going, proposed, state.step),
            steps=steps,
        )
        return state, fail(status, Status.max_steps, spent | stuck), arrived


def vector_field(
    lane: Lane,
    network: Network,
    followed: FollowedLaw,
    decided: DecisionState,
    now: Signals,
    states: States,
    plan: Plan,
) -> States:
    """Return `ẋ = f(x, u(t, x))`, with weights or a jerk held; 0 for vehicles that stop."""
    rates = rates_by_law(lane, network, followed, decided, now, states, plan)
    return rates if decided.frozen is None else jnp.where(decided.frozen[None], 0.0, rates)


def rates_by_law(
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
    if lane.law.needs_ticks():
        return lane.vehicle.motion(states, lane.vehicle.inputs_for(states, followed.jerk))
    if plan.in_field:
        before = tick.before_first(lane, network, plan)
        errors = plane.relative(lane.vehicle.output_jets(states), now.navigator)
        chosen = tick.decide(lane, network, plan, before, errors, now.basis, now.time)
        followed, _ = follow_weights(lane, network, chosen, plan, network.solver.starts)
    if lane.law.way() == "linearised":
        return lane.vehicle.motion(states, linearised_inputs(lane, followed, decided, now, states))
    own = tick.sensed(lane.vehicle.output_jets(states), decided.noise)
    jerk = law_jerk(lane, network, followed, decided, now, own, followed.guess(lane, now, own))
    return lane.vehicle.motion(states, lane.vehicle.inputs_for(states, jerk))
