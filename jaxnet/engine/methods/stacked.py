"""The stacked engine: the paper's program to the letter, stepped by any adaptive solver of diffrax.

One lane is one pure vector field (`motion`): its law solves the dense Kronecker-stacked system `M u = …`
(`model.definition`; paper, sections 4.2 and 4.3), and `diffrax.diffeqsolve` steps it, under `jax.vmap` over
the lanes. Whom to retain is decided at ticks and held between them, one `diffeqsolve` each, or, with
`tick: 0`, inside the vector field. It is slow, and shares neither its law nor its stepping with the other
engines.
"""

import difflib
import functools
import inspect
from typing import Annotated, Any, ClassVar, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int
from pydantic import AfterValidator, Field

from jaxnet.engine import metrics
from jaxnet.engine import tick as ticks
from jaxnet.engine.methods import Engine
from jaxnet.engine.metrics import Observation
from jaxnet.engine.plan import Clock, Inputs, Outcome, Plan, Tolerances
from jaxnet.engine.status import LEAST_SPEED, Code, Status, fail
from jaxnet.engine.tick import Mind
from jaxnet.kinds.fields import Number, Positive, Within
from jaxnet.kinds.vehicles import SPEED
from jaxnet.model import definition, signal
from jaxnet.model.hearing import Hearing
from jaxnet.model.lane import Lane, Network

LEAST_STEP = 4 * 2.0**-52  # of the time, or of 1 s if that is more: below it a step no longer moves the time

State = Float[Array, "n m"]


def solvers() -> list[str]:
    """Names of diffrax's solvers that adapt their step and take an ordinary differential equation."""
    return [name for name, found in vars(diffrax).items() if inspect.isclass(found) and fits(found)]


def fits(found: type) -> bool:
    """Whether a class is a solver that needs nothing but a vector field to choose its steps."""
    if not issubclass(found, diffrax.AbstractAdaptiveSolver) or found.__name__.startswith("Abstract"):
        return False
    return getattr(found, "term_structure", None) is diffrax.AbstractTerm


def known_solver(name: str) -> str:
    """The name, if it is one of `solvers`."""
    known = {each.lower(): each for each in solvers()}
    if name in known.values():
        return name
    near = difflib.get_close_matches(name.lower(), known, n=1)
    hint = f" (did you mean '{known[near[0]]}'?)" if near else ""
    raise ValueError(f"must be an adaptive ODE solver of diffrax: {', '.join(known.values())}{hint}")


class Stacked(Engine):
    """The nonlinear vehicles under the stacked law, stepped by diffrax."""

    kind = "stacked"
    chunk: ClassVar[int] = 16
    shard: ClassVar[int] = 16
    in_field: ClassVar[bool] = True

    solver: Annotated[str, AfterValidator(known_solver)] = Field(
        default="Dopri5", description="a class of diffrax, an adaptive ODE solver: Tsit5, Dopri8, Kvaerno5, …"
    )
    rtol: Annotated[Number, Within(gt=0.0, lt=1.0)] = Field(default=1e-7, description="relative, of a step")
    atol: Positive = Field(default=1e-9, description="absolute, of a step")
    max_steps: int = Field(default=100_000, ge=1, le=10**9, description="of a lane, refused ones included")

    def options(self) -> tuple[Any, ...]:
        """The solver, and the steps that it may take in one tick."""
        return self.solver, self.max_steps

    def numbers(self, draw: Any, gain: Any, interval: float) -> Tolerances:
        """The tolerances, and the steps that it may take in all."""
        rtol, atol = draw.one(self.rtol, "engine.rtol"), draw.one(self.atol, "engine.atol")
        return Tolerances(rtol, atol, draw.same(self.max_steps))

    @staticmethod
    def simulate(queue: Any, count: Any, network: Any, clock: Any, plan: Any) -> Outcome:
        """See `simulate`; what stands after the first `count` lanes is filling."""
        return simulate(queue, network, clock, plan)


