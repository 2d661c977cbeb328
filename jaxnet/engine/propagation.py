"""Exact engine: lanes move from tick to tick by `x(t + h) = Φ x(t) + Σ_b v_b f_b`, no integrator.

The law solved at every instant (`Solved`, theorems.md O2, O2b): x is E = y - y_0 with its
derivatives below the order r of the vehicles, and `Φ = expm(A_c h)`. The attacks' effect on the
fleet is `G = L⁻¹ d`: vectors v = L⁻¹ d times functions of time.

    E(t + h) = Φ E(t) + G(t + h) - Φ G(t).

The vectors change only where weights or attacks change. The engine then solves for new vectors, and
E does not jump. The functions of G are g = β, the attacks' functions. Where the falsified jets are
no path with its derivatives, g solves `R(g) = R(β)`, summed from tick to tick by Gauss–Legendre
quadrature.

What vehicles know at a tick drives them by powers σ^k / k! of the share σ of the tick that has
passed (O15, O16). Their f are responses from rest (`flow.power_responses`), in which nothing
cancels.

The r-th derivative held from tick to tick (`Held`, theorems.md O12): x is y with its derivatives, Φ
is the flow of r integrators, v is the r-th derivative, and f = (h^r/r!, …, h), for r = 3 (h³/6,
h²/2, h).

The local law at every instant stands in `local`.

The lanes are the last axis of every array. Functions of one instant are computed behind a barrier,
because XLA would compute them again for each vehicle that uses them (1.08 times, plain, 12
vehicles).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.lax import optimization_barrier as barrier
from jaxtyping import Array, Float

from jaxnet.engine import between, inner, response, standstill, vehicles
from jaxnet.engine.demand import exchange, signals
from jaxnet.engine.flow import (
    Effect,
    Responses,
    Transition,
    brief,
    brief_responses,
    held_input,
    impulse_responses,
    longest,
    of_integrators,
    passed_on,
    power_responses,
    propagate,
)
from jaxnet.engine.inner import Inner
from jaxnet.engine.loop import Batch, Motion, Tick, Ticks
from jaxnet.engine.moment import Instants, LaneFlags, VehicleFlags
from jaxnet.engine.stages.channel import degrees
from jaxnet.engine.stages.coasting import coasts
from jaxnet.engine.stages.sensing import Sensed, first_sensed
from jaxnet.engine.status import Code, Status, fail
from jaxnet.engine.subset import LaneIndices, picked, run_if
from jaxnet.engine.tick import DecisionState
from jaxnet.engine.vehicles import PerVehicle, States
from jaxnet.model import control, plane, signal
from jaxnet.model.plane import Jets, Plane
from jaxnet.model.polynomial import powers_of
from jaxnet.model.signal import Basis, ByFunction, Vectors, WithNavigator


class PropagationState(NamedTuple):
    """State of lanes at a tick."""

    jets: Jets  # x
    response: ByFunction  # v, which act until the next tick
    time: Instants
    basis: Basis  # the attacks' functions β now
    effect: Effect | None  # g now, with two derivatives; None where g = β
    straight: LaneFlags  # lanes in which some vehicle may have gone straight on until now
    sensed: Sensed  # until the next tick
    inner: Inner | None = (
        None  # what the outputs leave undetermined; None where they determine all states
    )
    since: Instants | None = (
        None  # of the last tick [s]; None where nothing known drives the vehicles
    )


class Propagation(Motion[PropagationState]):
    """Exact motion from tick to tick, the base of `Solved` and `Held`."""

    def basis(self, state: PropagationState) -> tuple[Instants, Basis]:
        return state.time, state.basis[:, : self.lane.vectors.shape[2]]

    def forced(self, state: PropagationState) -> Vectors:
        """The vectors v until the next tick."""
        return signal.of_functions(state.response)

    def navigator(self, state: PropagationState) -> Float[Array, "derivatives 2 lanes"]:
        return barrier(self.lane.path(state.time))

    def instant(self, ticks: Ticks | int) -> Instants:
        return jnp.broadcast_to(self.clock.at(jnp.asarray(ticks)), self.lane.attack_scale.shape)

    def states(self, state: PropagationState) -> States:
        own = self.outputs(state)
        if state.inner is None:
            return vehicles.states_of(self.lane, own, state.time)
        return vehicles.states_of(self.lane, own, state.time, state.inner.states)

    def pace(
        self, state: PropagationState, decided: DecisionState
    ) -> tuple[PerVehicle, PerVehicle]:
        known = vehicles.pace_of_jets(self.lane, self.outputs(state))
        return super().pace(state, decided) if known is None else known

    def lead(self, state: PropagationState, decided: DecisionState) -> tuple[Plane, Plane]:
        """The vehicles' lead, which is 0 where they are singular, and its derivative."""
        apart = decided.coasting.may_stop(self.lane)
        return standstill.lead(self.lane.vehicle, self.all_jets(state, decided), apart)

    def placed(
        self, state: PropagationState, which: VehicleFlags, states: States
    ) -> PropagationState:
        rest = vehicles.outputs(self.lane, states, state.time)
        return state._replace(jets=plane.replaced(which, rest, state.jets))

    def all_jets(self, state: PropagationState, decided: DecisionState) -> Jets:
        own = self.outputs(state)
        return *own, decided.sensed.jerk(self.lane.gain, self.drive_now(state, decided), own)

    def outputs(self, state: PropagationState) -> Jets:
        raise NotImplementedError

    def next(
        self, state: PropagationState, decided: DecisionState, time: Instants
    ) -> PropagationState:
        """The state at the next tick, whose time is `time` [s]."""
        raise NotImplementedError

    def later(
        self, state: PropagationState, decided: DecisionState, span: Instants, since: Instants
    ) -> PropagationState:
        raise NotImplementedError

    @property
    def longest(self) -> Instants:
        """The longest span [s] of `later`."""
        return longest(self.lane.gain)

    def stood(
        self,
        before: PropagationState,
        now: PropagationState,
        decided: DecisionState,
        few: LaneIndices,
    ) -> LaneFlags:
        """Lanes, of a few, in which a vehicle that may not stop stood still in the last tick."""
        raise NotImplementedError

    def with_inner(
        self, before: PropagationState, decided: DecisionState, now: PropagationState, status: Code
    ) -> tuple[PropagationState, Code]:
        """The state now, with the states that outputs leave undetermined, from the last tick's."""
        if before.inner is None:
            return now, status
        span = now.time - before.time
        found, stuck = inner.carried(self, before, decided, span, status == Status.ok)
        return now._replace(inner=found), fail(status, Status.max_steps, stuck)

    def moved(
        self, state: PropagationState, flow: Transition, forcing: Effect, now: PropagationState
    ) -> PropagationState:
        """The state that follows from Φ, f and the state with later functions."""
        moved = signal.jets(self.forced(state), forcing)
        return now._replace(jets=plane.plus(propagate(flow, now.jets), moved))

    def advance(
        self, state: PropagationState, decided: DecisionState, ticks: Ticks, status: Code
    ) -> tuple[PropagationState, Code, LaneFlags]:
        """State at the next tick; lanes are singular where a vehicle stands still on the way."""
        now = self.next(state, decided, self.instant(ticks + 1))
        now, status = self.with_inner(state, decided, now, status)
        if not self.lane.vehicle.singular:
            return now, status, jnp.ones_like(now.straight)

        def stood(few: LaneIndices) -> LaneFlags:
            return self.stood(state, now, decided, few)

        status, straight = between.stopped(
            now.straight, status, lambda: self.lead(now, decided), stood
        )
        return now._replace(straight=straight), status, jnp.ones_like(straight)


