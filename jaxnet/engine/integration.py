"""The nonlinear vehicles under the law, integrated adaptively. It is the truth.

It evaluates the law from what is received and solves with the weights in force; the exact cancellation that
the law achieves is not taken for granted. Whom to retain is decided at ticks and held between them, or, with
`Plan.in_field`, inside the vector field, which is the literal reading of the paper.

The lanes are the last axis of every array. Each has its own time and step: a pass of the loop is one
attempted step of every lane, from wherever it is, and where lanes have ended the next take their places.
A few vehicles of a lane that need shorter steps take them within it (`multirate`).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine import metrics, multirate, stepper
from jaxnet.engine import tick as ticks
from jaxnet.engine.metrics import Gathered, Observation
from jaxnet.engine.plan import CONNECTED, Clock, Inputs, Outcome, Plan
from jaxnet.engine.queue import Places, Work, work_off
from jaxnet.engine.signals import Signals, Times, signals
from jaxnet.engine.status import LEAST_SPEED, Code, Status, fail
from jaxnet.engine.subset import for_each, picked, put
from jaxnet.engine.tick import Mind
from jaxnet.kinds.vehicles import SPEED
from jaxnet.model import control, elimination, signal
from jaxnet.model.hearing import AxisWeights
from jaxnet.model.lane import Lane, Network
from jaxnet.model.signal import Vectors

SOLVED, SOLVED_OF_LARGE = 16, 2  # lanes whose Laplacians are factorised at once
LARGE = 24  # vehicles; from there on lanes that need it not cost more than another pass does

State = Float[Array, "n m lanes"]


class Held(NamedTuple):
    """What a tick decided and the vehicles hold until the next."""

    weights: AxisWeights
    factors: Any  # of `elimination`, of the Laplacian of these weights; () where a jerk is held
    jerk: Any  # (2, m, lanes), else ()
    response: Any  # vectors of what attacks do to the fleet, from which iteration starts; () where none is


class Fleet(NamedTuple):
    """Lanes under way."""

    state: State
    slope: State  # the vector field there
    signals: Signals
    step: Times  # [s] proposed for the next attempt
    ticks: Int[Array, " lanes"]  # passed
    at_tick: Bool[Array, " lanes"]  # at a tick at which they have not yet received
    steps: Int[Array, " lanes"]  # attempts so far, kept and refused
    mind: Mind
    held: Held
    switches: Int[Array, " lanes"]
    status: Code


class UnderWay(NamedTuple):
    """Lanes under way and what was gathered of them."""

    fleet: Fleet
    gathered: Gathered


def simulate(queue: Inputs, count: Int[Array, ""], network: Network, clock: Clock, plan: Plan) -> Outcome:
    """The first `count` lanes of a queue from 0 to the horizon, `plan.chunk` of them side by side."""
    rule = stepper.method(plan.options[0])

    def begin(inputs: Inputs) -> UnderWay:
        gathered = metrics.nothing(plan.metrics, inputs.lane.initial.shape[1:])
        return UnderWay(start(inputs, network, clock, plan), gathered)

    def advance(places: Places, series: Any) -> tuple[UnderWay, Any]:
        (fleet, gathered), inputs = places.state, places.inputs
        fleet = settle(fleet, inputs, network, clock, plan)
        seen, number = observe(fleet, inputs.lane, network, plan), fleet.ticks // clock.ticks
        due = fleet.at_tick & (fleet.ticks % clock.ticks == 0) & (fleet.status == Status.ok)
        gathered = metrics.add(plan.metrics, gathered, seen, due, clock.in_tail(number))
        series = record(series, seen, jnp.where(due, number, plan.rows), places.number)
        return UnderWay(step(fleet, inputs, network, clock, rule, plan), gathered), series

    def record(series: Any, seen: Observation, output: Any, number: Any) -> Any:
        return {
            name: series[name].at[output, ..., number].set(jnp.moveaxis(value, -1, 0), mode="drop")
            for name, value in ticks.series(plan, seen).items()
        }

    def under_way(run: UnderWay) -> Bool[Array, " lanes"]:
        return (run.fleet.status == Status.ok) & (run.fleet.at_tick | moving(run.fleet, clock))

    def end(inputs: Inputs, run: UnderWay) -> Outcome:
        fleet, status = run.fleet, fail(run.fleet.status, Status.nonfinite, ~metrics.finite(run.gathered))
        found = metrics.of_fleet(
            plan.metrics, run.gathered, clock.outputs, clock.tail_outputs, status == Status.ok
        )
        return Outcome(status, found, fleet.steps, fleet.switches, {})

    def one() -> Observation:
        return observe(start(queue, network, clock, plan), queue.lane, network, plan)

    work = Work(begin, advance, under_way, end)
    outcome, series = work_off(queue, count, plan.chunk, work, ticks.room(plan, one))
    return outcome._replace(series=series)


def moving(fleet: Fleet, clock: Clock) -> Bool[Array, " lanes"]:
    """Lanes that have neither failed nor reached the horizon."""
    return (fleet.status == Status.ok) & (fleet.ticks < clock.outputs * clock.ticks)


def start(inputs: Inputs, network: Network, clock: Clock, plan: Plan) -> Fleet:
    """The lanes at t = 0, at a tick as at any other."""
    lane, status = inputs.lane, ticks.status_at_start(inputs.lane)
    none, zero = jnp.zeros_like(status), jnp.zeros_like(lane.amplitude)
    mind = ticks.begin(lane, network, plan)
    held = jax.eval_shape(lambda: at_first(lane, network, mind, plan))
    return Fleet(
        state=lane.initial,
        slope=jnp.zeros_like(lane.initial),
        signals=signals(lane, zero),
        step=zero + clock.interval,
        ticks=none,
        at_tick=jnp.ones(status.shape, bool),
        steps=none,
        mind=mind,
        held=jax.tree.map(lambda leaf: jnp.zeros(leaf.shape), held),
        switches=none,
        status=status,
    )


def step(
    fleet: Fleet,
    inputs: Inputs,
    network: Network,
    clock: Clock,
    rule: stepper.Method,
    plan: Plan,
) -> Fleet:
    """One attempted step of the moving lanes."""
    (lane, tolerances), going, time = inputs, moving(fleet, clock), fleet.signals.time
    goal = clock.at(fleet.ticks + 1)
    end = stepper.towards(goal, time, fleet.step)
    trial = stepper.attempt(
        lambda now, state: field(lane, network, fleet.held, fleet.mind, now, state, plan),
        lambda time: signals(lane, time),
        rule,
        time,
        end,
        fleet.state,
        fleet.slope,
        tolerances,
    )
    if multirate.suits(lane, plan):
        trial = multirate.refined(trial, going, time, end, fleet.state, lane, tolerances, rule)
    kept, steps = going & (trial.error < 1.0), fleet.steps + going.astype(int)
    proposed = stepper.next_step(end - time, trial.error, rule)
    state = jnp.where(kept[None, None], trial.state, fleet.state)
    still = (state[SPEED] * jnp.sign(lane.initial[SPEED]) < LEAST_SPEED).any(axis=0)
    stuck = going & ~kept & (proposed <= stepper.ROUNDING * jnp.maximum(goal, 1.0))
    arrived = kept & (end == goal)
    ticks = fleet.ticks + arrived.astype(int)
    status = fail(fleet.status, Status.singular, going & still)
    status = fail(status, Status.nonfinite, stuck & ~trial.finite)
    spent = going & (steps >= tolerances.max_steps) & (ticks < clock.outputs * clock.ticks)
    return fleet._replace(
        state=state,
        slope=jnp.where(kept[None, None], trial.slope, fleet.slope),
        signals=where(kept, trial.signals, fleet.signals),
        step=jnp.where(going, proposed, fleet.step),
        ticks=ticks,
        at_tick=arrived,
        steps=steps,
        status=fail(status, Status.max_steps, spent | stuck),
    )


def settle(fleet: Fleet, inputs: Inputs, network: Network, clock: Clock, plan: Plan) -> Fleet:
    """Receive and decide in the lanes at a tick; count the vehicles that changed their mind.

    Where a weight changed, and at the start, the Laplacian is factorised; there, and where an attack changed,
    the vector field is evaluated anew. Where a jerk is held, vehicles exchange instead, at every tick.
    """
    lane, tolerances = inputs
    here, first = fleet.at_tick & (fleet.status == Status.ok), fleet.ticks == 0
    before = ticks.begin(lane, network, plan) if plan.in_field else fleet.mind
    decided = decide(lane, network, plan, before, fleet.state, fleet.signals)
    mind = where(here, decided, fleet.mind)
    lanes, vehicles = ticks.changed(mind, fleet.mind, lane)

    def some(few: Any, carry: Any) -> Any:
        held, slope, step, status = carry
        part, now, chosen, tolerated = jax.tree.map(
            lambda leaf: picked(leaf, few), (lane, fleet.signals, mind, tolerances)
        )
        state = picked(fleet.state, few)
        if lane.law.holds:
            last = picked(held.jerk, few)
            new, connected = exchange(part, network, chosen, last, now, state, plan)
        else:
            new, connected = hold(part, network, chosen, plan)
        there = field(part, network, new, chosen, now, state, plan)
        proposed = stepper.first_step(state, there, tolerated)
        proposed = jnp.where(picked(first, few) & (proposed > 0), proposed, picked(step, few))
        cut_off = fail(picked(status, few), Status.disconnected, ~connected)
        held = jax.tree.map(lambda all_lanes, theirs: put(all_lanes, few, theirs), held, new)
        return held, put(slope, few, there), put(step, few, proposed), put(status, few, cut_off)

    carry = fleet.held, fleet.slope, fleet.step, fleet.status
    anew = here if lane.law.holds else here & (first | lanes)
    at_once = SOLVED if lane.initial.shape[1] < LARGE else SOLVED_OF_LARGE
    held, slope, step, status = for_each(anew, at_once, some, carry)
    switches = fleet.switches + jnp.where(first, 0, vehicles.sum(axis=0))
    return fleet._replace(mind=mind, held=held, slope=slope, step=step, status=status, switches=switches)


def where(flagged: Bool[Array, " lanes"], new: Any, old: Any) -> Any:
    """One tree in the flagged lanes, the other elsewhere."""
    return jax.tree.map(lambda a, b: jnp.where(flagged.reshape(*[1] * (a.ndim - 1), -1), a, b), new, old)


def decide(lane: Lane, network: Network, plan: Plan, mind: Mind, state: State, now: Signals) -> Mind:
    """What is decided for what is received now."""
    own = lane.vehicle.output_jets(state)
    errors = tuple(jet - there[:, None] for jet, there in zip(own, now.navigator, strict=False))
    return ticks.decide(lane, network, plan, mind, errors, now.basis, now.time)


def hold(lane: Lane, network: Network, mind: Mind, plan: Plan) -> tuple[Held, Bool[Array, " n"]]:
    """The weights in force, their Laplacian's factors, and whether the navigator reaches everybody."""
    weights = ticks.weights_of(lane, mind, plan)
    factors, residual = elimination.factorised(network.order, network.hearing, weights)
    held = Held(weights, factors, (), ())
    if isinstance(network.order, elimination.NoOrder):
        held = held._replace(response=response(ticks.vectors_of(lane, mind), held, network))
    return held, residual < CONNECTED


