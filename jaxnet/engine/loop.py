"""One loop for all engines.

    at a tick    sense → tell → attack → channel → judge → drive    `tick`, then the engine's `hold`
    between      advance                                            the engine's
    at outputs   measure, gather, save, count, fail                 `metrics`

`in_lockstep` advances lanes that are all at the same tick. `from_queue` advances lanes that each
have their own time, and fills the place of a lane that has ended. The lanes are the last axis of
every array.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine import metrics, tick, vehicles
from jaxnet.engine.metrics import Gathered, Observation, Series
from jaxnet.engine.moment import Instants, LaneFlags, Moment, PerAxis, VehicleFlags
from jaxnet.engine.plan import Clock, Inputs, Outcome, Plan
from jaxnet.engine.queue import Places, Work, work_off
from jaxnet.engine.stages import coasting, stopping
from jaxnet.engine.stages.coasting import Rests, Stops
from jaxnet.engine.stages.stopping import Rest
from jaxnet.engine.status import Code, Isolation, Status, fail, nobody_isolated, within_bounds
from jaxnet.engine.subset import run_if, select
from jaxnet.engine.tick import DecisionState, Drive
from jaxnet.engine.told import as_told, told_errors
from jaxnet.engine.vehicles import PerVehicle, States
from jaxnet.model import control, plane, signal
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Basis

MotionState = TypeVar("MotionState")  # of a motion: a pytree, lanes last
TickNumber = Int[Array, ""] | int
Ticks = Int[Array, "*ticks"]  # number of ticks passed; one number where lanes are in lockstep


class Tick(NamedTuple):
    """Lanes at a tick, and the lanes and vehicles whose decisions changed."""

    here: LaneFlags
    first: LaneFlags  # the lanes at their first tick
    anew: LaneFlags  # the lanes here in which any decision changed, and those at their first tick
    vehicles: VehicleFlags  # whose retained sources changed


class Batch(NamedTuple):
    """Lanes side by side, with the network, clock and plan that they share."""

    inputs: Inputs
    network: Network
    clock: Clock
    plan: Plan

    @property
    def lane(self) -> Lane:
        return self.inputs.lane


class Motion(ABC, Generic[MotionState]):
    """Motion of a batch's lanes, which differs between engines. `state` is a pytree, lanes last."""

    def __init__(self, batch: Batch):
        self.lane, self.numbers = batch.inputs
        self.network, self.clock, self.plan = batch.network, batch.clock, batch.plan

    @property
    def acts(self) -> bool:
        """Whether anything happens at ticks after the first."""
        lane = self.lane
        noisy = lane.sensor is not None or lane.lossy or not lane.exact_words
        changing = lane.periods is not None
        stops = stopping.stops(lane)
        tests = lane.detector is not None
        return self.plan.choosing or changing or noisy or stops or tests or not lane.law.solves()

    @abstractmethod
    def begin(self) -> MotionState:
        """The state at t = 0, before anything is decided."""

    @abstractmethod
    def errors(self, state: MotionState) -> Jets:
        """E and its derivatives below the order now."""

    @abstractmethod
    def basis(self, state: MotionState) -> tuple[Instants, Basis]:
        """The time [s] and the attacks' functions now."""

    @abstractmethod
    def states(self, state: MotionState) -> States:
        """States of the vehicles, (n, m, lanes)."""

    @abstractmethod
    def placed(self, state: MotionState, which: VehicleFlags, states: States) -> MotionState:
        """Put vehicles at rest with these states."""

    @abstractmethod
    def drive_now(self, state: MotionState, decided: DecisionState) -> PerAxis:
        """The drive `z = y‴ + P(ŷ)` of each vehicle now [m/s³], where ŷ is what it senses."""

    def navigator(self, state: MotionState) -> Float[Array, "derivatives 2 lanes"]:
        """The navigator's path now."""
        return self.lane.path(self.basis(state)[0])

    @abstractmethod
    def hold(
        self, state: MotionState, decided: DecisionState, at: Tick
    ) -> tuple[MotionState, LaneFlags]:
        """The state that follows the decisions, and the lanes in which a vehicle is cut off."""

    @abstractmethod
    def advance(
        self, state: MotionState, decided: DecisionState, ticks: Ticks, status: Code
    ) -> tuple[MotionState, Code, LaneFlags]:
        """A later state, at most at the next tick; the status; the lanes that reached that tick."""

    def drive(self, state: MotionState, decided: DecisionState) -> Drive:
        """What the motion follows now."""
        return decided.drive(self.lane)

    def jerk(self, state: MotionState, decided: DecisionState) -> PerAxis:
        """y‴ [m/s³] right after these decisions, `z - P(ŷ)`."""
        own = vehicles.outputs(self.lane, self.states(state), self.basis(state)[0])
        return decided.sensed.jerk(self.lane.gain, self.drive_now(state, decided), own)

    def asked(self, state: MotionState, decided: DecisionState) -> PerAxis:
        """The inputs that the law asks for right after these decisions."""
        time, jerk = self.basis(state)[0], self.jerk(state, decided)
        return vehicles.asked(self.lane, self.states(state), jerk, time)

    def inputs(self, state: MotionState, decided: DecisionState) -> PerAxis:
        """The control inputs u of the vehicles right after these decisions."""
        asked, time = self.asked(state, decided), self.basis(state)[0]
        return vehicles.admitted(self.lane, self.states(state), asked, time)

    def pace(self, state: MotionState, decided: DecisionState) -> tuple[PerVehicle, PerVehicle]:
        """Speed [m/s] and turn rate [rad/s], (m, lanes), right after these decisions."""
        return vehicles.pace_of(self.lane, self.states(state), self.inputs(state, decided))

    def rest(self, state: Any) -> Rest | None:
        """Vehicles that have come to rest until now; None where vehicles do not stop."""
        return state.rest

    def steps(self, state: MotionState) -> Int[Array, " lanes"]:
        """The number of an integrator's steps so far; 0 without an integrator."""
        return jnp.zeros(self.lane.attack_scale.shape, int)