class Solved(Propagation):
    """The law solved for all vehicles at every instant."""

    def __init__(self, batch: Batch):
        super().__init__(batch)
        lane, consistent = self.lane, batch.plan.consistent
        self.responses = None if consistent else impulse_responses(lane.gain, self.clock.interval)
        # The lanes with all functions that drive them.
        self.driven = lane
        silent = lane.lossy or coasts(lane)
        # Polynomials of late words have the navigator's path in them.
        leads = silent and lane.delay is None
        if leads:
            path = WithNavigator(lane.signal, lane.navigator, lane.gain)
            self.driven = lane._replace(signal=path)
        attacks, powers = lane.vectors.shape[2], degrees(lane, batch.plan)
        if silent or lane.sensor is not None or not lane.exact_words:
            powers = max(1, powers)
        idle = 0 if lane.delay is None else attacks
        self.parts = between.Parts(idle, attacks - idle, leads, powers)
        self.pushed = None
        if powers:
            self.pushed = power_responses(lane.gain, self.clock.interval, powers)

    def begin(self) -> PropagationState:
        lane, time = self.lane, self.instant(0)
        basis, attack = self.driven.basis(time), lane.vectors.shape[2]
        jets = vehicles.outputs(lane, lane.initial, time)
        return PropagationState(
            jets=plane.relative(jets, lane.path(time)),
            response=jnp.zeros(
                (self.parts.functions + self.parts.powers, 2, *lane.weights.shape[1:])
            ),
            time=time,
            basis=basis,
            effect=None if self.plan.consistent else basis[: len(jets)].at[:, :attack].set(0.0),
            straight=jnp.ones(time.shape, bool),
            sensed=first_sensed(lane),
            inner=inner.inner_at_start(lane, self.clock.interval),
            since=time if self.parts.powers else None,
        )

    def errors(self, state: PropagationState) -> Jets:
        return state.jets

    def outputs(self, state: PropagationState) -> Jets:
        return plane.plus(state.jets, [jet[:, None] for jet in self.navigator(state)])

    def placed(
        self, state: PropagationState, which: VehicleFlags, states: States
    ) -> PropagationState:
        own = vehicles.outputs(self.lane, states, state.time)
        rest = plane.relative(own, self.navigator(state))
        return state._replace(jets=plane.replaced(which, rest, state.jets))

    def hold(
        self, state: PropagationState, decided: DecisionState, at: Tick
    ) -> tuple[PropagationState, LaneFlags]:
        """Solve `L v = d` in lanes whose decisions changed.

        In a large fleet it is updated only near the changed vehicles, where that suffices.
        """
        lane, network = self.lane, self.network
        changed = (
            (at.vehicles | at.first[None]) if self.plan.choosing else jnp.ones_like(at.vehicles)
        )

        def solve(carry: tuple[ByFunction, LaneFlags]) -> tuple[ByFunction, LaneFlags]:
            last, cut_off = carry
            return response.solve_response(last, cut_off, at.anew, changed, decided, lane, network)

        carry = state.response, jnp.zeros_like(at.anew)
        solved, cut_off = (
            solve(carry) if decided.late.present else run_if(at.anew.any(), solve, carry)
        )
        state = state._replace(response=solved, sensed=decided.sensed)
        return state if state.since is None else state._replace(since=state.time), cut_off

    def forced(self, state: PropagationState) -> Vectors:
        """The vectors v until the next tick, with those of the sensor's errors: `-P(n)`."""
        gain, place = self.lane.gain, self.parts.functions
        return signal.of_functions(state.sensed.pushed(gain, state.response, place))

    def drive_now(
        self, state: PropagationState, decided: DecisionState
    ) -> Float[Array, "2 m lanes"]:
        """`R(y_0) + Σ_b v_b R(β_b)`, in which the sensor's errors cancel."""
        gain = self.lane.gain
        path, functions = (
            control.driven(gain, self.navigator(state)),
            control.drive_functions(gain, state.basis[:, self.parts.idle :]),
        )
        if state.since is not None:
            passed = (state.time - state.since) / self.clock.interval
            functions = jnp.concatenate([functions, powers_of(passed, self.parts.powers)])
        return path[:, None] + signal.combined(
            control.drive_vectors(gain, super().forced(state)), functions
        )

    def next(
        self, state: PropagationState, decided: DecisionState, time: Instants
    ) -> PropagationState:
        interval, flow = self.clock.interval, self.numbers.flow
        return self.after(state, time, interval, flow, self.responses, self.pushed)

    def later(
        self, state: PropagationState, decided: DecisionState, span: Instants, since: Instants
    ) -> PropagationState:
        gain, time = self.lane.gain, state.time + span
        responses = None if state.effect is None else brief_responses(gain, span)
        flow, pushed = brief(gain, span), None
        if self.pushed is not None:
            shares = ((each / self.clock.interval) for each in (state.time - since, span))
            pushed = power_responses(gain, span, self.parts.powers, *shares)
        return self.after(state, time, span, flow, responses, pushed)

    def after(
        self,
        state: PropagationState,
        time: Instants,
        span: Float[Array, "*some"],
        flow: Transition,
        responses: Responses | None,
        pushed: Float[Array, "r powers lanes"] | None,
    ) -> PropagationState:
        """The state a span [s] later; `pushed` is the part of f that belongs to powers of time."""
        basis = barrier(self.driven.basis(time))
        before, effect = state.basis, None
        if state.effect is not None and responses is not None:
            before = state.effect
            effect = barrier(passed_on(before, flow, responses, self.driven, state.time, span))
        now = basis if effect is None else effect
        before, now = before[:, self.parts.idle :], now[:, self.parts.idle :]
        there = state._replace(time=time, basis=basis, effect=effect)
        if control.is_matrix(self.lane.gain):  # Φ does not act on functions alone
            forced = signal.jets(self.forced(state), before)
            free = tuple(a - b for a, b in zip(state.jets, forced, strict=False))
            return self.moved(state, flow, now[: len(flow)], there._replace(jets=free))
        forcing = barrier(now[: len(flow)] - jnp.stack(propagate(flow, before)))
        if pushed is not None:
            forcing = jnp.concatenate([forcing, pushed], axis=1)
        return self.moved(state, flow, forcing, there)

    def stood(
        self,
        before: PropagationState,
        now: PropagationState,
        decided: DecisionState,
        few: LaneIndices,
    ) -> LaneFlags:
        effect = now.basis[: len(now.jets)] if now.effect is None else now.effect
        forced, apart = self.forced(now), decided.coasting.may_stop(self.lane)
        given = now.jets, forced, effect, self.driven, self.numbers.reach, now.time, apart
        some = jax.tree.map(lambda leaf: picked(leaf, few), given)
        return between.stood(*some, parts=self.parts, interval=self.clock.interval, plan=self.plan)


