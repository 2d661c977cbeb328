"""The chassis engine: the nonlinear robots under the law, integrated adaptively. It is the truth.

It evaluates ε from what is heard and solves with the weights in force; the exact cancellation that the law
achieves is nowhere used. Trimming is decided at ticks and held between them, or, with `Plan.in_field`,
decided inside the vector field, which is the literal reading of the paper.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine import stepper
from jaxnet.engine.metrics import Metrics, Observation
from jaxnet.engine.status import Code, Status, fail
from jaxnet.model import attack, control, robot
from jaxnet.model.lane import Lane

LEAST_SPEED = 1e-9  # [m/s] below it the law is singular
CONNECTED = 1e-2  # residual of L⁻¹ a0 = 1: of order 1 if cut off, ‖L⁻¹‖ times rounding else

Time = Float[Array, ""]


class Plan(NamedTuple):
    """What the compiled program is shaped by: hashable, a new one compiles anew."""

    outputs: int  # output times after t = 0
    ticks: int  # intervals from one output time to the next
    in_field: bool  # decide inside the vector field (tick: 0) instead of once an interval
    solver: str
    save: tuple[str, ...]  # what is stacked over output times, of SERIES


class Clock(NamedTuple):
    """When things happen, as numbers of a lane."""

    interval: Float[Array, ""]  # [s] from tick to tick
    tail_outputs: Int[Array, ""]  # how many of the last output times stand for t → ∞


class Held(NamedTuple):
    """What a tick decided and the vehicles hold until the next."""

    weights: Float[Array, "m sources"]
    laplacian_inverse: Float[Array, "m m"]


class Fleet(NamedTuple):
    """A lane under way."""

    stepper: stepper.Stepper
    held: Held
    memory: Any
    switches: Int[Array, ""]


class Outcome(NamedTuple):
    """What is left of a lane. `series` has a leading axis over output times, t = 0 included."""

    status: Code
    metrics: Metrics
    steps: Int[Array, ""]
    switches: Int[Array, ""]
    series: dict[str, Any]


SERIES = {
    "tracking": Observation.tracking,
    "disagreement": Observation.disagreement,
    "state": lambda seen: seen.state,
    "attack": lambda seen: seen.attack,
    "kept": lambda seen: seen.kept,
}


def simulate(lane: Lane, clock: Clock, tolerances: stepper.Tolerances, plan: Plan) -> Outcome:
    """One lane from 0 to the horizon."""

    def tick(fleet: Fleet, n: Int[Array, ""]) -> tuple[Fleet, None]:
        before = n.astype(float) * clock.interval
        after = (n + 1).astype(float) * clock.interval
        moved = stepper.advance(
            vector_field(plan.in_field),
            plan.solver,
            fleet.stepper,
            before,
            after,
            (lane, fleet.held),
            tolerances,
            moving,
            n + 1 == plan.outputs * plan.ticks,
        )
        return decide(lane, fleet._replace(stepper=moved), after, plan), None

    def output(carry: tuple[Fleet, Metrics], number: Int[Array, ""]):
        fleet, metrics = carry
        ticks = (number - 1) * plan.ticks + jnp.arange(plan.ticks)
        fleet, _ = jax.lax.scan(tick, fleet, ticks)
        metrics, saved = measure(fleet, metrics, number)
        return (fleet, metrics), saved

    def measure(fleet: Fleet, metrics: Metrics, number: Int[Array, ""]):
        t = (number * plan.ticks).astype(float) * clock.interval
        seen = observe(lane, fleet, t)
        in_tail = number > plan.outputs - clock.tail_outputs
        ok = fleet.stepper.status == Status.ok
        saved = {name: jnp.where(ok, SERIES[name](seen), jnp.nan) for name in plan.save}
        return metrics.gather(seen, in_tail, clock.tail_outputs), saved

    fleet = start(lane, clock, tolerances, plan)
    metrics, first = measure(fleet, Metrics.start(), jnp.asarray(0))
    (fleet, metrics), rest = jax.lax.scan(output, (fleet, metrics), jnp.arange(1, plan.outputs + 1))
    status = fleet.stepper.status
    series = jax.tree.map(lambda one, more: jnp.concatenate([one[None], more]), first, rest)
    return Outcome(
        status,
        metrics.blank_unless(status == Status.ok),
        fleet.stepper.steps,
        fleet.switches,
        series,
    )


def start(lane: Lane, clock: Clock, tolerances: stepper.Tolerances, plan: Plan) -> Fleet:
    """The lane at t = 0 with its first decision taken."""
    zero = jnp.zeros(())
    held, memory, connected = choose(lane, lane.defence.start(), lane.initial, zero)
    first = stepper.start(
        vector_field(plan.in_field),
        plan.solver,
        lane.initial,
        (lane, held),
        tolerances,
        clock.interval,
    )
    status = fail(first.status, Status.singular, ~moving(lane.initial))
    status = fail(status, Status.nonfinite, ~jnp.isfinite(lane.initial).all())
    status = fail(status, Status.disconnected, ~connected)
    return Fleet(first._replace(status=status), held, memory, jnp.asarray(0))


def decide(lane: Lane, fleet: Fleet, t: Time, plan: Plan) -> Fleet:
    """Hear, decide whom to keep, and count the vehicles that changed their mind."""
    ok = fleet.stepper.status == Status.ok
    memory = lane.defence.start() if plan.in_field else fleet.memory
    held, memory, connected = choose(lane, memory, fleet.stepper.state, t)
    changed = ((held.weights > 0) != (fleet.held.weights > 0)).any(axis=1).sum()
    status = fail(fleet.stepper.status, Status.disconnected, ~connected)
    return Fleet(
        fleet.stepper._replace(status=status),
        held,
        memory,
        fleet.switches + jnp.where(ok, changed, 0),
    )


def choose(lane: Lane, memory: Any, state: robot.State, t: Time) -> tuple[Held, Any, Bool[Array, ""]]:
    """The weights in force for what is heard now, the new memory, and whether all are reached."""
    sources = jnp.concatenate([lane.navigator.jets(t)[:1], state[:, :2]])
    heard = sources[None] + attack.on_links(lane.attack.jets(t)[0], lane.attack.links)
    weights, memory = lane.defence.decide(lane.weights, heard, memory)
    inverse, residual = control.invert_laplacian(weights)
    return Held(weights, inverse), memory, residual < CONNECTED


def vector_field(in_field: bool) -> stepper.VectorField:
    """`ẋ = f(x, u(t, x))` with the weights held, or decided at every evaluation without memory."""

    def field(t: Time, state: robot.State, args: tuple[Lane, Held]) -> robot.State:
        lane, held = args
        if in_field:
            held, _, _ = choose(lane, lane.defence.start(), state, t)
        own = robot.output_jets(state)
        desired = desired_signal(lane, held.weights, own, t)
        jerk = control.desired_jerk(own, desired, held.laplacian_inverse, lane.gain)
        return robot.motion(state, robot.inputs_for(state, jerk))

    return field


def desired_signal(
    lane: Lane, weights: Float[Array, "m sources"], own: control.Own, t: Time
) -> control.Desired:
    """What the vehicles take for their reference at time t, from what they hear."""
    corruption = attack.corruption(lane.attack.jets(t), lane.attack.links, weights)
    return control.desired_signal(own, lane.navigator.jets(t), corruption, weights)


def moving(state: robot.State) -> Bool[Array, ""]:
    """Whether no vehicle stands still; a speed that is not a number is another matter."""
    return ~(jnp.abs(state[:, robot.SPEED]) < LEAST_SPEED).any()


def observe(lane: Lane, fleet: Fleet, t: Time) -> Observation:
    """The fleet as it is measured at time t."""
    return Observation(
        fleet.stepper.state,
        lane.navigator.jets(t)[0],
        lane.attack.jets(t)[0],
        fleet.held.weights,
    )
