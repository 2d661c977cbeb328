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
from jaxnet.engine.plan import CONNECTED, Inputs, Outcome, Plan
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
    steps: Int[Array, " lanes"]  # attempts so far, kept and refused
    due: Bool[Array, " lanes"]  # at an output time that was not yet measured
    dropped: Bool[Array, "slots m lanes"]
    held: Held
    switches: Int[Array, " lanes"]
    status: Code


class Run(NamedTuple):
    """Lanes under way and what was gathered of them."""

    fleet: Fleet
    gathered: Gathered


def simulate(queue: Inputs, count: Int[Array, ""], network: Network, plan: Plan) -> Outcome:
    """The first `count` lanes of a queue from 0 to the horizon, `plan.chunk` of them side by side."""
    rule = stepper.method(plan.solver)

    def begin(inputs: Inputs) -> Run:
        return Run(start(inputs, network, plan), Gathered.start(inputs.lane.initial.shape[1:]))

    def advance(places: Places, series: Any) -> tuple[Run, Any]:
        (fleet, gathered), inputs = places.state, places.inputs
        seen, number = observe(fleet, inputs.lane, network, plan), fleet.ticks // plan.ticks
        in_tail = number > plan.outputs - inputs.clock.tail_outputs
        gathered = gathered.add(seen, network.hearing, fleet.due, in_tail)
        series = record(series, seen, jnp.where(fleet.due, number, plan.outputs + 1), places.number)
        fleet, arrived = step(fleet, inputs, network, rule, plan)
        fleet = settle(fleet, arrived, inputs.lane, network, plan)
        at_output = arrived & (fleet.ticks % plan.ticks == 0) & (fleet.status == Status.ok)
        return Run(fleet._replace(due=at_output), gathered), series

    def record(series: Any, seen: Observation, output: Any, number: Any) -> Any:
        return {
            name: kept.at[output, ..., number].set(
                jnp.moveaxis(SERIES[name](seen, network.hearing), -1, 0), mode="drop"
            )
            for name, kept in series.items()
        }

    def under_way(run: Run) -> Bool[Array, " lanes"]:
        return moving(run.fleet, plan) | run.fleet.due

    def end(inputs: Inputs, run: Run) -> Outcome:
        fleet, ok = run.fleet, run.fleet.status == Status.ok
        metrics = run.gathered.metrics(inputs.clock.tail_outputs, ok)
        return Outcome(fleet.status, metrics, fleet.steps, fleet.switches, {})

    def one(inputs: Inputs) -> Any:
        seen = observe(start(inputs, network, plan), inputs.lane, network, plan)
        return {name: SERIES[name](seen, network.hearing) for name in plan.save}

    shapes = jax.eval_shape(one, queue)
    series = {name: jnp.full((plan.outputs + 1, *kept.shape), jnp.nan) for name, kept in shapes.items()}
    outcome, series = work_off(queue, count, plan.chunk, Work(begin, advance, under_way, end), series)
    return outcome._replace(series=series)


def moving(fleet: Fleet, plan: Plan) -> Bool[Array, " lanes"]:
    """Lanes that have neither failed nor reached the horizon."""
    return (fleet.status == Status.ok) & (fleet.ticks < plan.outputs * plan.ticks)


def start(inputs: Inputs, network: Network, plan: Plan) -> Fleet:
    """The lanes at t = 0 with their first decision taken."""
    lane, clock, tolerances = inputs
    lanes, zero = clock.interval.shape[0], jnp.zeros_like(clock.interval)
    still = (jnp.abs(lane.initial[robot.SPEED]) < LEAST_SPEED).any(axis=0)
    status = fail(jnp.zeros(lanes, int), Status.singular, still)
    status = fail(status, Status.nonfinite, ~jnp.isfinite(lane.initial).all(axis=(0, 1)))
    now = signals(lane, zero)
    dropped = choose(lane, network, lane.initial, now, network.defence.start(lane.weights))
    held, connected = hold(lane, network, dropped)
    status = fail(status, Status.disconnected, ~connected)
    slope = field(lane, network, held, now, lane.initial, plan)
    proposed = stepper.first_step(lane.initial, slope, tolerances)
    none = jnp.zeros(lanes, int)
    proposed = jnp.where(proposed > 0, proposed, clock.interval)
    due = status == Status.ok
    return Fleet(lane.initial, slope, now, zero, proposed, none, none, due, dropped, held, none, status)


def step(
    fleet: Fleet,
    inputs: Inputs,
    network: Network,
    rule: stepper.Method,
    plan: Plan,
) -> tuple[Fleet, Bool[Array, " lanes"]]:
    """One attempted step of the moving lanes, and which of them it brought to their next tick."""
    (lane, clock, tolerances), going = inputs, moving(fleet, plan)
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
    spent = going & (steps >= tolerances.max_steps) & (ticks < plan.outputs * plan.ticks)
    return fleet._replace(
        state=state,
        slope=jnp.where(kept[None, None], trial.slope, fleet.slope),
        signals=jax.tree.map(lambda new, old: jnp.where(kept, new, old), trial.signals, fleet.signals),
        time=time,
        step=jnp.where(going, proposed, fleet.step),
        ticks=ticks,
        steps=steps,
        status=fail(status, Status.max_steps, spent | stuck),
    ), arrived


def settle(fleet: Fleet, arrived: Bool[Array, " lanes"], lane: Lane, network: Network, plan: Plan) -> Fleet:
    """Hear and decide in the lanes that came to a tick; count the vehicles that changed their mind.

    Where a kept set changed, the Laplacian is inverted and the vector field evaluated anew.
    """
    arrived = arrived & (fleet.status == Status.ok)
    memory = network.defence.start(lane.weights) if plan.in_field else fleet.dropped
    decided = choose(lane, network, fleet.state, fleet.signals, memory)
    dropped = jnp.where(arrived[None, None], decided, fleet.dropped)
    changed = (dropped != fleet.dropped).any(axis=0).sum(axis=0)

    def some(few: Any, carry: Any) -> Any:
        held, slope, status = carry
        part, now = jax.tree.map(lambda leaf: picked(leaf, few), (lane, fleet.signals))
        new, connected = hold(part, network, picked(dropped, few))
        there = field(part, network, new, now, picked(fleet.state, few), plan)
        cut_off = fail(picked(status, few), Status.disconnected, ~connected)
        held = Held(put(held.weights, few, new.weights), put(held.inverse, few, new.inverse))
        return held, put(slope, few, there), put(status, few, cut_off)

    carry = for_each(changed > 0, SOLVED, some, (fleet.held, fleet.slope, fleet.status))
    held, slope, status = carry
    switches = fleet.switches + changed
    return fleet._replace(dropped=dropped, held=held, slope=slope, status=status, switches=switches)


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
