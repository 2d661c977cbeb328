"""One loop for all engines.

    at a tick    sense → tell → attack → channel → judge → drive    `tick`, then the engine's `hold`
    between      advance                                            the engine's
    at outputs   measure, gather, save, count, fail                 `metrics`

`in_lockstep` advances lanes that are all at the same tick. `from_queue` advances lanes that each have their
own time, and fills the place of a lane that has ended. The lanes are the last axis of every array.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine import fate, metrics, stopping, tick, told
from jaxnet.engine.fate import Isolation
from jaxnet.engine.metrics import Gathered, Observation, Series
from jaxnet.engine.plan import Clock, Inputs, Outcome, Plan
from jaxnet.engine.queue import Places, Work, work_off
from jaxnet.engine.status import LEAST_MARGIN, Code, Status, fail, within_bounds
from jaxnet.engine.stepper import States
from jaxnet.engine.subset import run_if, select
from jaxnet.engine.tick import DecisionState, Drive, Instants, LaneFlags, PerAxis, VehicleFlags
from jaxnet.model import control, plane, signal
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Basis

MotionState = TypeVar("MotionState")  # of a motion: a pytree, lanes last
TickNumber = Int[Array, ""] | int
PerVehicle = Float[Array, "m lanes"]
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
        """Return the lanes that the batch simulates."""
        return self.inputs.lane

    @property
    def acts(self) -> bool:
        """Return whether anything happens at ticks after the first."""
        lane = self.lane
        noisy = lane.sensor is not None or lane.lossy or not lane.exact_words
        changing = lane.periods is not None
        return self.plan.choosing or changing or noisy or not lane.law.solves()


class Motion(ABC, Generic[MotionState]):
    """Motion of a batch's lanes, which differs between engines. `state` is a pytree, lanes last."""

    def __init__(self, batch: Batch):
        self.lane, self.numbers = batch.inputs
        self.network, self.clock, self.plan = batch.network, batch.clock, batch.plan

    @abstractmethod
    def begin(self) -> MotionState:
        """Return the state at t = 0, before anything is decided."""

    @abstractmethod
    def errors(self, state: MotionState) -> Jets:
        """Return E and its derivatives below the order now."""

    @abstractmethod
    def basis(self, state: MotionState) -> tuple[Instants, Basis]:
        """Return the time [s] and the attacks' functions now."""

    @abstractmethod
    def states(self, state: MotionState) -> States:
        """Return the vehicles' states (n, m, lanes)."""

    @abstractmethod
    def placed(self, state: MotionState, vehicles: VehicleFlags, states: States) -> MotionState:
        """Put vehicles at rest with these states."""

    @abstractmethod
    def drive_now(self, state: MotionState, decided: DecisionState) -> Float[Array, "2 m lanes"]:
        """Return the drive `z = y‴ + P(ŷ)` of each vehicle now [m/s³], where ŷ is what the vehicle senses."""

    @abstractmethod
    def hold(
        self, state: MotionState, decided: DecisionState, at: Tick
    ) -> tuple[MotionState, LaneFlags]:
        """Return the state that follows the decisions, and the lanes in which a vehicle is cut off."""

    @abstractmethod
    def advance(
        self, state: MotionState, decided: DecisionState, ticks: Ticks, status: Code
    ) -> tuple[MotionState, Code, LaneFlags]:
        """Return a later state, at most at the next tick; the status; the lanes that reached that tick."""

    def drive(self, state: MotionState, decided: DecisionState) -> Drive:
        """Return the weights and attack vectors that the motion follows now."""
        return tick.drive(self.lane, decided, self.plan)

    def jerk(self, state: MotionState, decided: DecisionState) -> Float[Array, "2 m lanes"]:
        """Return y‴ [m/s³] right after these decisions, `z - P(ŷ)`."""
        own = self.lane.vehicle.output_jets(self.states(state))
        return self.drive_now(state, decided) - control.feedback(
            self.lane.gain, tick.sensed(own, decided.noise)
        )

    def inputs(self, state: MotionState, decided: DecisionState) -> Float[Array, "2 m lanes"]:
        """Return the control inputs u of the vehicles right after these decisions."""
        return self.lane.vehicle.inputs_for(self.states(state), self.jerk(state, decided))

    def pace(self, state: MotionState, decided: DecisionState) -> tuple[PerVehicle, PerVehicle]:
        """Return speed [m/s] and turn rate [rad/s], (m, lanes), right after these decisions."""
        return self.lane.vehicle.pace(self.states(state), self.inputs(state, decided))

    def steps(self, state: MotionState) -> Int[Array, " lanes"]:
        """Return the number of an integrator's steps so far; 0 without an integrator."""
        return jnp.zeros(self.lane.attack_scale.shape, int)


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


