"""The chassis engine: the nonlinear robots under the law, integrated adaptively. It is the truth.

It evaluates the law from what is heard and solves with the weights in force; the exact cancellation that the
law achieves is nowhere used. Trimming is decided at ticks and held between them, or, with `Plan.in_field`,
decided inside the vector field, which is the literal reading of the paper.

The lanes are the last axis of every array. Each has its own time and step: a pass of the loop is one
attempted step of every lane, from wherever it is, and where lanes have ended the next take their places.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine import stepper
from jaxnet.engine.metrics import SERIES, Gathered, Observation
from jaxnet.engine.plan import CONNECTED, Clock, Inputs, Outcome, Plan
from jaxnet.engine.queue import Places, Work, work_off
from jaxnet.engine.status import LEAST_SPEED, Code, Status, fail
from jaxnet.engine.subset import for_each, picked, put
from jaxnet.model import control, robot
from jaxnet.model.circle import circle
from jaxnet.model.lane import Lane, Network

SOLVED = 16  # lanes whose Laplacians are inverted at once

Times = Float[Array, " lanes"]


class Held(NamedTuple):
    """What a tick decided and the vehicles hold until the next."""

    weights: Float[Array, "slots m lanes"]
    inverse: Float[Array, "m m lanes"]  # of the Laplacian of these weights


class Signals(NamedTuple):
    """Cosine and sine of what turns with time alone."""

    navigator: tuple[Float[Array, "2 lanes"], Float[Array, "2 lanes"]]
    attack: tuple[Times, Times]


class Fleet(NamedTuple):
    """Lanes under way."""

    state: robot.State
    slope: robot.State  # the vector field there
    signals: Signals
    time: Times
    step: Times  # [s] proposed for the next attempt
    ticks: Int[Array, " lanes"]  # passed
    at_tick: Bool[Array, " lanes"]  # at a tick at which they have not yet heard
    steps: Int[Array, " lanes"]  # attempts so far, kept and refused
    dropped: Bool[Array, "slots m lanes"]
    held: Held
    switches: Int[Array, " lanes"]
    status: Code


class Run(NamedTuple):
    """Lanes under way and what was gathered of them."""

    fleet: Fleet
    gathered: Gathered


def simulate(queue: Inputs, count: Int[Array, ""], network: Network, clock: Clock, plan: Plan) -> Outcome:
    """The first `count` lanes of a queue from 0 to the horizon, `plan.chunk` of them side by side."""
    rule = stepper.method(plan.solver)

    def begin(inputs: Inputs) -> Run:
        return Run(start(inputs, clock), Gathered.start(inputs.lane.initial.shape[1:]))

    def advance(places: Places, series: Any) -> tuple[Run, Any]:
        (fleet, gathered), inputs = places.state, places.inputs
        fleet = settle(fleet, inputs, network, plan)
        seen, number = observe(fleet, inputs.lane, network, plan), fleet.ticks // clock.ticks
        due = fleet.at_tick & (fleet.ticks % clock.ticks == 0) & (fleet.status == Status.ok)
        gathered = gathered.add(seen, network.hearing, due, clock.in_tail(number))
        series = record(series, seen, jnp.where(due, number, plan.rows), places.number)
        return Run(step(fleet, inputs, network, clock, rule, plan), gathered), series

    def record(series: Any, seen: Observation, output: Any, number: Any) -> Any:
        return {
            name: kept.at[output, ..., number].set(
                jnp.moveaxis(SERIES[name](seen, network.hearing), -1, 0), mode="drop"
            )
            for name, kept in series.items()
        }

    def under_way(run: Run) -> Bool[Array, " lanes"]:
        return (run.fleet.status == Status.ok) & (run.fleet.at_tick | moving(run.fleet, clock))

    def end(inputs: Inputs, run: Run) -> Outcome:
        fleet, status = run.fleet, fail(run.fleet.status, Status.nonfinite, ~run.gathered.finite())
        metrics = run.gathered.metrics(clock.tail_outputs, status == Status.ok)
        return Outcome(status, metrics, fleet.steps, fleet.switches, {})

    def one(inputs: Inputs) -> Any:
        seen = observe(start(inputs, clock), inputs.lane, network, plan)
        return {name: SERIES[name](seen, network.hearing) for name in plan.save}

    shapes = jax.eval_shape(one, queue)
    series = {name: jnp.full((plan.rows, *kept.shape), jnp.nan) for name, kept in shapes.items()}
    outcome, series = work_off(queue, count, plan.chunk, Work(begin, advance, under_way, end), series)
    return outcome._replace(series=series)


def moving(fleet: Fleet, clock: Clock) -> Bool[Array, " lanes"]:
    """Lanes that have neither failed nor reached the horizon."""
    return (fleet.status == Status.ok) & (fleet.ticks < clock.outputs * clock.ticks)


def start(inputs: Inputs, clock: Clock) -> Fleet:
    """The lanes at t = 0, at a tick as at any other."""
    lane, m = inputs.lane, inputs.lane.initial.shape[1]
    still = (jnp.abs(lane.initial[robot.SPEED]) < LEAST_SPEED).any(axis=0)
    none = jnp.zeros(still.shape, int)
    status = fail(none, Status.singular, still)
    zero = jnp.zeros_like(lane.tolerance)
    return Fleet(
        state=lane.initial,
        slope=jnp.zeros_like(lane.initial),
        signals=signals(lane, zero),
        time=zero,
        step=jnp.zeros_like(zero) + clock.interval,
        ticks=none,
        at_tick=jnp.ones(still.shape, bool),
        steps=none,
        dropped=jnp.zeros(lane.weights.shape, bool),
        held=Held(lane.weights, jnp.zeros((m, *lane.initial.shape[1:]))),
        switches=none,
        status=fail(status, Status.nonfinite, ~jnp.isfinite(lane.initial).all(axis=(0, 1))),
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
    (lane, tolerances), going = inputs, moving(fleet, clock)
    goal = clock.at(fleet.ticks + 1)
    pieces = jnp.maximum(1.0, jnp.ceil((goal - fleet.time) / fleet.step))
    end = jnp.where(pieces > 1, fleet.time + (goal - fleet.time) / pieces, goal)
    trial = stepper.attempt(
        lambda now, state: field(lane, network, fleet.held, now, state, plan),
        lambda time: signals(lane, time),
        rule,
        fleet.time,
        end,
        fleet.state,
        fleet.slope,
        tolerances,
    )
    kept, steps = going & (trial.error < 1.0), fleet.steps + going.astype(int)
    time = jnp.where(kept, end, fleet.time)
    proposed = stepper.next_step(end - fleet.time, trial.error, rule)
    state = jnp.where(kept[None, None], trial.state, fleet.state)
    still = (jnp.abs(state[robot.SPEED]) < LEAST_SPEED).any(axis=0)
    stuck = going & ~kept & (proposed <= stepper.ROUNDING * jnp.maximum(goal, 1.0))
    arrived = kept & (end == goal)
    ticks = fleet.ticks + arrived.astype(int)
    status = fail(fleet.status, Status.singular, going & still)
    status = fail(status, Status.nonfinite, stuck & ~trial.finite)
    spent = going & (steps >= tolerances.max_steps) & (ticks < clock.outputs * clock.ticks)
    return fleet._replace(
        state=state,
        slope=jnp.where(kept[None, None], trial.slope, fleet.slope),
        signals=jax.tree.map(lambda new, old: jnp.where(kept, new, old), trial.signals, fleet.signals),
        time=time,
        step=jnp.where(going, proposed, fleet.step),
        ticks=ticks,
        at_tick=arrived,
        steps=steps,
        status=fail(status, Status.max_steps, spent | stuck),
    )


def settle(fleet: Fleet, inputs: Inputs, network: Network, plan: Plan) -> Fleet:
    """Hear and decide in the lanes at a tick; count the vehicles that changed their mind.

    Where a kept set changed, and at the start, the Laplacian is inverted and the vector field evaluated.
    """
    lane, tolerances = inputs
    here, first = fleet.at_tick & (fleet.status == Status.ok), fleet.ticks == 0
    memory = network.defence.start(lane.weights) if plan.in_field else fleet.dropped
    decided = choose(lane, network, fleet.state, fleet.signals, memory)
    dropped = jnp.where(here[None, None], decided, fleet.dropped)
    changed = (dropped != fleet.dropped).any(axis=0).sum(axis=0)

    def some(few: Any, carry: Any) -> Any:
        held, slope, step, status = carry
        part, now = jax.tree.map(lambda leaf: picked(leaf, few), (lane, fleet.signals))
        state, tolerated = picked(fleet.state, few), jax.tree.map(lambda leaf: picked(leaf, few), tolerances)
        new, connected = hold(part, network, picked(dropped, few))
        there = field(part, network, new, now, state, plan)
        proposed = stepper.first_step(state, there, tolerated)
        proposed = jnp.where(picked(first, few) & (proposed > 0), proposed, picked(step, few))
        cut_off = fail(picked(status, few), Status.disconnected, ~connected)
        held = Held(put(held.weights, few, new.weights), put(held.inverse, few, new.inverse))
        return held, put(slope, few, there), put(step, few, proposed), put(status, few, cut_off)

    carry = fleet.held, fleet.slope, fleet.step, fleet.status
    carry = for_each(here & (first | (changed > 0)), SOLVED, some, carry)
    held, slope, step, status = carry
    switches = fleet.switches + jnp.where(first, 0, changed)
    return fleet._replace(
        dropped=dropped, held=held, slope=slope, step=step, status=status, switches=switches
    )


def signals(lane: Lane, time: Times) -> Signals:
    """The angles at these times."""
    return Signals(lane.navigator.angle(time), circle(lane.attack.frequency * time))


def choose(lane: Lane, network: Network, state: robot.State, now: Signals, memory: Any) -> Any:
    """Slots dropped for what is heard now."""
    sources = jnp.concatenate([lane.navigator.at(*now.navigator)[0][:, None], state[:2]], axis=1)
    heard = network.hearing.heard(sources, lane.attack.at(*now.attack)[0])
    return network.defence.decide(lane.weights, heard, memory, lane.tolerance)


def hold(lane: Lane, network: Network, dropped: Bool[Array, "slots m n"]) -> tuple[Held, Bool[Array, " n"]]:
    """The weights in force, their Laplacian's inverse, and whether the navigator reaches everybody."""
    weights = network.defence.in_force(lane.weights, dropped)
    inverse, residual = control.invert(network.hearing.matrix(weights))
    return Held(weights, inverse), residual < CONNECTED


def field(
    lane: Lane, network: Network, held: Held, now: Signals, state: robot.State, plan: Plan
) -> robot.State:
    """`ẋ = f(x, u(t, x))` with the weights held, or decided at every evaluation without memory."""
    if plan.in_field:
        dropped = choose(lane, network, state, now, network.defence.start(lane.weights))
        held, _ = hold(lane, network, dropped)
    own, told = robot.output_jets(state), lane.navigator.at(*now.navigator)
    signal = lane.attack.at(*now.attack)
    demand = control.demand(own, told, signal, network.hearing, held.weights, lane.gain)
    return robot.motion(state, robot.inputs_for(state, control.product(held.inverse, demand)))


def observe(fleet: Fleet, lane: Lane, network: Network, plan: Plan) -> Observation:
    """The fleets as they are measured now."""
    return Observation(
        fleet.state[:2] - lane.navigator.at(*fleet.signals.navigator)[0][:, None],
        fleet.state[robot.SPEED],
        fleet.state[robot.TURN_RATE],
        fleet.state,
        lane.attack.at(*fleet.signals.attack)[0],
        network.defence.in_force(lane.weights, fleet.dropped) if plan.in_field else fleet.held.weights,
    )