class InStates(Motion[Any]):
    """Motion of vehicles in their own states, which are the field `states`."""

    def errors(self, state):
        own = vehicles.outputs(self.lane, state.states, self.basis(state)[0])
        return plane.relative(own, self.navigator(state))

    def states(self, state):
        return state.states

    def placed(self, state, which, states):
        return state._replace(states=jnp.where(which[None], states, state.states))


class AtTicks(NamedTuple):
    """How often something happened to vehicles at ticks until now."""

    vehicles: Int[Array, " lanes"]  # (vehicle, tick) pairs
    ticks: Int[Array, " lanes"]  # with any such vehicle

    def after(self, happened: VehicleFlags) -> "AtTicks":
        some = happened.any(axis=0).astype(int)
        return AtTicks(self.vehicles + happened.sum(axis=0), self.ticks + some)


class Fleet(NamedTuple):
    """State of the lanes under way."""

    state: Any  # of the engine's motion
    decided: DecisionState
    ticks: Ticks
    at_tick: LaneFlags
    switches: Int[Array, " lanes"]
    unheard: Int[Array, " lanes"]
    isolation: Isolation
    status: Code
    stood: LaneFlags  # lanes with a vehicle that was singular at an output time
    gathered: Gathered
    windows: metrics.Windows
    tallies: dict[str, AtTicks]  # of what can happen at all, by the metric that tells the share