class Held(Propagation):
    """Exact motion with a jerk that vehicles exchange at each tick and hold until the next."""

    def begin(self) -> PropagationState:
        lane, time = self.lane, self.instant(0)
        jets = vehicles.outputs(lane, lane.initial, time)
        held = jnp.zeros_like(jets[0])[None]
        straight, basis = jnp.ones(time.shape, bool), lane.basis(time)
        within = inner.inner_at_start(lane, self.clock.interval)
        return PropagationState(jets, held, time, basis, None, straight, Sensed(), within)

    def errors(self, state: PropagationState) -> Jets:
        return plane.relative(state.jets, self.navigator(state))

    def outputs(self, state: PropagationState) -> Jets:
        return state.jets

    def hold(
        self, state: PropagationState, decided: DecisionState, at: Tick
    ) -> tuple[PropagationState, LaneFlags]:
        """Exchange the jerk in all lanes. Return the state, and lanes with a vehicle cut off."""
        lane, network = self.lane, self.network
        now = barrier(signals(lane, state.time))
        jerk = exchange(lane, network, decided.drive(lane), state.jets, now, state.response[0])
        cut_off = run_if(
            at.first.any() | self.plan.decides,
            lambda _: decided.disconnected(lane, network),
            jnp.zeros_like(at.here),
        )
        return state._replace(response=jerk[None]), cut_off

    def drive_now(
        self, state: PropagationState, decided: DecisionState
    ) -> Float[Array, "2 m lanes"]:
        """`y‴ + P(ŷ)`."""
        own = decided.sensed.of(state.jets)
        return state.response[0] + control.feedback(self.lane.gain, own)

    def next(
        self, state: PropagationState, decided: DecisionState, time: Instants
    ) -> PropagationState:
        return self.after(state, time, jnp.broadcast_to(self.clock.interval, time.shape))

    def later(
        self, state: PropagationState, decided: DecisionState, span: Instants, since: Instants
    ) -> PropagationState:
        return self.after(state, state.time + span, span)

    def after(self, state: PropagationState, time: Instants, span: Instants) -> PropagationState:
        basis = barrier(self.lane.basis(time))
        flow, forcing = (make(span, len(state.jets)) for make in (of_integrators, held_input))
        return self.moved(state, flow, forcing, state._replace(time=time, basis=basis))

    def stood(
        self,
        before: PropagationState,
        now: PropagationState,
        decided: DecisionState,
        few: LaneIndices,
    ) -> LaneFlags:
        apart = decided.coasting.may_stop(self.lane)
        given = self.lane.vehicle, now.jets, self.forced(now), apart
        some = jax.tree.map(lambda leaf: picked(leaf, few), given)
        return between.stood_held(*some, interval=self.clock.interval)
