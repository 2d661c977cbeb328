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
passed (O15, O16). Their f are responses from rest (`engine.flow`).

The r-th derivative held from tick to tick (`Held`, theorems.md O12): x is y with its derivatives,
the gains of Φ are 0, and v is the r-th derivative, which drives by σ^0.

The local law at every instant stands in `local`.

The lanes are the last axis of every array. Functions of one instant are computed behind a barrier,
because XLA would compute them again for each vehicle that uses them (1.08 times, plain, 12
vehicles).
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.lax import optimization_barrier as barrier
from jaxtyping import Array, Float

from jaxnet.engine import flow, gauss, inner, response, standstill, vehicles
from jaxnet.engine.demand import exchange, signals
from jaxnet.engine.flow import Span, propagate, span_of
from jaxnet.engine.inner import Inner
from jaxnet.engine.loop import Batch, Motion, Ticks
from jaxnet.engine.moment import Instants, LaneFlags, PerAxis
from jaxnet.engine.stages import stopping
from jaxnet.engine.stages.channel import degrees
from jaxnet.engine.stages.coasting import keeps_drives
from jaxnet.engine.stages.sensing import Sensed, first_sensed
from jaxnet.engine.stages.stopping import Rest
from jaxnet.engine.status import Code, Status, fail
from jaxnet.engine.subset import LaneIndices, for_each, picked, put, run_if
from jaxnet.engine.tick import DecisionState
from jaxnet.engine.vehicles import PerVehicle
from jaxnet.model import control, plane, signal, xla
from jaxnet.model.control import Gain
from jaxnet.model.plane import Jets, length
from jaxnet.model.polynomial import powers_of
from jaxnet.model.signal import Basis, ByFunction, Vectors

FEW = 16  # lanes in which vehicles that stand still are sought at once


class PropagationState(NamedTuple):
    """State of lanes at a tick, or at an instant between two."""

    jets: Jets  # x
    response: ByFunction  # v, which act until the next tick
    time: Instants
    basis: Basis  # the attacks' functions β now
    effect: Float[Array, "r functions lanes"] | None  # g and derivatives; None where g = β
    straight: LaneFlags  # lanes in which some vehicle may have gone straight on until now
    sensed: Sensed  # until the next tick
    inner: Inner | None  # what the outputs leave undetermined; None where they determine all states
    since: Instants  # of the last tick [s]
    rest: Rest | None  # None where vehicles do not stop


