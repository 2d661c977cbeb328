"""The exact engine: lanes move from tick to tick by `x(t + h) = Φ x(t) + Σ_b v_b f_b`, no integrator.

The law solved at every instant (`Solved`, theorems.md O2, O2b): x is E = y - y_0 with its derivatives below
the order r of the vehicles, and `Φ = expm(A_c h)`. The attacks' effect on the fleet is `G = L⁻¹ d`: vectors
v = L⁻¹ d times functions of time.

    E(t + h) = Φ E(t) + G(t + h) - Φ G(t).

The vectors change only where weights or attacks change. The engine then solves for new vectors, and E does
not jump. The functions of G are g = β, the attacks' functions. Where the falsified jets are no path with its
derivatives, g solves `R(g) = R(β)`, summed from tick to tick by Gauss–Legendre quadrature.

What vehicles know at a tick drives them by powers σ^k / k! of the share σ of the tick that has passed
(O15, O16). Their f are responses from rest (`flow.power_responses`), in which nothing cancels.

The r-th derivative held from tick to tick (`Held`, theorems.md O12): x is y with its derivatives, Φ is the
flow of r integrators, v is the r-th derivative, and f = (h^r/r!, …, h), for r = 3 (h³/6, h²/2, h).

The local law at every instant stands in `local`.

The lanes are the last axis of every array. Functions of one instant are computed behind a barrier, because
XLA would compute them again for each vehicle that uses them (1.08 times, plain, 12 vehicles).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.lax import optimization_barrier as barrier
from jaxtyping import Array, Float

from jaxnet.engine import between, inner, response, standstill, tick
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
from jaxnet.engine.loop import Batch, LaneFlags, Motion, PerVehicle, Tick, Ticks
from jaxnet.engine.status import Code, Status, fail
from jaxnet.engine.stepper import States
from jaxnet.engine.subset import LaneIndices, picked, run_if
from jaxnet.engine.tick import DecisionState, Instants, VehicleFlags
from jaxnet.model import control, plane, signal
from jaxnet.model.plane import Jets, Plane
from jaxnet.model.signal import Basis, ByFunction, Vectors, WithNavigator


class PropagationState(NamedTuple):
    """State of lanes at a tick."""

    jets: Jets  # x
    response: ByFunction  # v, which act until the next tick
    time: Instants
    basis: Basis  # the attacks' functions β now
    effect: Effect | None  # g now, with two derivatives; None where g = β
    straight: LaneFlags  # lanes in which some vehicle may have gone straight on until now
    noise: Jets | None  # errors of the sensed jets until the next tick
    inner: Inner | None = (
        None  # what the outputs leave undetermined; None where they determine all states
    )
    since: Instants | None = (
        None  # of the last tick [s]; None where nothing known drives the vehicles
    )


class Propagation(Motion[PropagationState]):
    """Exact motion from tick to tick, the base of `Solved` and `Held`."""

    def basis(self, state: PropagationState) -> tuple[Instants, Basis]:
        """Return the time [s] and the attacks' functions now."""
        return state.time, state.basis[:, : self.lane.vectors.shape[2]]

    def forced(self, state: PropagationState) -> Vectors:
        """Return the vectors v until the next tick."""
        return signal.of_functions(state.response)

    def navigator(self, state: PropagationState) -> Float[Array, "derivatives 2 lanes"]:
        """Return the navigator's jets now."""
        return barrier(self.lane.path(state.time))

    def instant(self, ticks: Ticks | int) -> Instants:
        """Return the time of the tick with this number."""
        return jnp.broadcast_to(self.clock.at(jnp.asarray(ticks)), self.lane.attack_scale.shape)

    def states(self, state: PropagationState) -> States:
        """Return the vehicles' states (n, m, lanes)."""
        vehicle, own = self.lane.vehicle, self.outputs(state)
        return (
            vehicle.state_of(own)
            if state.inner is None
            else vehicle.state_with(own, state.inner.states)
        )

    def pace(
        self, state: PropagationState, decided: DecisionState
    ) -> tuple[PerVehicle, PerVehicle]:
        """Return speed [m/s] and turn rate [rad/s], (m, lanes), of the jets where these tell them."""
        if self.lane.vehicle.jets_tell_pace:
            return plane.pace(self.outputs(state))
        return super().pace(state, decided)

    def lead(self, state: PropagationState, decided: DecisionState) -> tuple[Plane, Plane]:
        """Return the vehicles' lead, which is 0 where they are singular, and its derivative."""
        return standstill.lead(self.lane.vehicle, self.all_jets(state, decided), decided.may_stop)

    def placed(
        self, state: PropagationState, vehicles: VehicleFlags, states: States
    ) -> PropagationState:
        """Put vehicles at rest with these states."""
        rest = self.lane.vehicle.output_jets(states)
        return state._replace(jets=plane.replaced(vehicles, rest, state.jets))

    def all_jets(self, state: PropagationState, decided: DecisionState) -> Jets:
        """Return y with its derivatives up to the order."""
        own = self.outputs(state)
        jerk = self.drive_now(state, decided) - control.feedback(
            self.lane.gain, tick.sensed(own, decided.noise)
        )
        return *own, jerk

    def outputs(self, state: PropagationState) -> Jets:
        """Return y with its derivatives below the order."""
        raise NotImplementedError

    def over_tick(
        self, state: PropagationState, time: Instants
    ) -> tuple[Transition, Effect, PropagationState]:
        """Return Φ, f, and the state with the functions at the next tick, whose time is `time` [s].

        x in the state is what Φ acts on.
        """
        raise NotImplementedError

    def later(
        self, state: PropagationState, decided: DecisionState, span: Instants, since: Instants
    ) -> PropagationState:
        """Return the state a span [s] later, at most `longest`, in the tick that began at `since` [s]."""
        raise NotImplementedError

    @property
    def longest(self) -> Instants:
        """Return the longest span [s] of `later`."""
        return longest(self.lane.gain)

    def stood(
        self, state: PropagationState, apart: VehicleFlags | None, few: LaneIndices
    ) -> LaneFlags:
        """Return the lanes, of a few, in which a vehicle not `apart` stood still in the last tick."""
        raise NotImplementedError

    def with_inner(
        self, before: PropagationState, decided: DecisionState, now: PropagationState, status: Code
    ) -> tuple[PropagationState, Code]:
        """Return the state now, with what the outputs leave undetermined, from the state at the last tick."""
        if before.inner is None:
            return now, status
        span = now.time - before.time
        found, stuck = inner.carried(self, before, decided, span, status == Status.ok)
        return now._replace(inner=found), fail(status, Status.max_steps, stuck)

    def moved(
        self, state: PropagationState, flow: Transition, forcing: Effect, now: PropagationState
    ) -> PropagationState:
        """Return the state that follows from Φ, f and the state with later functions (`over_tick`)."""
        moved = signal.jets(self.forced(state), forcing)
        return now._replace(jets=plane.plus(propagate(flow, now.jets), moved))

    def advance(
        self, state: PropagationState, decided: DecisionState, ticks: Ticks, status: Code
    ) -> tuple[PropagationState, Code, LaneFlags]:
        """Return the state at the next tick; lanes are singular where a vehicle stands still on the way."""
        now = self.moved(state, *self.over_tick(state, self.instant(ticks + 1)))
        now, status = self.with_inner(state, decided, now, status)
        if not self.lane.vehicle.singular:
            return now, status, jnp.ones_like(now.straight)

        def stood(few: LaneIndices) -> LaneFlags:
            return self.stood(now, decided.may_stop, few)

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
        silent = lane.lossy or tick.coasts(lane)
        # Polynomials of late words have the navigator's path in them.
        leads = silent and lane.delay is None
        if leads:
            path = WithNavigator(lane.signal, lane.navigator, lane.gain)
            self.driven = lane._replace(signal=path)
        attacks, powers = lane.vectors.shape[2], tick.degrees(lane, batch.plan)
        if silent or lane.sensor is not None or not lane.exact_words:
            powers = max(1, powers)
        idle = 0 if lane.delay is None else attacks
        self.parts = between.Parts(idle, attacks - idle, leads, powers)
        self.pushed = None
        if powers:
            self.pushed = power_responses(lane.gain, self.clock.interval, powers)

    def begin(self) -> PropagationState:
        """Return the state at t = 0; the attacks have no effect on the fleet yet."""
        lane, time = self.lane, self.instant(0)
        basis, attack = self.driven.basis(time), lane.vectors.shape[2]
        jets = lane.vehicle.output_jets(lane.initial)
        return PropagationState(
            jets=plane.relative(jets, lane.path(time)),
            response=jnp.zeros(
                (self.parts.functions + self.parts.powers, 2, *lane.weights.shape[1:])
            ),
            time=time,
            basis=basis,
            effect=None if self.plan.consistent else basis[: len(jets)].at[:, :attack].set(0.0),
            straight=jnp.ones(time.shape, bool),
            noise=tick.sense(lane, (jnp.zeros_like(lane.initial[:2]),) * 3, time),
            inner=inner.inner_at_start(lane, self.clock.interval),
            since=time if self.parts.powers else None,
        )

    def errors(self, state: PropagationState) -> Jets:
        """Return E and its derivatives below the order now."""
        return state.jets

    def outputs(self, state: PropagationState) -> Jets:
        """Return y with its derivatives below the order."""
        return plane.plus(state.jets, [jet[:, None] for jet in self.navigator(state)])

    def placed(
        self, state: PropagationState, vehicles: VehicleFlags, states: States
    ) -> PropagationState:
        """Put vehicles at rest with these states."""
        rest = plane.relative(self.lane.vehicle.output_jets(states), self.navigator(state))
        return state._replace(jets=plane.replaced(vehicles, rest, state.jets))

    def hold(
        self, state: PropagationState, decided: DecisionState, at: Tick
    ) -> tuple[PropagationState, LaneFlags]:
        """Solve `L v = d` in lanes whose decisions changed.

        In a large fleet the solution is updated only near the changed vehicles, where that suffices.
        """
        lane, network, plan = self.lane, self.network, self.plan
        changed = (at.vehicles | at.first[None]) if plan.choosing else jnp.ones_like(at.vehicles)

        def solve(carry: tuple[ByFunction, LaneFlags]) -> tuple[ByFunction, LaneFlags]:
            last, cut_off = carry
            return response.solve_response(
                last, cut_off, at.anew, changed, decided, lane, network, plan
            )

        carry = state.response, jnp.zeros_like(at.anew)
        solved, cut_off = (
            solve(carry) if decided.late is not None else run_if(at.anew.any(), solve, carry)
        )
        state = state._replace(response=solved, noise=decided.noise)
        return state if state.since is None else state._replace(since=state.time), cut_off

    def forced(self, state: PropagationState) -> Vectors:
        """Return the vectors v until the next tick, with those of the sensor's errors: `-P(n)`."""
        if state.noise is None:
            return super().forced(state)
        error = control.feedback(self.lane.gain, state.noise)
        return signal.of_functions(state.response.at[self.parts.functions].add(-error))

    def drive_now(
        self, state: PropagationState, decided: DecisionState
    ) -> Float[Array, "2 m lanes"]:
        """Return `R(y_0) + Σ_b v_b R(β_b)`, in which the sensor's errors cancel."""
        gain = self.lane.gain
        path, functions = (
            control.driven(gain, self.navigator(state)),
            control.drive_functions(gain, state.basis[:, self.parts.idle :]),
        )
        if state.since is not None:
            passed = (state.time - state.since) / self.clock.interval
            functions = jnp.concatenate([functions, signal.powers_of(passed, self.parts.powers)])
        return path[:, None] + signal.combined(
            control.drive_vectors(gain, super().forced(state)), functions
        )

    def over_tick(
        self, state: PropagationState, time: Instants
    ) -> tuple[Transition, Effect, PropagationState]:
        """Return Φ, f, and the state with the functions at the next tick, whose time is `time` [s]."""
        return self.over(
            state, time, self.clock.interval, self.numbers.flow, self.responses, self.pushed
        )

    def later(
        self, state: PropagationState, decided: DecisionState, span: Instants, since: Instants
    ) -> PropagationState:
        """Return the state a span [s] later, at most `longest`, in the tick that began at `since` [s]."""
        gain, time = self.lane.gain, state.time + span
        responses = None if state.effect is None else brief_responses(gain, span)
        flow, pushed = brief(gain, span), None
        if self.pushed is not None:
            shares = ((each / self.clock.interval) for each in (state.time - since, span))
            pushed = power_responses(gain, span, self.parts.powers, *shares)
        return self.moved(state, *self.over(state, time, span, flow, responses, pushed))

    def over(
        self,
        state: PropagationState,
        time: Instants,
        span: Float[Array, "*some"],
        flow: Transition,
        responses: Responses | None,
        pushed: Float[Array, "r powers lanes"] | None,
    ) -> tuple[Transition, Effect, PropagationState]:
        """Return Φ, f, and the state with the functions at a time, which is a span [s] later.

        `pushed` is the part of f that belongs to powers of time, None where there are none.
        """
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
            return flow, now[: len(flow)], there._replace(jets=free)
        forcing = barrier(now[: len(flow)] - jnp.stack(propagate(flow, before)))
        if pushed is not None:
            forcing = jnp.concatenate([forcing, pushed], axis=1)
        return flow, forcing, there

    def stood(
        self, state: PropagationState, apart: VehicleFlags | None, few: LaneIndices
    ) -> LaneFlags:
        """Return the lanes, of a few, in which a vehicle not `apart` stood still in the last tick."""
        effect = state.basis[: len(state.jets)] if state.effect is None else state.effect
        given = (
            state.jets,
            self.forced(state),
            effect,
            self.driven,
            self.numbers.reach,
            state.time,
            apart,
        )
        some = jax.tree.map(lambda leaf: picked(leaf, few), given)
        return between.stood(*some, parts=self.parts, interval=self.clock.interval, plan=self.plan)