def begin(motion: Motion, batch: Batch, ticks: Ticks) -> Fleet:
    """Return the lanes at t = 0, before their first tick."""
    lane = batch.lane
    status = status_at_start(lane)
    return Fleet(
        state=motion.begin(),
        decided=tick.before_first(lane, batch.network, batch.plan),
        ticks=ticks,
        at_tick=jnp.ones(status.shape, bool),
        switches=jnp.zeros_like(status),
        unheard=jnp.zeros_like(status),
        isolation=fate.nobody(*lane.weights.shape[1:]),
        status=status,
        stood=jnp.zeros(status.shape, bool),
        gathered=metrics.nothing(batch.plan.metrics, lane.initial.shape[1:]),
    )


def status_at_start(lane: Lane) -> Code:
    """Return `singular` for lanes that begin where the law is singular, `nonfinite` for lanes that are not
    finite.
    """
    status = jnp.zeros(lane.attack_scale.shape, int)
    status = fail(status, Status.singular, is_singular(lane, lane.initial))
    return fail(status, Status.nonfinite, ~jnp.isfinite(lane.initial).all(axis=(0, 1)))


def is_singular(lane: Lane, states: States, may_stop: VehicleFlags | None = None) -> LaneFlags:
    """Return the lanes in which a vehicle with these states is singular, and may not stop."""
    if not lane.singular:
        return jnp.zeros(lane.attack_scale.shape, bool)
    singular = jnp.abs(lane.vehicle.margin(states)) < LEAST_MARGIN
    return (singular if may_stop is None else singular & ~may_stop).any(axis=0)


def stand(fleet: Fleet, motion: Motion, here: LaneFlags) -> Fleet:
    """Put vehicles that have stopped until now at rest, in the lanes at a tick."""
    coasting = fleet.decided.coasting
    if coasting is None or coasting.stopped is None:
        return fleet
    stopped = coasting.stopped.at_tick(here)
    state = motion.placed(fleet.state, stopped.vehicles & here[None], stopped.states)
    decided = fleet.decided._replace(coasting=coasting._replace(stopped=stopped))
    return fleet._replace(state=state, decided=decided)


def will_stop(
    lane: Lane, clock: Clock, decided: DecisionState, last: PerAxis, own: Jets, here: LaneFlags
) -> DecisionState:
    """Note the vehicles that stop before the next tick, in the lanes at a tick.

    `last` is the r-th derivative until now, which vehicles hold on under a law that holds one.
    """
    coasting = decided.coasting
    if coasting is None or coasting.stopped is None:
        return decided
    highest = last
    if not lane.law.needs_ticks():
        highest = coasting.drive - control.feedback(lane.gain, tick.sensed(own, decided.noise))
    among = coasting.cut_off & ~coasting.stopped.vehicles & here[None]
    soon, states = stopping.rest_within_tick(lane, (*own, highest), among, clock.interval)
    stopped = coasting.stopped._replace(
        soon=jnp.where(here[None], soon, coasting.stopped.soon),
        states=jnp.where(soon[None], states, coasting.stopped.states),
    )
    return decided._replace(coasting=coasting._replace(stopped=stopped))