def begin(motion: Motion, ticks: Ticks) -> Fleet:
    """The lanes at t = 0, before their first tick.

    A lane is `singular` if it begins where the law is singular, `nonfinite` if it is not finite.
    """
    lane, plan = motion.lane, motion.plan
    nobody = jnp.zeros(lane.weights.shape[1:], bool)
    zero = jnp.zeros(lane.attack_scale.shape, int)
    status = fail(zero, Status.singular, is_singular(lane, vehicles.first_states(lane), nobody))
    status = fail(status, Status.nonfinite, ~jnp.isfinite(lane.initial).all(axis=(0, 1)))
    decided = tick.before_first(lane, motion.network, plan)
    may_happen = {
        "saturated": bool(lane.vehicle.limits),
        "infeasible": lane.filter is not None,
        "standing": isinstance(decided.coasting, Rests),
    }
    return Fleet(
        state=motion.begin(),
        decided=decided,
        ticks=ticks,
        at_tick=jnp.ones(zero.shape, bool),
        switches=zero,
        unheard=zero,
        isolation=nobody_isolated(*nobody.shape),
        status=status,
        stood=jnp.zeros(zero.shape, bool),
        gathered=metrics.nothing(plan.metrics, lane.initial.shape[1:]),
        windows=metrics.Windows(*[jnp.full(zero.shape, jnp.inf)] * 2),
        tallies={name: AtTicks(zero, zero) for name, may in may_happen.items() if may},
    )


def is_singular(lane: Lane, states: States, apart: VehicleFlags) -> LaneFlags:
    """The lanes in which a vehicle with these states, not `apart`, is singular."""
    if not lane.singular:
        return jnp.zeros(lane.attack_scale.shape, bool)
    return vehicles.singular(lane, states, apart).any(axis=0)


def arrive(fleet: Fleet, motion: Motion, lockstep: bool) -> Fleet:
    """Pass the tick in the lanes that are at one: decide, count, hold the decisions.

    The first decision is no switch. `lockstep` says that all lanes are at the same tick.
    """
    lane, network, plan = motion.lane, motion.network, motion.plan
    first = jnp.broadcast_to(fleet.ticks == 0, fleet.status.shape)
    here = fleet.at_tick & (fleet.status == Status.ok)
    kept = fleet.decided.coasting
    if isinstance(kept, Rests):  # vehicles that have stopped until now are put at rest
        kept = kept.at_tick(here, motion.rest(fleet.state))
        state = motion.placed(fleet.state, kept.standing & here[None], kept.states)
        fleet = fleet._replace(state=state, decided=replace(fleet.decided, coasting=kept))
    before = tick.before_first(lane, network, plan) if plan.in_field else fleet.decided
    (time, basis), errors = motion.basis(fleet.state), motion.errors(fleet.state)
    if plan.as_told:
        errors = told_errors(lane, basis, errors)
    now = Moment(lane, network, plan, errors, basis, time, jnp.zeros_like(errors[0]))
    if before.coasting.drives or before.heard.lossy or lane.defence.hears_messages():
        now = now._replace(last=last_drive(fleet, motion, now, first))
    decided = tick.decide(now, before)
    if isinstance(decided.coasting, Stops) and not coasting.rests_on_the_way(lane, plan):
        until_now = before.sensed.jerk(lane.gain, now.last, now.own)
        given = lane, motion.clock.interval, until_now, now.own, decided.sensed, here, time
        decided = replace(decided, coasting=decided.coasting.will_stop(*given))
    if not lockstep:
        decided = select(here, decided, fleet.decided)
    lanes, changed = decided.changes(fleet.decided, lane)
    at = Tick(here, first, here & (first | lanes), changed)
    state, cut_off = motion.hold(fleet.state, decided, at)
    status = fail(fleet.status, Status.disconnected, cut_off)
    if not lockstep:
        status = within_bounds(status, jnp.abs(now.errors[0]).max(axis=0))
    isolation = fleet.isolation
    if lane.law.couples() and (plan.decides or lane.alarms_cut):
        isolation = isolation.after(isolated(motion, decided, here, cut_off), time)
    return fleet._replace(
        state=state,
        decided=decided,
        tallies=tallies_after(fleet.tallies, motion, state, decided, here),
        status=status,
        switches=fleet.switches + jnp.where(here & ~first, changed.sum(axis=0), 0),
        unheard=fleet.unheard + jnp.where(here, decided.coasting.kept(lane).sum(axis=0), 0),
        isolation=isolation,
    )