def response(vectors: Vectors, held: Held, network: Network) -> Vectors:
    """`L⁻¹ d` for the attacks' vectors."""

    def of_one(vector: Any) -> Any:
        right = network.hearing.mean_added(held.weights, vector)
        return elimination.applied(network.order, network.hearing, held.factors, right, ())

    return jnp.moveaxis(jax.lax.map(of_one, jnp.moveaxis(vectors, 2, 0)), 0, 2)


def exchange(
    lane: Lane, network: Network, mind: Mind, last: Any, now: Signals, state: State, plan: Plan
) -> tuple[Held, Bool[Array, " lanes"]]:
    """The weights in force, the jerk that comes of exchanges, and whether the navigator reaches everybody."""
    weights, own = ticks.weights_of(lane, mind, plan), lane.vehicle.output_jets(state)
    attack = signal.combined(ticks.vectors_of(lane, mind), now.drive)
    jerk = ticks.exchanged(lane, network, weights, own, now.path, attack, last)
    return Held(weights, (), jerk, ()), network.hearing.all_reached(weights)


def at_first(lane: Lane, network: Network, mind: Mind, plan: Plan) -> Held:
    """What is held before the first tick, in its shapes alone."""
    if lane.law.holds:
        return Held(ticks.weights_of(lane, mind, plan), (), jnp.zeros_like(lane.initial[:2]), ())
    return hold(lane, network, mind, plan)[0]