def arrive(fleet: Fleet, motion: Motion, batch: Batch, lockstep: bool) -> Fleet:
    """Pass the tick in the lanes that are at one: decide, count, hold the decisions.

    The first decision is no switch. `lockstep` says that all lanes are at the same tick.
    """
    lane, network, plan = batch.lane, batch.network, batch.plan
    first = jnp.broadcast_to(fleet.ticks == 0, fleet.status.shape)
    here = fleet.at_tick & (fleet.status == Status.ok)
    fleet = stand(fleet, motion, here)
    before = tick.before_first(lane, network, plan) if plan.in_field else fleet.decided
    (time, basis), errors = motion.basis(fleet.state), motion.errors(fleet.state)
    if plan.as_told:
        errors = told.told_errors(lane, basis, errors)
    needed = before.coasting is not None or (
        before.reception is not None and plan.missing == "hold"
    )
    last = last_drive(fleet, motion, lane, first) if needed else None
    decided = tick.decide(lane, network, plan, before, errors, basis, time, last)
    if last is not None and decided.may_stop is not None:
        own = plane.plus(errors, [jet[:, None] for jet in lane.path(time)])
        until_now = last - control.feedback(lane.gain, tick.sensed(own, before.noise))
        decided = will_stop(lane, batch.clock, decided, until_now, own, here)
    if not lockstep:
        decided = select(here, decided, fleet.decided)
    lanes, vehicles = tick.changes(decided, fleet.decided, lane)
    switches = fleet.switches + jnp.where(here & ~first, vehicles.sum(axis=0), 0)
    unheard = fleet.unheard
    if decided.coasting is not None:
        unheard = unheard + jnp.where(here, decided.coasting.vehicles.sum(axis=0), 0)
    at = Tick(here, first, here & (first | lanes), vehicles)
    state, cut_off = motion.hold(fleet.state, decided, at)
    status = fail(fleet.status, Status.disconnected, cut_off)
    if not lockstep:
        status = within_bounds(status, jnp.abs(errors[0]).max(axis=0))
    alone = isolated(batch, decided, here, cut_off)
    isolation = fleet.isolation if alone is None else fate.passed(fleet.isolation, alone, time)
    counts = {"switches": switches, "unheard": unheard, "isolation": isolation}
    return fleet._replace(state=state, decided=decided, status=status, **counts)


def isolated(
    batch: Batch, decided: DecisionState, here: LaneFlags, failing: LaneFlags
) -> VehicleFlags | None:
    """Return the vehicles that decisions cut off at this tick; None where decisions never do.

    `failing` are the lanes that fail for it, in which the vehicles are sought only now.
    """
    lane, network, plan = batch.lane, batch.network, batch.plan
    if not lane.law.couples() or not plan.decides:
        return None
    if tick.coasts(lane) and decided.coasting is not None:
        return decided.coasting.cut_off & here[None]

    def seek(_: VehicleFlags) -> VehicleFlags:
        return tick.cut_off(lane, network, decided, plan) & (failing & here)[None]

    return run_if((failing & here).any(), seek, jnp.zeros(lane.weights.shape[1:], bool))


def last_drive(
    fleet: Fleet, motion: Motion, lane: Lane, first: LaneFlags
) -> Float[Array, "2 m lanes"]:
    """Return the drive of each vehicle until now; at the first tick, that of a vehicle without jerk."""
    time, _ = motion.basis(fleet.state)
    navigator = [jet[:, None] for jet in lane.path(time)]
    own, decided = plane.plus(motion.errors(fleet.state), navigator), fleet.decided
    last = jnp.where(
        first[None, None], control.feedback(lane.gain, own), motion.drive_now(fleet.state, decided)
    )
    if decided.coasting is None or decided.coasting.stopped is None:
        return last
    standing = control.feedback(lane.gain, tick.sensed(own, decided.noise))
    return jnp.where(decided.coasting.stopped.vehicles[None], standing, last)