def tallies_after(
    tallies: dict[str, AtTicks], motion: Motion, state: Any, decided: DecisionState, here: LaneFlags
) -> dict[str, AtTicks]:
    """Tallies with what happens to vehicles right after these decisions, in the lanes at a tick."""
    lane = motion.lane
    happens = {"standing": decided.coasting.stopped(lane)}
    if {*tallies} - {"standing"}:
        asked, time = motion.asked(state, decided), motion.basis(state)[0]
        admitted = vehicles.admitted(lane, motion.states(state), asked, time)
        happens["infeasible"] = jnp.isnan(asked).any(axis=0) | happens["standing"]
        happens["saturated"] = (asked != admitted).any(axis=0) & ~happens["infeasible"]
    return {name: tally.after(happens[name] & here[None]) for name, tally in tallies.items()}


def isolated(
    motion: Motion, decided: DecisionState, here: LaneFlags, failing: LaneFlags
) -> VehicleFlags:
    """The vehicles that decisions cut off at this tick.

    `failing` are the lanes that fail for it, in which the vehicles are sought only now.
    """
    lane, network = motion.lane, motion.network
    if coasting.coasts(lane):
        return decided.coasting.cut_off(lane) & here[None]

    def seek(_: VehicleFlags) -> VehicleFlags:
        return decided.cut_off(lane, network) & (failing & here)[None]

    return run_if((failing & here).any(), seek, jnp.zeros(lane.weights.shape[1:], bool))


def last_drive(fleet: Fleet, motion: Motion, now: Moment, first: LaneFlags) -> PerAxis:
    """The drive of each vehicle until now; at the first tick, that of a vehicle without jerk."""
    gain, decided, own = motion.lane.gain, fleet.decided, now.own
    drive = motion.drive_now(fleet.state, decided)
    last = jnp.where(first[None, None], control.feedback(gain, own), drive)
    standing = control.feedback(gain, decided.sensed.of(own))
    return jnp.where(decided.coasting.stopped(motion.lane)[None], standing, last)


def observe(fleet: Fleet, motion: Motion) -> Observation:
    lane, network, decided = motion.lane, motion.network, fleet.decided
    drive = motion.drive(fleet.state, decided)
    time, basis = motion.basis(fleet.state)
    stopped, shown = decided.coasting.stopped(lane), network.display_signals
    attacked = (lane.vectors[:, shown] != 0).any(axis=(0, 2))

    def error_of(state: Any) -> PerAxis:
        errors = motion.errors(state)
        if motion.plan.as_told:
            errors = told_errors(lane, motion.basis(state)[1], errors)
        return errors[0] if lane.navigator.present else errors[0] - honest_mean(errors[0], attacked)

    clock = motion.clock
    ticks = jnp.broadcast_to(fleet.ticks, fleet.status.shape)
    later = clock.at(ticks + clock.ticks)
    speed, turn_rate = motion.pace(fleet.state, decided)
    weights = drive.weights
    if decided.late.present or decided.heard.stands or decided.anchor.present:
        weights = decided.listened(lane)
    seen = Observation(
        error=error_of(fleet.state),
        speed=jnp.where(stopped, 0.0, speed),
        turn_rate=jnp.where(stopped, 0.0, turn_rate),
        state=decided.coasting.at_rest(motion.states(fleet.state)),
        attack=signal.combined(drive.vectors[:, shown], basis[0]),
        weights=weights,
        hearing=network.hearing,
        attacked=attacked,
        start=vehicles.first_outputs(lane)[0],
        steered=motion.errors(fleet.state)[0] + lane.path(time)[0][:, None],
        offset=None if lane.formation is None else lane.offsets(time)[0],
        inputs_now=lambda: jnp.where(stopped[None], 0.0, motion.inputs(fleet.state, decided)),
        errors_at_start=lambda: error_of(motion.begin()),
        time=clock.at(ticks),
        next_time=jnp.where(ticks < clock.outputs * clock.ticks, later, jnp.inf),
        leads=lane.navigator.present,
        alarms=decided.alarms.shares,
        links=decided.alarms.links(lane._replace(vectors=drive.vectors), network.hearing, time),
        tallies={name: until_now(tally, fleet) for name, tally in fleet.tallies.items()},
    )
    return as_told(lane, time, basis, seen) if motion.plan.as_told else seen


