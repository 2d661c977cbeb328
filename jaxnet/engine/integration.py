"""Nonlinear vehicles under the law, integrated in their own states by adaptive Runge–Kutta steps.

Vehicles decide at ticks which sources to retain, and keep the decision between ticks. With
`Plan.in_field` vehicles decide inside the vector field, the literal reading of the paper.

The lanes are the last axis of every array. Each lane has its own time and step: `advance` attempts
one step of every lane. The fleet of a lane takes one step, that of the vehicle that needs the
shortest.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from jaxnet.engine import stepper, tick, vehicles
from jaxnet.engine.demand import Signals, signals
from jaxnet.engine.following import Followed, Following, Scene, follow_weights
from jaxnet.engine.loop import InStates
from jaxnet.engine.moment import Instants, Moment, PerAxis, VehicleFlags
from jaxnet.engine.plan import Plan
from jaxnet.engine.stages import stopping
from jaxnet.engine.stages.coasting import rests_on_the_way
from jaxnet.engine.stages.stopping import Rest
from jaxnet.engine.status import LEAST_MARGIN, Status, fail
from jaxnet.engine.subset import LaneIndices, for_each, picked, put, select
from jaxnet.engine.tick import DecisionState
from jaxnet.engine.vehicles import States
from jaxnet.kinds.vehicles import HEADING
from jaxnet.model import plane
from jaxnet.model.lane import Lane, Network
from jaxnet.solvers.choice import factorised_at_once


class IntegrationState(NamedTuple):
    """State of the lanes under way."""

    states: States
    slope: States  # the vector field at this state
    signals: Signals
    step: Instants  # [s] proposed for the next attempt
    steps: Int[Array, " lanes"]  # attempts so far, kept and refused
    followed: Followed
    rest: Rest | None  # None where vehicles do not stop


class Integration(InStates, Following[IntegrationState]):
    """Motion of nonlinear vehicles under the law, by adaptive steps; `numbers` are tolerances."""

    def begin(self):
        lane, zero = self.lane, jnp.zeros_like(self.lane.attack_scale)
        return IntegrationState(
            states=vehicles.first_states(lane),
            slope=jnp.zeros_like(lane.initial),
            signals=signals(lane, zero),
            step=zero + self.clock.interval,
            steps=jnp.zeros(zero.shape, int),
            followed=self.nothing_followed(),
            rest=stopping.first_rest(lane, rests_on_the_way(lane, self.plan)),
        )

    def drive_now(self, state, decided):
        """`y^(r) + P(ŷ)`, with y^(r) of the vector field; with q, if the law holds q."""
        lane, time = self.lane, state.signals.time
        if lane.law.needs_ticks():
            return self.held_drive(state, decided)
        return drive_along(lane, state.states, state.slope, time, decided)

    def hold(self, state, decided, at):
        """Factorise the Laplacian where a weight changed, and evaluate the vector field again.

        Where the law holds a jerk, vehicles exchange the jerk at every tick instead.
        """
        given = self.lane, decided, self.numbers, state.signals, state.states, state.step, at.first

        def some(few: LaneIndices, carry: Any) -> Any:
            followed, *others = carry
            followed, new, connected = self.follow(
                state, followed, decided, few, lambda: state.states
            )
            part, chosen, tolerated, now, states, step, first = jax.tree.map(
                lambda leaf: picked(leaf, few), given
            )
            scene = Scene(part, self.network, chosen, now)
            slope = vector_field(scene, new, states, self.plan)
            proposed = stepper.first_step(states, slope, tolerated)
            found = slope, jnp.where(first & (proposed > 0), proposed, step), ~connected
            return followed, *(put(old, few, new) for old, new in zip(others, found, strict=True))

        lane = self.lane
        flagged = at.here if lane.law.needs_ticks() or decided.sensed.errs else at.anew
        carry = state.followed, state.slope, state.step, jnp.zeros_like(at.here)
        at_once = factorised_at_once(lane.initial.shape[1])
        followed, slope, step, cut_off = for_each(flagged, at_once, some, carry)
        return state._replace(followed=followed, slope=slope, step=step), cut_off

    def advance(self, state, decided, ticks, status):
        """Attempt one step of the lanes that have neither failed nor reached the horizon."""
        lane, clock, tolerances, time = self.lane, self.clock, self.numbers, state.signals.time
        rule = stepper.method(self.plan.options[0])
        last, rest = clock.outputs * clock.ticks, state.rest
        frozen = stopping.at_rest(rest, decided.coasting.frozen(lane))
        slope = jnp.where(frozen[None], 0.0, state.slope)
        going = (status == Status.ok) & (ticks < last)
        goal = clock.at(ticks + 1)
        end = stepper.towards(goal, time, state.step)

        def field(now: Signals, states: States) -> States:
            scene = Scene(lane, self.network, decided, now)
            rates = vector_field(scene, state.followed, states, self.plan)
            return rates if rest is None else jnp.where(frozen[None], 0.0, rates)

        known = rule, time, end, state.states, slope, tolerances
        trial = stepper.attempt(field, lambda time: signals(lane, time), *known)
        kept, steps = going & (trial.error < 1.0), state.steps + going.astype(int)
        proposed = stepper.next_step(end - time, trial.error, rule.order)
        shortest = stepper.LEAST_RELATIVE_STEP * jnp.maximum(goal, 1.0)
        if rest is not None:
            among = decided.coasting.may_stop(lane) & ~frozen
            lands, over, share = landing(lane, state.states, trial.state, among)
            lands = lands | (over & (end - time <= shortest)[None])
            over = (over & ~lands).any(axis=0)
            kept = kept & ~over
            proposed = jnp.where(over, jnp.minimum(proposed, share * (end - time)), proposed)
            heading, place = trial.state[HEADING], trial.state[:2]
            new = Rest(lands & kept[None], vehicles.standing(lane, place, heading))
            rest = rest.plus(new)
            trial = trial._replace(state=jnp.where(new.which[None], new.states, trial.state))
        states = jnp.where(kept[None, None], trial.state, state.states)
        stuck = going & ~kept & (proposed <= shortest)
        arrived = kept & (end == goal)
        if lane.singular:
            passed = vehicles.passed_singular(lane, states, decided.coasting.may_stop(lane))
            status = fail(status, Status.singular, going & passed.any(axis=0))
        status = fail(status, Status.nonfinite, stuck & ~trial.finite)
        spent = going & (steps >= tolerances.max_steps) & (ticks + arrived.astype(int) < last)
        state = state._replace(
            states=states,
            slope=jnp.where(kept[None, None], trial.slope, slope),
            signals=select(kept, trial.signals, state.signals),
            step=jnp.where(going, proposed, state.step),
            steps=steps,
            rest=rest,
        )
        return state, fail(status, Status.max_steps, spent | stuck), arrived


def landing(
    lane: Lane, now: States, then: States, among: VehicleFlags
) -> tuple[VehicleFlags, VehicleFlags, Instants]:
    """Vehicles that come to rest at the end of a step, vehicles that do so within it, and a share
    of the step, by the secant, in which the first of these comes to rest.
    """
    before, after = (vehicles.ahead(lane, states) for states in (now, then))
    passes = among & (after < LEAST_MARGIN)
    over = passes & (after <= -LEAST_MARGIN)
    share = jnp.where(over, before / (before - after), 1.0)
    return passes & ~over, over, share.min(axis=0)


def vector_field(scene: Scene, followed: Followed, states: States, plan: Plan) -> States:
    """`ẋ = f(x, u(t, x))`, with weights or a jerk held; 0 for vehicles that stop.

    With `Plan.in_field` vehicles decide at each evaluation, without memory.
    """
    lane, network, decided, now = scene
    if plan.in_field and not lane.law.needs_ticks():
        chosen = decided_in_field(lane, network, now, states, plan)
        followed, _ = follow_weights(lane, network, chosen, network.solver.starts)
    return jnp.where(decided.coasting.frozen(lane)[None], 0.0, followed.rates(scene, states))


def decided_in_field(
    lane: Lane, network: Network, now: Signals, states: States, plan: Plan
) -> DecisionState:
    """Decisions for the jets received now, without memory."""
    errors = plane.relative(vehicles.outputs(lane, states, now.time), now.navigator)
    still = jnp.zeros_like(errors[0])
    moment = Moment(lane, network, plan, errors, now.basis, now.time, still)
    return tick.decide(moment, tick.before_first(lane, network, plan))


def drive_along(
    lane: Lane, states: States, rates: States, time: Instants, decided: DecisionState
) -> PerAxis:
    """The drive `z = y‴ + P(ŷ)` of vehicles whose states change at these rates."""
    own, (*_, jerk) = vehicles.output_rates(lane, states, rates, time)
    return decided.sensed.drive(lane.gain, jerk, own)
