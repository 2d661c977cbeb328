"""Vehicles with a digital controller: at a tick it takes the law's inputs, and holds them.

    at a tick    u = u(x, t), by the law from what the vehicle senses and hears
    between      ẋ = f(x, u), u constant: one step of Euler's method, or exactly

Nothing that happens between ticks reaches the controller. The lanes are the last axis of every
array.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from jaxnet.engine import stepper, vehicles
from jaxnet.engine.demand import Signals, signals
from jaxnet.engine.following import Followed, Following, Scene
from jaxnet.engine.integration import drive_along
from jaxnet.engine.loop import InStates
from jaxnet.engine.moment import Instants, LaneFlags, PerAxis
from jaxnet.engine.plan import Tolerances
from jaxnet.engine.stages import stopping
from jaxnet.engine.stages.coasting import rests_on_the_way
from jaxnet.engine.stages.stopping import Rest
from jaxnet.engine.status import LEAST_MARGIN, Status, fail
from jaxnet.engine.subset import run_if, select
from jaxnet.engine.tick import DecisionState
from jaxnet.engine.vehicles import States

MOST_TRIES = 1_000  # of a lane's motion over a period
EXACT = 1e-13  # tolerance of a step, absolute and relative, of the exact motion over a period


class SamplingState(NamedTuple):
    """State of the lanes at a tick."""

    states: States
    signals: Signals
    asked: PerAxis  # inputs that the law asks for until the next tick
    drive: PerAxis  # z at the last tick, where the law is solved
    steps: Int[Array, " lanes"]  # of the motion over periods, refused ones included
    followed: Followed
    rest: Rest | None  # None where vehicles do not stop


class Sampling(InStates, Following[SamplingState]):
    """Motion of vehicles with held inputs, which is that of the option `move`."""

    @property
    def acts(self):
        return True

    def begin(self):
        lane, zero = self.lane, jnp.zeros_like(self.lane.attack_scale)
        return SamplingState(
            states=vehicles.first_states(lane),
            signals=signals(lane, zero),
            asked=jnp.zeros_like(lane.initial[:2]),
            drive=jnp.zeros_like(lane.initial[:2]),
            steps=jnp.zeros(zero.shape, int),
            followed=self.nothing_followed(),
            rest=stopping.first_rest(lane, rests_on_the_way(lane, self.plan)),
        )

    def asked(self, state, decided):
        return state.asked

    def drive_now(self, state, decided):
        """`y^(r) + P(ŷ)`: of the tick, if the law is solved; with y^(r) = q, if the law holds q."""
        if self.lane.law.solves():
            return state.drive
        if self.lane.law.needs_ticks():
            return self.held_drive(state, decided)
        return self.drive_of(state, decided)

    def drive_of(self, state: SamplingState, decided: DecisionState) -> PerAxis:
        rates = vehicles.rates(self.lane, state.states, state.asked, state.signals.time)
        return drive_along(self.lane, state.states, rates, state.signals.time, decided)

    def hold(self, state, decided, at):
        """Take the law's inputs in all lanes; factorise the Laplacian where a weight changed."""
        flagged = at.here if self.lane.law.needs_ticks() else at.anew
        followed, cut_off = self.follow_anew(flagged, state, decided, lambda: state.states)
        scene = Scene(self.lane, self.network, decided, state.signals)
        asked = followed.inputs(scene, state.states)
        state = state._replace(asked=asked, followed=followed)
        if self.lane.law.solves():
            state = state._replace(drive=self.drive_of(state, decided))
        return state, cut_off

    def advance(self, state, decided, ticks, status):
        """The state at the next tick; vehicles that have stopped stay where they are."""
        lane, begin, ok = self.lane, state.signals.time, status == Status.ok
        end = jnp.broadcast_to(self.clock.at(jnp.asarray(ticks + 1)), begin.shape)
        frozen, may_stop = decided.coasting.frozen(lane), decided.coasting.may_stop(lane)

        def after(share: Any) -> tuple[States, Int[Array, " lanes"], LaneFlags]:
            """The states after shares of the period, of each vehicle, 1 by default."""

            def rates(time: Instants, states: States) -> States:
                moved = vehicles.rates(lane, states, state.asked, time)
                return jnp.where(frozen[None], 0.0, moved if share is None else share[None] * moved)

            if self.plan.options == ("euler",):
                moved = (end - begin)[None, None] * rates(begin, state.states)
                return state.states + moved, ok.astype(int), jnp.zeros_like(ok)
            return solved(rates, begin, end, state.states, ok)

        states, steps, stuck = after(None)
        steps, rest = state.steps + steps, state.rest
        if rest is not None:
            which = ok[None] & may_stop & ~frozen
            which = which & (vehicles.ahead(lane, states) < LEAST_MARGIN)

            def stop(_: Rest) -> Rest:
                given = lane, state.states, states, which
                return stopping.rest_on_the_way(*given, lambda share: after(share)[0])

            rest = rest.plus(run_if(which.any(), stop, rest._replace(which=which)))
        status = fail(status, Status.nonfinite, ok & ~jnp.isfinite(states).all(axis=(0, 1)))
        status = fail(status, Status.max_steps, stuck)
        if lane.singular:
            passed = vehicles.passed_singular(lane, states, may_stop)
            status = fail(status, Status.singular, passed.any(axis=0))
        now = signals(lane, end)
        state = state._replace(states=states, signals=now, steps=steps, rest=rest)
        return state, status, jnp.ones_like(ok)


def solved(
    rates: Callable[[Instants, States], States],
    begin: Instants,
    end: Instants,
    states: States,
    among: LaneFlags,
) -> tuple[States, Int[Array, " lanes"], LaneFlags]:
    """The states at the end by adaptive steps, their numbers, and the lanes, among some, stuck."""
    rule, tolerance = stepper.method("dopri8"), jnp.full_like(begin, EXACT)
    tolerances = Tolerances(tolerance, tolerance, 0)

    def under_way(carry: Any) -> LaneFlags:
        time, _, _, number = carry
        return among & (time < end) & (number < MOST_TRIES)

    def one(carry: Any) -> Any:
        time, states, step, number = carry
        goal, slope = stepper.towards(end, time, step), rates(time, states)
        given = rule, time, goal, states, slope, tolerances
        trial = stepper.attempt(rates, lambda instant: instant, *given)
        kept = trial.error < 1.0
        new = (
            jnp.where(kept, goal, time),
            jnp.where(kept[None, None], trial.state, states),
            stepper.next_step(goal - time, trial.error, rule.order),
            number + 1,
        )
        return select(under_way(carry), new, carry)

    carry = begin, states, end - begin, jnp.zeros(begin.shape, int)
    time, states, _, number = jax.lax.while_loop(lambda c: under_way(c).any(), one, carry)
    return states, number, among & (time < end)