class Fleet(NamedTuple):
    """Lanes at a tick whose decision is taken."""

    state: Float[Array, "n m lanes"]
    mind: Mind
    steps: Int[Array, " lanes"]
    switches: Int[Array, " lanes"]
    status: Code


class Held(NamedTuple):
    """What one lane's vector field takes besides time and state; no leaf has an axis over lanes."""

    lane: Lane
    weights: Float[Array, "axes slots m"]  # in force until the next tick, unless decided in the field
    vectors: Float[Array, "2 m functions"]  # of the attacks


def simulate(inputs: Inputs, network: Network, clock: Clock, plan: Plan) -> Outcome:
    """Lanes from 0 to the horizon, all side by side."""
    lane, _ = inputs

    def advance(n: Int[Array, ""], fleet: Fleet) -> Fleet:
        return decide(move(fleet, n, inputs, network, clock, plan), n + 1, lane, network, clock, plan)

    def output(number: Int[Array, ""], carry: Any) -> Any:
        fleet, gathered, series = carry
        now = number * clock.ticks
        seen, ok = observe(fleet, now, lane, network, clock, plan), fleet.status == Status.ok
        series = {
            name: series[name].at[number].set(jnp.where(ok, value, jnp.nan))
            for name, value in ticks.series(plan, seen).items()
        }
        gathered = metrics.add(plan.metrics, gathered, seen, ok, clock.in_tail(number))
        end = jnp.where(number < clock.outputs, now + clock.ticks, now)
        return jax.lax.fori_loop(now, end, advance, fleet), gathered, series

    zero = jnp.asarray(0)
    fleet = start(lane, network, clock, plan)
    series = ticks.room(plan, lambda: observe(fleet, zero, lane, network, clock, plan))
    carry = fleet, metrics.nothing(plan.metrics, lane.initial.shape[1:]), series
    fleet, gathered, series = jax.lax.fori_loop(zero, clock.outputs + 1, output, carry)
    status = fail(fleet.status, Status.nonfinite, ~metrics.finite(gathered))
    found = metrics.of_fleet(plan.metrics, gathered, clock.outputs, clock.tail_outputs, status == Status.ok)
    return Outcome(status, found, fleet.steps, fleet.switches, series)


def start(lane: Lane, network: Network, clock: Clock, plan: Plan) -> Fleet:
    """The lanes at t = 0 with their first decision taken, which is no switch."""
    status = ticks.status_at_start(lane)
    none = jnp.zeros_like(status)
    fleet = Fleet(lane.initial, ticks.begin(lane, network, plan), none, none, status)
    return decide(fleet, jnp.asarray(0), lane, network, clock, plan)._replace(switches=none)


def times(number: Any, lane: Lane, clock: Clock) -> Float[Array, " lanes"]:
    """When the tick of this number is, in each lane."""
    return jnp.broadcast_to(clock.at(number), lane.amplitude.shape)


def decide(fleet: Fleet, number: Any, lane: Lane, network: Network, clock: Clock, plan: Plan) -> Fleet:
    """The fleets after the decision at this tick; those that cut a vehicle off have failed."""
    before = ticks.begin(lane, network, plan) if plan.in_field else fleet.mind
    mind = received_and_decided(before, times(number, lane, clock), fleet.state, lane, network, plan)
    ok, switched = fleet.status == Status.ok, ticks.changed(mind, fleet.mind, lane)[1]
    weights = ticks.weights_of(lane, mind, plan)
    connected = jax.vmap(lambda each: reaches_everybody(network.hearing, each), -1, -1)(weights)
    return fleet._replace(
        mind=mind,
        switches=fleet.switches + jnp.where(ok, switched.sum(axis=0), 0),
        status=fail(fleet.status, Status.disconnected, ~connected),
    )