def until_now(tally: AtTicks, fleet: Fleet) -> Float[Array, "2 lanes"]:
    """The share of (vehicle, tick) pairs, and the number of ticks, of a tally."""
    pairs, ticks = tally
    vehicles = len(fleet.isolation.ever)
    return jnp.stack([pairs / (vehicles * (fleet.ticks + 1)), ticks.astype(float)])


def honest_mean(
    position: Float[Array, "2 m lanes"], attacked: Bool[Array, "m lanes"]
) -> Float[Array, "2 1 lanes"]:
    """The mean position of the vehicles that are not attacked; of all, where all are."""
    counts = ~attacked | attacked.all(axis=0, keepdims=True)
    total = jnp.where(counts[None], position, 0.0).sum(axis=1, keepdims=True)
    return total / counts.sum(axis=0, keepdims=True)[None].astype(float)


def measure(
    fleet: Fleet, motion: Motion, due: LaneFlags, output: Int[Array, "*lanes"]
) -> tuple[Fleet, Series]:
    """Gather the metrics in the lanes that are due, and return what is saved of all."""
    seen = observe(fleet, motion)
    gathered = metrics.add(motion.plan.metrics, fleet.gathered, seen, due, output, motion.clock)
    apart = fleet.decided.coasting.may_stop(motion.lane)
    stood = fleet.stood | (due & is_singular(motion.lane, seen.state, apart))
    windows = fleet.windows.after(seen, due, output, motion.clock)
    fleet = fleet._replace(gathered=gathered, stood=stood, windows=windows)
    return fleet, metrics.series(motion.plan.save, seen)


def outcome_of(fleet: Fleet, motion: Motion, series: Series) -> Outcome:
    clock, plan, gathered = motion.clock, motion.plan, fleet.gathered
    status = fail(fleet.status, Status.singular, fleet.stood)
    status = fail(status, Status.nonfinite, ~metrics.finite(gathered))
    values = metrics.fleet_values(plan.metrics, gathered, clock)
    status = fail(status, Status.unmeasured, ~metrics.all_defined(plan.metrics, values))
    ok = status == Status.ok
    cut_off = fleet.isolation.columns(clock.outputs * clock.ticks + 1)
    stopped = fleet.decided.coasting.stopped(motion.lane).sum(axis=0)
    return Outcome(
        status=status,
        metrics={name: jnp.where(ok, value, jnp.nan) for name, value in values.items()},
        steps=motion.steps(fleet.state),
        switches=fleet.switches,
        unheard=fleet.unheard,
        series=series | metrics.vehicle_errors(plan.save, gathered, clock, ok),
        cut_off=cut_off | {"stopped": stopped},
        tail_fall=jnp.where(ok, fleet.windows.fall(), jnp.nan),
    )