class Held(Propagation):
    """Exact motion with a jerk that vehicles exchange at each tick and hold until the next."""

    def begin(self) -> PropagationState:
        """Return the state at t = 0; no jerk is held yet."""
        lane, time = self.lane, self.instant(0)
        jets = lane.vehicle.output_jets(lane.initial)
        held = jnp.zeros_like(jets[0])[None]
        straight, basis = jnp.ones(time.shape, bool), lane.basis(time)
        within = inner.inner_at_start(lane, self.clock.interval)
        return PropagationState(jets, held, time, basis, None, straight, None, within)

    def errors(self, state: PropagationState) -> Jets:
        """Return E and its derivatives below the order now."""
        return plane.relative(state.jets, self.navigator(state))

    def outputs(self, state: PropagationState) -> Jets:
        """Return y with its derivatives below the order."""
        return state.jets

    def hold(
        self, state: PropagationState, decided: DecisionState, at: Tick
    ) -> tuple[PropagationState, LaneFlags]:
        """Exchange the jerk in all lanes. Return the state with it, and the lanes with a vehicle cut off."""
        lane, network, plan = self.lane, self.network, self.plan
        drive = tick.drive(lane, decided, plan)
        path, basis = self.navigator(state), state.basis
        leading, functions = barrier(
            (control.driven(lane.gain, path), control.drive_functions(lane.gain, basis))
        )
        told = tick.Told(path, basis, leading, functions, state.time)
        jerk = tick.exchange(lane, network, drive, state.jets, told, state.response[0])
        cut_off = run_if(
            at.first.any() | plan.decides,
            lambda _: tick.disconnected(lane, network, decided, plan),
            jnp.zeros_like(at.here),
        )
        return state._replace(response=jerk[None]), cut_off

    def drive_now(
        self, state: PropagationState, decided: DecisionState
    ) -> Float[Array, "2 m lanes"]:
        """Return `y‴ + P(ŷ)`."""
        own = tick.sensed(state.jets, decided.noise)
        return state.response[0] + control.feedback(self.lane.gain, own)

    def over_tick(
        self, state: PropagationState, time: Instants
    ) -> tuple[Transition, Effect, PropagationState]:
        """Return Φ, f, and the state with the functions at the next tick, whose time is `time` [s]."""
        interval = jnp.broadcast_to(self.clock.interval, time.shape)
        return self.over(state, time, interval)

    def later(
        self, state: PropagationState, decided: DecisionState, span: Instants, since: Instants
    ) -> PropagationState:
        """Return the state a span [s] later, in the tick that began at `since` [s]."""
        return self.moved(state, *self.over(state, state.time + span, span))

    def over(
        self, state: PropagationState, time: Instants, span: Instants
    ) -> tuple[Transition, Effect, PropagationState]:
        """Return Φ, f, and the state with the functions at a time, which is a span [s] later."""
        basis = barrier(self.lane.basis(time))
        flow, forcing = (make(span, len(state.jets)) for make in (of_integrators, held_input))
        return flow, forcing, state._replace(time=time, basis=basis)

    def stood(
        self, state: PropagationState, apart: VehicleFlags | None, few: LaneIndices
    ) -> LaneFlags:
        """Return the lanes, of a few, in which a vehicle not `apart` stood still in the last tick."""
        given = self.lane.vehicle, state.jets, self.forced(state), apart
        some = jax.tree.map(lambda leaf: picked(leaf, few), given)
        return between.stood_held(*some, interval=self.clock.interval)