def observe(fleet: Fleet, motion: Motion, batch: Batch) -> Observation:
    """Return the measurements of the fleets now."""
    drive = motion.drive(fleet.state, fleet.decided)
    time, basis = motion.basis(fleet.state)
    shown = drive.vectors[:, batch.network.display_signals]
    speed, turn_rate = motion.pace(fleet.state, fleet.decided)
    error, lane = motion.errors(fleet.state)[0], batch.lane
    states, coasting = (
        tick.at_rest(fleet.decided, motion.states(fleet.state)),
        fleet.decided.coasting,
    )
    stopped = None if coasting is None else coasting.stopped
    if stopped is not None:
        speed, turn_rate = (jnp.where(stopped.vehicles, 0.0, each) for each in (speed, turn_rate))
    theirs = told.told_motion(lane, time, basis) if batch.plan.as_told else None
    if theirs is not None:
        error, states = (
            theirs.instead_of(theirs.errors[0], error),
            theirs.instead_of(theirs.states, states),
        )
        speed, turn_rate = map(theirs.instead_of, theirs.pace, (speed, turn_rate))

    def inputs() -> Float[Array, "2 m lanes"]:
        by_law = motion.inputs(fleet.state, fleet.decided)
        by_law = by_law if stopped is None else jnp.where(stopped.vehicles[None], 0.0, by_law)
        return by_law if theirs is None else theirs.instead_of(theirs.inputs, by_law)

    attacked = (lane.vectors[:, batch.network.display_signals] != 0).any(axis=(0, 2))
    if not lane.navigator.present:
        error = error - honest_mean(error, attacked)
    late = lane.delay is not None  # no word is live then
    weights = tick.weights_in_force(lane, fleet.decided, batch.plan) if late else drive.weights
    return Observation(
        error,
        speed,
        turn_rate,
        states,
        signal.combined(shown, basis[0]),
        weights,
        batch.network.hearing,
        attacked,
        lane.vehicle.output_jets(lane.initial)[0],
        inputs,
        None if fleet.decided.detection is None else fleet.decided.detection.shares,
    )


def honest_mean(
    position: Float[Array, "2 m lanes"], attacked: Bool[Array, "m lanes"]
) -> Float[Array, "2 1 lanes"]:
    """Return the mean position of the vehicles that are not attacked; of all, where all are."""
    counts = ~attacked | attacked.all(axis=0, keepdims=True)
    total = jnp.where(counts[None], position, 0.0).sum(axis=1, keepdims=True)
    return total / counts.sum(axis=0, keepdims=True)[None].astype(float)


def outcome_of(fleet: Fleet, motion: Motion, batch: Batch, series: Series) -> Outcome:
    """Return the results of lanes that have ended."""
    clock, gathered = batch.clock, fleet.gathered
    status = fail(fleet.status, Status.singular, fleet.stood)
    status = fail(status, Status.nonfinite, ~metrics.finite(gathered))
    plan = batch.plan
    values = metrics.fleet_values(plan.metrics, gathered, clock.outputs, clock.tail_outputs)
    status = fail(status, Status.unmeasured, ~metrics.all_defined(plan.metrics, values))
    ok = status == Status.ok
    found = {name: jnp.where(ok, value, jnp.nan) for name, value in values.items()}
    errors = metrics.vehicle_errors(plan.save, gathered, clock.tail_outputs, ok)
    ticks, coasting = clock.outputs * clock.ticks + 1, fleet.decided.coasting
    stopped = None if coasting is None else coasting.stopped
    count = jnp.zeros_like(fleet.unheard) if stopped is None else stopped.vehicles.sum(axis=0)
    return Outcome(
        status,
        found,
        motion.steps(fleet.state),
        fleet.switches,
        fleet.unheard,
        series | errors,
        fate.isolation_counts(fleet.isolation, ticks) | {"stopped": count},
    )