def field(
    lane: Lane, network: Network, held: Held, mind: Mind, now: Signals, state: State, plan: Plan
) -> State:
    """`ẋ = f(x, u(t, x))` with the weights held, or a jerk, or decided at every evaluation without memory."""
    if lane.law.holds:
        return lane.vehicle.motion(state, lane.vehicle.inputs_for(state, held.jerk))
    if plan.in_field:
        chosen = decide(lane, network, plan, ticks.begin(lane, network, plan), state, now)
        held, _ = hold(lane, network, chosen, plan)
    own, vectors = lane.vehicle.output_jets(state), ticks.vectors_of(lane, mind)
    attack = signal.combined(vectors, now.drive)
    demand = control.demand(own, now.path, attack, network.hearing, held.weights, lane.gain)
    start = () if isinstance(held.response, tuple) else expected(lane, held, now, own)
    jerk = elimination.applied(network.order, network.hearing, held.factors, demand, start)
    return lane.vehicle.motion(state, lane.vehicle.inputs_for(state, jerk))


def expected(lane: Lane, held: Held, now: Signals, own: Any) -> Any:
    """The jerk that the law leads to if it cancels exactly: `R(y_0) - P(y)` and what the attacks do.

    Iteration starts there, and goes on until the jerk solves what the vehicles have received.
    """
    forced = signal.combined(held.response, now.drive)
    return now.path[:, None] + forced - control.feedback(lane.gain, own)


def observe(fleet: Fleet, lane: Lane, network: Network, plan: Plan) -> Observation:
    """The fleets as they are measured now."""
    weights = ticks.weights_of(lane, fleet.mind, plan) if plan.in_field else fleet.held.weights
    speed, turn_rate = lane.vehicle.pace(fleet.state)
    return Observation(
        fleet.state[:2] - fleet.signals.navigator[0][:, None],
        speed,
        turn_rate,
        fleet.state,
        signal.combined(ticks.vectors_of(lane, fleet.mind)[:, network.shown], fleet.signals.basis[0]),
        weights,
        network.hearing,
    )