def received_and_decided(
    before: Mind, time: Any, state: Any, lane: Lane, network: Network, plan: Plan
) -> Mind:
    """What is decided for what is received of lanes in these states, lanes last."""
    own, navigator = lane.vehicle.output_jets(state), lane.navigator.jets(time)
    errors = tuple(jet - there[:, None] for jet, there in zip(own, navigator, strict=False))
    return ticks.decide(lane, network, plan, before, errors, lane.signal.basis(time), time)


def reaches_everybody(hearing: Hearing, weights: Float[Array, "axes slots m"]) -> Bool[Array, ""]:
    """Whether the navigator's word reaches every vehicle over these weights, on every axis."""

    def on_axis(each: Any) -> Any:
        hears = hearing.matrix(each) > 0

        def spread(_: Any, reached: Any) -> Any:
            return reached | (hears[:, 1:] & reached[None]).any(axis=1)

        return jax.lax.fori_loop(0, len(hears), spread, hears[:, 0])

    return jax.vmap(on_axis)(weights).all()


def move(fleet: Fleet, number: Any, inputs: Inputs, network: Network, clock: Clock, plan: Plan) -> Fleet:
    """The fleets at the next tick; a lane that has failed stays where it is."""
    lane, tolerances = inputs
    begin, ok = times(number, lane, clock), fleet.status == Status.ok
    end = jnp.where(ok, times(number + 1, lane, clock), begin)
    held = Held(lane, ticks.weights_of(lane, fleet.mind, plan), ticks.vectors_of(lane, fleet.mind))
    solve = functools.partial(solved, network=network, plan=plan)
    state, steps, reason = jax.vmap(solve, -1, -1)(held, tolerances, begin, end, fleet.state)
    steps, last = fleet.steps + steps, clock.outputs * clock.ticks
    status = jnp.where(ok, reason, fleet.status)
    needed = steps + (number + 1 < last).astype(int)  # a tick takes one step at least
    status = fail(status, Status.max_steps, needed > tolerances.max_steps)
    return fleet._replace(state=state, steps=steps, status=status)


class Controller(diffrax.PIDController):
    """Diffrax's, but for where it begins and how it gives up."""

    def init(
        self, terms: Any, t0: Any, t1: Any, y0: Any, dt0: Any, args: Any, func: Any, error_order: Any
    ) -> Any:
        """Try the whole tick first: a guess would fail where the vector field does."""
        return super().init(terms, t0, t1, y0, t1 - t0, args, func, error_order)

    def adapt_step_size(
        self,
        t0: Any,
        t1: Any,
        y0: Any,
        y1_candidate: Any,
        args: Any,
        y_error: Any,
        error_order: Any,
        controller_state: Any,
    ) -> Any:
        """Call a finite step too small to move the time `max_steps_reached`, one that is not finite
        `dt_min_reached`.
        """
        *found, result = super().adapt_step_size(
            t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state
        )
        finite = jnp.isfinite(y1_candidate).all() & jnp.isfinite(y_error).all()
        results = diffrax.RESULTS
        stuck = (result == results.dt_min_reached) & finite
        return (*found, results.where(stuck, results.max_steps_reached, result))


def solved(
    held: Held, tolerances: Tolerances, begin: Any, end: Any, state: State, network: Network, plan: Plan
) -> tuple[State, Any, Any]:
    """One lane's state at the end of a tick, the steps it took, and its status."""
    solver, max_steps = plan.options
    shortest = LEAST_STEP * jnp.maximum(end, 1.0)

    def field(time: Any, state: State, held: Held) -> State:
        return motion(time, state, held, network, plan)

    def stands(time: Any, state: State, held: Held, **_: Any) -> Any:
        return (state[SPEED] * jnp.sign(held.lane.initial[SPEED]) < LEAST_SPEED).any()

    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        getattr(diffrax, solver)(),
        begin,
        end,
        None,
        state,
        held,
        stepsize_controller=Controller(tolerances.rtol, tolerances.atol, dtmin=shortest, force_dtmin=False),
        event=diffrax.Event(stands),
        max_steps=max_steps,
        throw=False,
    )
    assert solution.ys is not None
    result, results = solution.result, diffrax.RESULTS
    status = fail(jnp.asarray(0), Status.singular, result == results.event_occurred)
    status = fail(status, Status.max_steps, result == results.max_steps_reached)
    status = fail(status, Status.nonfinite, result != results.successful)
    return solution.ys[0], solution.stats["num_steps"], status