def in_lockstep(
    make: Callable[[Batch], Motion], inputs: Inputs, network: Network, clock: Clock, plan: Plan
) -> Outcome:
    """Simulate lanes side by side from 0 to the horizon. `make(batch)` gives their motion."""
    motion = make(Batch(inputs, network, clock, plan))

    def move(fleet: Fleet) -> Fleet:
        state, status, _ = motion.advance(fleet.state, fleet.decided, fleet.ticks, fleet.status)
        return fleet._replace(state=state, status=status)

    def pass_tick(number: TickNumber, fleet: Fleet) -> Fleet:
        fleet = run_if((number > 0) & (fleet.status == Status.ok).any(), move, fleet)
        fleet = fleet._replace(ticks=number)
        return arrive(fleet, motion, lockstep=True) if motion.acts else fleet

    def output(number: TickNumber, carry: tuple[Fleet, Series]) -> tuple[Fleet, Series]:
        fleet, series = carry
        last = number * clock.ticks
        if motion.acts or not plan.consistent:
            begin = jnp.maximum(0, last - clock.ticks + 1)
            fleet = jax.lax.fori_loop(begin, last + 1, pass_tick, fleet)
        else:
            fleet = pass_tick(last, fleet)
        ok, everywhere = fleet.status == Status.ok, jnp.ones_like(fleet.at_tick)
        fleet, saved = measure(fleet, motion, everywhere, jnp.asarray(number))

        def put(name: str, value: Array) -> Array:  # a scatter would slow the loop down
            there = jnp.where(ok, value, jnp.nan)
            return jax.lax.dynamic_update_index_in_dim(series[name], there, number, 0)

        series = {name: put(name, value) for name, value in saved.items()}
        status = within_bounds(fleet.status, fleet.gathered["peak_error"])
        return fleet._replace(status=status), series

    fleet = begin(motion, jnp.asarray(0))
    if not motion.acts:
        fleet = arrive(fleet, motion, lockstep=True)
    series = metrics.empty_series(plan.save, plan.rows, lambda: observe(fleet, motion))
    fleet, series = jax.lax.fori_loop(0, clock.outputs + 1, output, (fleet, series))
    return outcome_of(fleet, motion, series)


def from_queue(
    make: Callable[[Batch], Motion],
    queue: Inputs,
    count: TickNumber,
    network: Network,
    clock: Clock,
    plan: Plan,
) -> Outcome:
    """Simulate `count` lanes of a queue, `plan.chunk` at once; `make(batch)` is their motion."""

    def motion_of(inputs: Inputs) -> Motion:
        return make(Batch(inputs, network, clock, plan))

    def start(inputs: Inputs) -> Fleet:
        return begin(motion_of(inputs), jnp.zeros(inputs.lane.attack_scale.shape, int))

    def advance(places: Places, series: Series) -> tuple[Fleet, Series]:
        motion = motion_of(places.inputs)
        fleet = arrive(places.state, motion, lockstep=False)
        number = fleet.ticks // clock.ticks
        due = fleet.at_tick & (fleet.ticks % clock.ticks == 0) & (fleet.status == Status.ok)
        fleet, saved = measure(fleet, motion, due, number)
        place = jnp.where(due, number, plan.rows), ..., places.number
        series = {
            name: series[name].at[place].set(jnp.moveaxis(value, -1, 0), mode="drop")
            for name, value in saved.items()
        }
        now = fleet.state, fleet.decided, fleet.ticks, fleet.status
        state, status, arrived = motion.advance(*now)
        ticks = fleet.ticks + arrived.astype(int)
        return fleet._replace(state=state, status=status, ticks=ticks, at_tick=arrived), series

    def under_way(fleet: Fleet) -> LaneFlags:
        before_end = fleet.ticks < clock.outputs * clock.ticks
        return (fleet.status == Status.ok) & (fleet.at_tick | before_end)

    def end(inputs: Inputs, fleet: Fleet) -> Outcome:
        return outcome_of(fleet, motion_of(inputs), {})

    series = metrics.empty_series(
        plan.save, plan.rows, lambda: observe(start(queue), motion_of(queue))
    )
    work = Work(start, advance, under_way, end)
    outcome, series = work_off(queue, count, plan.chunk, work, series)
    return outcome._replace(series=outcome.series | series)