class Propagation(Motion[PropagationState]):
    """Exact motion from tick to tick. A subclass says what drives the vehicles."""

    gain: Gain  # of the flow
    leads = False  # whether the navigator's path, two functions, drives vehicles too
    idle: int  # the number of functions, the first ones, that drive nobody
    functions: int  # the number of functions that drive vehicles
    powers: int  # the number of powers of the share of a tick that drive vehicles

    def __init__(self, batch: Batch):
        super().__init__(batch)
        self.batch, self.integrates = batch, self.functions > 0 and not self.plan.consistent
        self.tick = self.over(self.clock.interval)

    def functions_at(self, time: Instants) -> Basis:
        """The attacks' functions, and the navigator's path, one function for each axis."""
        basis = self.lane.basis(time)
        return jnp.concatenate([basis, self.lane.path(time)], axis=1) if self.leads else basis

    def over(self, span: Any, begin: Any = 0.0, share: Any = 1.0) -> Span:
        return span_of(self.gain, span, self.powers, self.integrates, begin, share)

    def begin(self):
        lane, time = self.lane, self.instant(0)
        basis, attacks = self.functions_at(time), lane.vectors.shape[2]
        jets = self.of_outputs(time, vehicles.first_outputs(lane))
        effect = basis[: len(jets)].at[:, :attacks].set(0.0) if self.integrates else None
        return PropagationState(
            jets=jets,
            response=jnp.zeros((self.functions + self.powers, 2, *lane.weights.shape[1:])),
            time=time,
            basis=basis,
            effect=effect,
            straight=jnp.ones(time.shape, bool),
            sensed=Sensed(),
            inner=inner.inner_at_start(lane, self.clock.interval),
            since=time,
            rest=stopping.first_rest(lane),
        )

    def basis(self, state):
        return state.time, state.basis[:, : self.lane.vectors.shape[2]]

    def forced(self, state: PropagationState) -> Vectors:
        """The vectors v until the next tick."""
        return signal.of_functions(state.response)

    def navigator(self, state: PropagationState) -> Float[Array, "derivatives 2 lanes"]:
        return barrier(self.lane.path(state.time))

    def instant(self, ticks: Ticks | int) -> Instants:
        return jnp.broadcast_to(self.clock.at(jnp.asarray(ticks)), self.lane.attack_scale.shape)

    def states(self, state):
        within = None if state.inner is None else state.inner.states
        return vehicles.states_of(self.lane, self.outputs(state), state.time, within)

    def pace(self, state, decided):
        known = vehicles.pace_of_jets(self.lane, self.outputs(state), state.time)
        return super().pace(state, decided) if known is None else known

    def placed(self, state, which, states):
        there = vehicles.outputs(self.lane, states, state.time)
        own = plane.replaced(which, there, self.outputs(state))
        return state._replace(jets=self.of_outputs(state.time, own))

    def all_jets(self, state: PropagationState, decided: DecisionState) -> Jets:
        own = self.outputs(state)
        return *own, decided.sensed.jerk(self.lane.gain, self.drive_now(state, decided), own)

    def outputs(self, state: PropagationState) -> Jets:
        """The jets of the outputs, below the order."""
        return state.jets

    def of_outputs(self, time: Instants, own: Jets) -> Jets:
        """The jets x of the outputs' jets."""
        return own

    def next(
        self, state: PropagationState, decided: DecisionState, time: Instants
    ) -> PropagationState:
        """The state at the next tick, whose time is `time` [s]."""
        return self.after(state, time, self.tick)

    def later(
        self, state: PropagationState, decided: DecisionState, span: Instants, since: Instants
    ) -> PropagationState:
        """The state a span [s] later, or earlier, in the tick that began at `since` [s]."""
        begin, share = (each / self.clock.interval for each in (state.time - since, span))
        return self.after(state, state.time + span, self.over(span, begin, share))

    def highest(
        self, now: PropagationState, decided: DecisionState
    ) -> Callable[[PropagationState], PerVehicle]:
        """A bound on the norm of y^(r) over a step back of at most `longest` from a state."""
        raise NotImplementedError

    @property
    def longest(self) -> Instants:
        """The longest span [s] of `later`."""
        return flow.longest(self.lane.gain)

    def after(self, state: PropagationState, time: Instants, over: Span) -> PropagationState:
        """The state after a span."""
        basis = barrier(self.functions_at(time))
        before, now, effect = state.basis, basis, None
        if state.effect is not None and over.impulses is not None:
            before = state.effect
            effect = now = barrier(self.effect_after(state, over))
        before, now = before[:, self.idle :], now[: len(over.flow), self.idle :]
        there = state._replace(time=time, basis=basis, effect=effect)
        forced, jets = self.forced(state), state.jets
        if over.flow.ndim > 3:  # Φ does not act on functions alone
            free = zip(jets, signal.jets(forced, before), strict=False)
            jets, forcing = tuple(a - b for a, b in free), now
        else:
            forcing = xla.materialised(lambda: now - jnp.stack(propagate(over.flow, before)))
        forcing = jnp.concatenate([forcing, over.powers], axis=1)
        return there._replace(
            jets=plane.plus(propagate(over.flow, jets), signal.jets(forced, forcing))
        )

    def effect_after(
        self, state: PropagationState, over: Span
    ) -> Float[Array, "r functions lanes"]:
        """`x(t + h) = Φ x(t) + ∫ expm(A_c (h - s)) B R(β)(t + s) ds`, for g from now on.

        The quadrature is exact to rounding for functions that are smooth within the span.
        """
        assert over.impulses is not None
        total = jnp.stack(propagate(over.flow, state.effect))
        for node, share, answer in zip(flow.NODES, flow.SHARES, over.impulses, strict=True):
            basis = self.functions_at(state.time + node * over.length)
            by = control.driven(self.lane.gain, basis)
            total = total + (share * over.length)[None, None] * answer[:, None] * by[None]
        return total

    def advance(self, state, decided, ticks, status):
        """State at the next tick; lanes are singular where a vehicle stands still on the way.

        With probability 1, the velocity of a vehicle becomes 0 only if the vehicle has moved on a
        straight line since the start. Only lanes in which a vehicle may have done so are searched.
        """
        now = self.next(state, decided, self.instant(ticks + 1))
        if state.inner is not None:
            span = now.time - state.time
            within, stuck = inner.carried(self, state, decided, span, status == Status.ok)
            now, status = now._replace(inner=within), fail(status, Status.max_steps, stuck)
        everywhere = jnp.ones_like(now.straight)
        if now.rest is not None:
            rest = self.rested(state, now, decided, status == Status.ok)
            return now._replace(rest=rest), status, everywhere
        if not self.lane.vehicle.singular:
            return now, status, everywhere

        def some(few: LaneIndices, status: Code) -> Code:
            stood = self.stood(state, now, decided, few)
            return put(status, few, fail(picked(status, few), Status.singular, stood))

        def search(carry: tuple[Code, LaneFlags]) -> tuple[Code, LaneFlags]:
            status, straight = carry
            apart = decided.coasting.may_stop(self.lane)
            jets = vehicles.in_formation(self.lane, self.all_jets(now, decided), now.time)
            lead = standstill.lead(self.lane.vehicle, jets, apart)
            straight = straight & standstill.straight(*lead) & (status == Status.ok)
            return for_each(straight, FEW, some, status), straight

        status, straight = run_if(now.straight.any(), search, (status, now.straight))
        return now._replace(straight=straight), status, everywhere

    def stood(
        self,
        before: PropagationState,
        now: PropagationState,
        decided: DecisionState,
        few: LaneIndices,
    ) -> LaneFlags:
        """Lanes, of a few, in which a vehicle that may not stop stood still in the last tick.

        The search goes back from now.
        """
        given = self.batch.inputs, before.time, now, decided
        inputs, since, now, decided = jax.tree.map(lambda leaf: picked(leaf, few), given)
        some = type(self)(self.batch._replace(inputs=inputs))
        apart, highest = decided.coasting.may_stop(some.lane), some.highest(now, decided)

        def pace(state: PropagationState) -> standstill.Pace:
            own = vehicles.in_formation(some.lane, some.outputs(state), state.time)
            bound = vehicles.highest_in_formation(some.lane, highest(state))
            return standstill.backwards(some.lane.vehicle, own, bound, apart)

        def back(state: PropagationState, step: Instants) -> PropagationState:
            return some.later(state, decided, -step, since)

        return standstill.stands(pace, back, now, self.clock.interval, some.longest)[0]

    def rested(
        self, before: PropagationState, now: PropagationState, decided: DecisionState, ok: LaneFlags
    ) -> Rest:
        """Vehicles that have come to rest until now, in lanes that are ok."""
        lane, interval, vehicle = self.lane, self.clock.interval, self.lane.vehicle
        assert before.rest is not None
        own, bound = self.outputs(now), self.highest(now, decided)(now)
        nobody = jnp.zeros_like(before.rest.which)
        room = standstill.safe(*standstill.backwards(vehicle, own, bound, nobody))
        near = jnp.minimum(room, self.longest[None]) < interval
        near = near & ok[None] & ~(before.rest.which | decided.coasting.frozen(lane))

        def some(few: LaneIndices, rest: Rest) -> Rest:
            given = self.batch.inputs, before, decided, near
            inputs, begin, chosen, among = jax.tree.map(lambda leaf: picked(leaf, few), given)
            part = type(self)(self.batch._replace(inputs=inputs))
            span = jnp.broadcast_to(interval, begin.time.shape)

            def highest(share: Float[Array, ""]) -> PerAxis:
                there = part.later(begin, chosen, share * span, begin.time)
                return part.all_jets(there, chosen)[-1]

            jerks = jax.lax.map(highest, jnp.asarray(gauss.RULE.nodes))
            window = gauss.window_of(begin.time, span, part.outputs(begin), jerks)
            found = stopping.rest_in(part.lane, window, among)
            return jax.tree.map(lambda every, new: put(every, few, new), rest, found)

        nobody_new = before.rest._replace(which=nobody)
        return before.rest.plus(for_each(near.any(axis=0), FEW, some, nobody_new))