@functools.partial(jax.jit, static_argnames="plan")
def motion(time: Any, state: State, held: Held, network: Network, plan: Plan) -> State:
    """`ẋ = f(x, u(t, x))` of one lane, with the weights held or, with `tick: 0`, decided here."""
    lane, weights, vectors = held
    alone, there, now = jax.tree.map(lambda leaf: leaf[..., None], (lane, state, time))  # kinds take lanes
    if plan.in_field:
        mind = received_and_decided(ticks.begin(alone, network, plan), now, there, alone, network, plan)
        weights = ticks.weights_of(alone, mind, plan)[..., 0]
    vehicle, navigator = alone.vehicle, alone.navigator.jets(now)[..., 0]
    attack = jnp.stack(signal.jets(vectors[..., None], alone.signal.basis(now)))[..., 0]
    own = jnp.stack(vehicle.output_jets(there))[..., 0]
    drift, decoupling = vehicle.drift(there)[..., 0], vehicle.decoupling(there)[..., 0]

    def law(each: Float[Array, "slots m"]) -> Float[Array, "2 m"]:
        graph, third, error = feedback(own, navigator, attack, each, network.hearing)
        return definition.inputs(drift, decoupling, graph, third, error, lane.gain)

    inputs = of_axes(jax.vmap(law)(weights), decoupling)
    return vehicle.motion(there, inputs[..., None])[..., 0]


def feedback(
    own: Float[Array, "3 2 m"],
    navigator: Float[Array, "4 2"],
    attack: Float[Array, "4 2 m"],
    weights: Float[Array, "slots m"],
    hearing: Hearing,
) -> tuple[Float[Array, "m sources"], Float[Array, "2 m"], Float[Array, "3 2 m"]]:
    """`[a0 | A]`, `a0 ⊗ y_0‴ + d‴`, and the jets of ε, for what is received with weights by slot."""
    graph = hearing.matrix(weights)
    added = jnp.stack([(weights[None] * hearing.added(jet)).sum(axis=1) for jet in attack])
    sources = jnp.concatenate([navigator[:3, :, None], own], axis=2)
    error = own - sources @ graph.T - added[:3]
    return graph, navigator[3][:, None] * graph[:, 0][None] + added[3], error


def of_axes(inputs: Float[Array, "axes 2 m"], decoupling: Float[Array, "2 2 m"]) -> Float[Array, "2 m"]:
    """The input that has on each axis the jerk that the law with that axis' weights asks for.

    For `L ⊗ I₂` keeps axes apart: what is solved with one axis' weights is right on that axis.
    """
    if len(inputs) == 1:
        return inputs[0]
    jerks = jnp.einsum("kim,aim->akm", decoupling, inputs)
    wanted = jnp.stack([jerks[0, 0], jerks[1, 1]])
    return jnp.linalg.solve(jnp.moveaxis(decoupling, 2, 0), wanted.T[..., None])[..., 0].T


def observe(fleet: Fleet, number: Any, lane: Lane, network: Network, clock: Clock, plan: Plan) -> Observation:
    """The fleets as they are measured at this tick."""
    now = times(number, lane, clock)
    speed, turn_rate = lane.vehicle.pace(fleet.state)
    return Observation(
        fleet.state[:2] - lane.navigator.jets(now)[0][:, None],
        speed,
        turn_rate,
        fleet.state,
        signal.combined(ticks.vectors_of(lane, fleet.mind)[:, network.shown], lane.signal.basis(now)[0]),
        ticks.weights_of(lane, fleet.mind, plan),
        network.hearing,
    )