def in_lockstep(
    make: Callable[[Batch], Motion], inputs: Inputs, network: Network, clock: Clock, plan: Plan
) -> Outcome:
    """Simulate lanes side by side from 0 to the horizon. `make(batch)` gives their motion."""
    batch = Batch(inputs, network, clock, plan)
    motion = make(batch)
    everywhere = jnp.ones(inputs.lane.attack_scale.shape, bool)

    def move(fleet: Fleet) -> Fleet:
        state, status, _ = motion.advance(fleet.state, fleet.decided, fleet.ticks, fleet.status)
        return fleet._replace(state=state, status=status)

    def pass_tick(number: TickNumber, fleet: Fleet) -> Fleet:
        fleet = run_if((number > 0) & (fleet.status == Status.ok).any(), move, fleet)
        fleet = fleet._replace(ticks=number)
        if batch.acts:
            return arrive(fleet, motion, batch, lockstep=True)
        return fleet

    def output(number: TickNumber, carry: tuple[Fleet, Series]) -> tuple[Fleet, Series]:
        fleet, series = carry
        last = number * clock.ticks
        if batch.acts or not plan.consistent:
            fleet = jax.lax.fori_loop(
                jnp.maximum(0, last - clock.ticks + 1), last + 1, pass_tick, fleet
            )
        else:
            fleet = pass_tick(last, fleet)
        seen, ok = observe(fleet, motion, batch), fleet.status == Status.ok
        series = {
            name: jax.lax.dynamic_update_index_in_dim(
                series[name], jnp.where(ok, value, jnp.nan), number, 0
            )
            for name, value in metrics.series(plan.save, seen).items()
        }
        gathered = metrics.add(
            plan.metrics, fleet.gathered, seen, everywhere, jnp.asarray(number), clock
        )
        stood = fleet.stood | is_singular(batch.lane, seen.state, fleet.decided.may_stop)
        status = within_bounds(fleet.status, gathered["peak_error"])
        return fleet._replace(gathered=gathered, stood=stood, status=status), series

    fleet = begin(motion, batch, jnp.asarray(0))
    if not batch.acts:
        fleet = arrive(fleet, motion, batch, lockstep=True)
    series = metrics.empty_series(plan.save, plan.rows, lambda: observe(fleet, motion, batch))
    fleet, series = jax.lax.fori_loop(0, clock.outputs + 1, output, (fleet, series))
    return outcome_of(fleet, motion, batch, series)


def from_queue(
    make: Callable[[Batch], Motion],
    queue: Inputs,
    count: TickNumber,
    network: Network,
    clock: Clock,
    plan: Plan,
) -> Outcome:
    """Simulate the first `count` lanes of a queue, `plan.chunk` of them side by side.

    `make(batch)` gives the motion of the lanes in a batch.
    """

    def start(inputs: Inputs) -> Fleet:
        batch = Batch(inputs, network, clock, plan)
        return begin(make(batch), batch, jnp.zeros(inputs.lane.attack_scale.shape, int))

    def advance(places: Places, series: Series) -> tuple[Fleet, Series]:
        batch = Batch(places.inputs, network, clock, plan)
        motion = make(batch)
        fleet = arrive(places.state, motion, batch, lockstep=False)
        seen, number = observe(fleet, motion, batch), fleet.ticks // clock.ticks
        due = fleet.at_tick & (fleet.ticks % clock.ticks == 0) & (fleet.status == Status.ok)
        gathered = metrics.add(plan.metrics, fleet.gathered, seen, due, number, clock)
        row = jnp.where(due, number, plan.rows)
        series = {
            name: series[name]
            .at[row, ..., places.number]
            .set(jnp.moveaxis(value, -1, 0), mode="drop")
            for name, value in metrics.series(plan.save, seen).items()
        }
        state, status, arrived = motion.advance(
            fleet.state, fleet.decided, fleet.ticks, fleet.status
        )
        ticks = fleet.ticks + arrived.astype(int)
        stood = fleet.stood | (due & is_singular(batch.lane, seen.state, fleet.decided.may_stop))
        rest = {
            "ticks": ticks,
            "at_tick": arrived,
            "status": status,
            "stood": stood,
            "gathered": gathered,
        }
        return fleet._replace(state=state, **rest), series

    def under_way(fleet: Fleet) -> LaneFlags:
        before_end = fleet.ticks < clock.outputs * clock.ticks
        return (fleet.status == Status.ok) & (fleet.at_tick | before_end)

    def end(inputs: Inputs, fleet: Fleet) -> Outcome:
        batch = Batch(inputs, network, clock, plan)
        return outcome_of(fleet, make(batch), batch, {})

    def one() -> Observation:
        batch = Batch(queue, network, clock, plan)
        return observe(start(queue), make(batch), batch)

    series = metrics.empty_series(plan.save, plan.rows, one)
    outcome, series = work_off(
        queue, count, plan.chunk, Work(start, advance, under_way, end), series
    )
    return outcome._replace(series=outcome.series | series)