class Solved(Propagation):
    """The law solved for all vehicles at every instant.

    Functions of the attacks drive the vehicles and, where messages may be lost, the navigator's
    path, two functions. Where all messages are delayed, powers of the share of a tick alone do.
    """

    def __init__(self, batch: Batch):
        lane, silent = batch.lane, keeps_drives(batch.lane)
        self.powers = degrees(lane, batch.plan)
        if silent or lane.sensor is not None or not lane.exact_words:
            self.powers = max(1, self.powers)
        self.gain, self.leads = lane.gain, silent and lane.delay is None
        self.attacks = lane.vectors.shape[2] if lane.delay is None else 0
        self.idle = lane.vectors.shape[2] - self.attacks
        self.functions = self.attacks + 2 * self.leads
        super().__init__(batch)

    def begin(self):
        return super().begin()._replace(sensed=first_sensed(self.lane))

    def errors(self, state):
        return state.jets

    def outputs(self, state):
        return plane.plus(state.jets, [jet[:, None] for jet in self.navigator(state)])

    def of_outputs(self, time, own):
        return plane.relative(own, barrier(self.lane.path(time)))

    def hold(self, state, decided, at):
        """Solve `L v = d` in lanes whose decisions changed.

        In a large fleet it is updated only near the changed vehicles, where that suffices.
        """
        changed = jnp.ones_like(at.vehicles)
        if self.plan.choosing:
            changed = at.vehicles | at.first[None]

        def solve(carry: tuple[ByFunction, LaneFlags]) -> tuple[ByFunction, LaneFlags]:
            last, cut_off = carry
            return response.solve_response(
                last, cut_off, at.anew, changed, decided, self.lane, self.network
            )

        carry = state.response, jnp.zeros_like(at.anew)
        solved, cut_off = (
            solve(carry) if decided.late.present else run_if(at.anew.any(), solve, carry)
        )
        return state._replace(response=solved, sensed=decided.sensed, since=state.time), cut_off

    def forced(self, state):
        """The vectors v until the next tick, with those of the sensor's errors: `-P(n)`."""
        pushed = state.sensed.pushed(self.lane.gain, state.response, self.functions)
        return signal.of_functions(pushed)

    def drive_now(self, state, decided):
        """`R(y_0) + Σ_b v_b R(β_b)`, in which the sensor's errors cancel."""
        gain = self.lane.gain
        path = control.driven(gain, self.navigator(state))
        functions = control.drive_functions(gain, state.basis[:, self.idle :])
        if self.powers:
            passed = (state.time - state.since) / self.clock.interval
            functions = jnp.concatenate([functions, powers_of(passed, self.powers)])
        vectors = control.drive_vectors(gain, super().forced(state))
        return path[:, None] + signal.combined(vectors, functions)

    def highest(self, now, decided):
        """`y^(r) = y_0^(r) - P(E) + K R(β)`, from the greatest norms of path and functions."""
        lane, step = self.lane, jnp.minimum(self.longest, self.clock.interval)
        reach, norms = flow.backward_reach(lane.gain, step), control.norms(lane.gain)
        (path, functions), forced = lane.sizes, self.forced(now)
        parts = jnp.split(forced, (self.attacks, self.functions), axis=2)
        of_attacks, of_path = (jnp.sqrt((each**2).sum(axis=(0, 2))) for each in parts[:2])
        pull = of_attacks * control.driven(norms, functions)[None]
        pull = pull + of_path * control.driven(norms, path)[None]
        for k in range(self.powers):
            pull = pull + length(parts[2][:, :, k]) / math.factorial(k)
        pull = path[len(reach)][None] + pull * (1.0 + step * reach[-1])[None]

        def bound(state: PropagationState) -> PerVehicle:
            each = zip(reach, state.jets, strict=True)
            return pull + sum(by[None] * length(jet) for by, jet in each)

        return bound


class Held(Propagation):
    """Exact motion with a jerk that vehicles exchange at each tick and hold until the next."""

    def __init__(self, batch: Batch):
        lane = batch.lane
        self.gain = jnp.zeros((len(lane.gain), *lane.attack_scale.shape))
        self.idle, self.functions, self.powers = lane.vectors.shape[2], 0, 1
        super().__init__(batch)

    def errors(self, state):
        return plane.relative(state.jets, self.navigator(state))

    def hold(self, state, decided, at):
        """Exchange the jerk in all lanes. Return the state, and lanes with a vehicle cut off."""
        lane, network = self.lane, self.network
        now = barrier(signals(lane, state.time))
        jerk = exchange(lane, network, decided, state.jets, now, state.response[0])
        cut_off = run_if(
            at.first.any() | (self.plan.decides or lane.alarms_cut),
            lambda _: decided.disconnected(lane, network),
            jnp.zeros_like(at.here),
        )
        return state._replace(response=jerk[None]), cut_off

    def drive_now(self, state, decided):
        """`y‴ + P(ŷ)`."""
        return decided.sensed.drive(self.lane.gain, state.response[0], state.jets)

    def highest(self, now, decided):
        held = length(now.response[0])
        return lambda state: held
