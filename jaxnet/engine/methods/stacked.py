"""The stacked engine: the paper's program to the letter, stepped by any adaptive solver of diffrax.

One lane is one pure vector field (`lane_field`). Its law solves the dense Kronecker-stacked system
`M u = …` (`model.definition`; paper, sections 4.2 and 4.3). `diffrax.diffeqsolve` steps the field,
under `jax.vmap` over the lanes.

Vehicles decide at ticks which sources to retain, and keep the decision until the next tick. Each
tick is one `diffeqsolve`. With `tick: 0` vehicles decide inside the vector field. The engine is
slow, and shares neither its law nor its stepping with the other engines.
"""

import difflib
import functools
import inspect
from collections.abc import Hashable
from typing import Annotated, Any, ClassVar, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int
from pydantic import AfterValidator, Field

from jaxnet.engine import loop, vehicles
from jaxnet.engine.demand import signals
from jaxnet.engine.integration import decided_in_field, drive_along
from jaxnet.engine.loop import Motion, Tick, Ticks
from jaxnet.engine.methods import Engine, LaneCount, LaneGainRows
from jaxnet.engine.moment import Instants, LaneFlags, VehicleFlags
from jaxnet.engine.plan import Clock, Inputs, Outcome, Plan, Tolerances
from jaxnet.engine.stages.coasting import coasts
from jaxnet.engine.stages.known import Known
from jaxnet.engine.stages.sensing import Sensed
from jaxnet.engine.status import Code, Status, fail
from jaxnet.engine.tick import DecisionState
from jaxnet.engine.vehicles import States
from jaxnet.kinds.fields import Number, Positive, Within
from jaxnet.kinds.protocols import LaneDraw
from jaxnet.model import definition, plane, signal
from jaxnet.model.hearing import Hearing
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Basis

LEAST_STEP = 4 * 2.0**-52  # over the time, at least 1 s: a smaller step does not move the time

StateOfOne = Float[Array, "n m"]  # of one lane
Instant = Float[Array, ""]


def solvers() -> list[str]:
    """The names of diffrax's adaptive solvers for ordinary differential equations."""
    return [name for name, found in vars(diffrax).items() if inspect.isclass(found) and fits(found)]


def fits(found: type) -> bool:
    """Whether a class is a solver that needs only a vector field to choose its steps."""
    if not issubclass(found, diffrax.AbstractAdaptiveSolver) or found.__name__.startswith(
        "Abstract"
    ):
        return False
    return getattr(found, "term_structure", None) is diffrax.AbstractTerm


def known_solver(name: str) -> str:
    """The name if `solvers` contains it. Raises ValueError with the allowed names if not."""
    known = {each.lower(): each for each in solvers()}
    if name in known.values():
        return name
    near = difflib.get_close_matches(name.lower(), known, n=1)
    hint = f" (did you mean '{known[near[0]]}'?)" if near else ""
    raise ValueError(
        f"must be an adaptive ODE solver of diffrax: {', '.join(known.values())}{hint}"
    )


class Stacked(Engine):
    """The nonlinear vehicles under the stacked law, stepped by diffrax."""

    kind = "stacked"
    chunk: ClassVar[int] = 16
    shard: ClassVar[int] = 16
    in_field: ClassVar[bool] = True

    solver: Annotated[str, AfterValidator(known_solver)] = Field(
        default="Dopri5",
        description="a class of diffrax, an adaptive ODE solver: Tsit5, Dopri8, Kvaerno5, …",
    )
    rtol: Annotated[Number, Within(gt=0.0, lt=1.0)] = Field(
        default=1e-7, description="relative, of a step"
    )
    atol: Positive = Field(default=1e-9, description="absolute, of a step")
    max_steps: int = Field(
        default=100_000, ge=1, le=10**9, description="of a lane, refused ones included"
    )

    def options(self) -> tuple[Hashable, ...]:
        return self.solver, self.max_steps

    def numbers(self, draw: LaneDraw, gain: LaneGainRows, interval: float) -> Tolerances:
        """The tolerances, and the most steps that a lane may take in all."""
        rtol, atol = draw.one(self.rtol, "engine.rtol"), draw.one(self.atol, "engine.atol")
        return Tolerances(rtol, atol, draw.same(self.max_steps))

    @staticmethod
    def simulate(
        queue: Inputs, count: LaneCount, network: Network, clock: Clock, plan: Plan
    ) -> Outcome:
        """Advance all lanes in lockstep (`ByDiffrax`); lanes from `count` on are padding."""
        return loop.in_lockstep(ByDiffrax, queue, network, clock, plan)


class StackedState(NamedTuple):
    """State of lanes at a tick."""

    state: Float[Array, "n m lanes"]
    time: Instants
    steps: Int[Array, " lanes"]


class FieldInputs(NamedTuple):
    """Arguments of one lane's vector field besides time and state; no leaf has an axis of lanes."""

    lane: Lane
    weights: Float[Array, "axes slots m"]  # until the next tick, unless decided in the field
    vectors: Float[Array, "2 m functions"]  # of the attacks
    sensed: Sensed
    known: Known
    strength: Float[Array, "axes m"]  # of the rows of weights
    frozen: Bool[Array, " m"]  # vehicles that stop, or will before the next tick
    may_stop: Bool[Array, " m"]  # vehicles that are cut off, and stop where they come to rest


def undisturbed(lane: Lane) -> FieldInputs:
    """Arguments of the vector field of one lane in which nothing happens at ticks."""
    nobody = jnp.zeros(lane.weights.shape[1], bool)
    strength = jnp.ones((1, len(nobody)))
    rest = Sensed(), Known(), strength, nobody, nobody
    return FieldInputs(lane, lane.weights[None], lane.vectors, *rest)


class ByDiffrax(Motion[StackedState]):
    """Motion of lanes under the stacked law: diffrax solves each lane from tick to tick."""

    def begin(self) -> StackedState:
        zero = jnp.zeros_like(self.lane.attack_scale)
        return StackedState(self.lane.initial, zero, jnp.zeros(zero.shape, int))

    def errors(self, state: StackedState) -> Jets:
        own = vehicles.outputs(self.lane, state.state, state.time)
        return plane.relative(own, self.lane.path(state.time))

    def basis(self, state: StackedState) -> tuple[Instants, Basis]:
        return state.time, self.lane.basis(state.time)

    def states(self, state: StackedState) -> States:
        return state.state

    def placed(self, state: StackedState, which: VehicleFlags, states: States) -> StackedState:
        return state._replace(state=jnp.where(which[None], states, state.state))

    def steps(self, state: StackedState) -> Int[Array, " lanes"]:
        return state.steps

    def hold(
        self, state: StackedState, decided: DecisionState, at: Tick
    ) -> tuple[StackedState, LaneFlags]:
        """The state unchanged, and the lanes in which a vehicle is cut off and does not coast."""
        if not self.lane.law.couples() or coasts(self.lane) or self.lane.turns is not None:
            return state, jnp.zeros_like(at.here)
        weights = decided.judged.in_force(decided.of(self.lane))
        reached = jax.vmap(lambda each: reaches_everybody(self.network.hearing, each), -1, -1)(
            weights
        )
        return state, ~reached

    def drive_now(self, state: StackedState, decided: DecisionState) -> Float[Array, "2 m lanes"]:
        """`y‴ + P(ŷ)`, with y‴ of the vector field."""
        field = functools.partial(lane_field, network=self.network, plan=self.plan)
        slope = jax.vmap(field, -1, -1)(state.time, state.state, self.followed(state, decided))
        return drive_along(self.lane, state.state, slope, state.time, decided)

    def followed(self, state: StackedState, decided: DecisionState) -> FieldInputs:
        """The arguments of the lanes' vector fields until the next tick; lanes last."""
        drive = self.drive(state, decided)
        strength, kept = drive.strength.rows(drive.weights), decided.coasting
        inputs = self.lane, drive.weights, drive.vectors, drive.sensed, drive.known, strength
        return FieldInputs(*inputs, kept.frozen(self.lane), kept.may_stop(self.lane))

    def advance(
        self, state: StackedState, decided: DecisionState, ticks: Ticks, status: Code
    ) -> tuple[StackedState, Code, LaneFlags]:
        """The state at the next tick; a lane that has failed stays where it is."""
        tolerances, clock, plan = self.numbers, self.clock, self.plan
        ok = status == Status.ok
        end = jnp.where(ok, jnp.broadcast_to(clock.at(ticks + 1), state.time.shape), state.time)
        solve = functools.partial(solution, network=self.network, plan=plan)
        followed = self.followed(state, decided)
        moved, steps, reason = jax.vmap(solve, -1, -1)(
            followed, tolerances, state.time, end, state.state
        )
        steps, last = state.steps + steps, clock.outputs * clock.ticks
        status = jnp.where(ok, reason, status)
        needed = steps + (ticks + 1 < last).astype(int)  # a tick takes one step at least
        status = fail(status, Status.max_steps, needed > tolerances.max_steps)
        return StackedState(moved, end, steps), status, ok


def reaches_everybody(hearing: Hearing, weights: Float[Array, "axes slots m"]) -> Bool[Array, ""]:
    """Whether the navigator's jets reach every vehicle over these weights, on every axis."""

    def on_axis(each: Float[Array, "slots m"]) -> Bool[Array, " m"]:
        hears = hearing.matrix(each) > 0

        def spread(_: Int[Array, ""] | int, reached: Bool[Array, " m"]) -> Bool[Array, " m"]:
            return reached | (hears[:, 1:] & reached[None]).any(axis=1)

        return jax.lax.fori_loop(0, len(hears), spread, hears[:, 0])

    return jax.vmap(on_axis)(weights).all()


class Controller(diffrax.PIDController):
    """Diffrax's PID controller with another first step and other reasons to fail."""

    def init(
        self,
        terms: Any,
        t0: Any,
        t1: Any,
        y0: Any,
        dt0: Any,
        args: Any,
        func: Any,
        error_order: Any,
    ) -> Any:
        """Begin with the whole tick as a step: guessing one would fail where the field does."""
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
        """Adapt the step, and name the failure of a step too small to move the time.

        The failure is `max_steps_reached` where state and error are finite, else `dt_min_reached`.
        """
        *found, result = super().adapt_step_size(
            t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state
        )
        finite = jnp.isfinite(y1_candidate).all() & jnp.isfinite(y_error).all()
        results = diffrax.RESULTS
        stuck = (result == results.dt_min_reached) & finite
        return (*found, results.where(stuck, results.max_steps_reached, result))


def solution(
    followed: FieldInputs,
    tolerances: Tolerances,
    begin: Instant,
    end: Instant,
    state: StateOfOne,
    network: Network,
    plan: Plan,
) -> tuple[StateOfOne, Int[Array, ""], Code]:
    """One lane's state at the end of a tick, the steps it took, and its status."""
    solver, max_steps = plan.options
    shortest = LEAST_STEP * jnp.maximum(end, 1.0)

    def field(time: Any, state: StateOfOne, followed: FieldInputs) -> StateOfOne:
        return lane_field(time, state, followed, network, plan)

    def stands(
        time: Instant, state: StateOfOne, followed: FieldInputs, **_: object
    ) -> Bool[Array, ""]:
        return vehicles.passed_singular(followed.lane, state, followed.may_stop).any()

    found = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        getattr(diffrax, solver)(),
        begin,
        end,
        None,
        state,
        followed,
        stepsize_controller=Controller(
            tolerances.rtol, tolerances.atol, dtmin=shortest, force_dtmin=False
        ),
        event=diffrax.Event(stands) if followed.lane.vehicle.singular else None,
        max_steps=max_steps,
        throw=False,
    )
    assert found.ys is not None
    result, results = found.result, diffrax.RESULTS
    status = fail(jnp.asarray(0), Status.singular, result == results.event_occurred)
    status = fail(status, Status.max_steps, result == results.max_steps_reached)
    status = fail(status, Status.nonfinite, result != results.successful)
    return found.ys[0], found.stats["num_steps"], status


@functools.partial(jax.jit, static_argnames="plan")
def lane_field(
    time: Instant, state: StateOfOne, followed: FieldInputs, network: Network, plan: Plan
) -> StateOfOne:
    """`ẋ = f(x, u(t, x))` of one lane, with weights held or, with `tick: 0`, decided here."""
    lane, weights, vectors, sensed, known, strength, frozen, _ = followed
    alone, there, now = jax.tree.map(
        lambda leaf: leaf[..., None], (lane, state, time)
    )  # kinds need lanes
    if plan.in_field:
        chosen = decided_in_field(alone, network, signals(alone, now), there, plan)
        drive = chosen.drive(alone)
        weights, strength = drive.weights[..., 0], drive.strength.rows(drive.weights)[..., 0]
    vehicle, navigator = alone.vehicle, alone.path(now)[..., 0]
    attack = jnp.stack(signal.jets(vectors[..., None], alone.basis(now)))[..., 0]
    own = jnp.stack(vehicles.outputs(alone, there, now))[..., 0]
    own = jnp.stack(sensed.of(tuple(own)))
    drift, decoupling = vehicle.drift(there)[..., 0], vehicle.decoupling(there)[..., 0]
    # ψ is singular at rest
    decoupling = jnp.where(frozen[None, None], jnp.eye(2)[..., None], decoupling)

    def law(
        each: Float[Array, "slots m"], strength: Float[Array, " m"], share: Float[Array, " m"]
    ) -> Float[Array, "2 m"]:
        graph, highest, error = jets_of_law(own, navigator, attack, each, network.hearing)
        if not alone.law.couples():
            graph = jnp.zeros_like(graph)
            highest = jets_of_navigator(navigator, attack, each, network.hearing, len(own))
            silent = (each == 0).all(axis=0) & (share == 0)
            error = jnp.where(silent[None, None], 0.0, error)
        highest = known.plus(highest, time)
        if lane.gain_apart is not None:
            highest = highest - (lane.gain_apart[:, None] * error).sum(axis=0)
        highest, error = strength[None] * highest, strength[None, None] * error
        return definition.stacked_inputs(drift, decoupling, graph, highest, error, lane.gain)

    inputs = of_axes(jax.vmap(law)(weights, strength, known.row_share(weights)), decoupling)
    rates = vehicles.input_rates(alone, there, inputs[..., None], now)[..., 0]
    return jnp.where(frozen[None], 0.0, rates)


def jets_of_law(
    own: Float[Array, "r 2 m"],
    navigator: Float[Array, "derivatives 2"],
    attack: Float[Array, "derivatives 2 signals"],
    weights: Float[Array, "slots m"],
    hearing: Hearing,
) -> tuple[Float[Array, "m sources"], Float[Array, "2 m"], Float[Array, "r 2 m"]]:
    """`[a0 | A]`, `a0 ⊗ y_0^(r) + d^(r)` and jets of ε, for received jets and weights by slot."""
    graph, order = hearing.matrix(weights), len(own)
    added = jnp.stack([(weights[None] * hearing.added(jet)).sum(axis=1) for jet in attack])
    sources = jnp.concatenate([navigator[:order, :, None], own], axis=2)
    error = own - sources @ graph.T - added[:order]
    return graph, navigator[order][:, None] * graph[:, 0][None] + added[order], error


def jets_of_navigator(
    navigator: Float[Array, "derivatives 2"],
    attack: Float[Array, "derivatives 2 signals"],
    weights: Float[Array, "slots m"],
    hearing: Hearing,
    order: int,
) -> Float[Array, "2 m"]:
    """`a0 ⊗ y_0^(r)`, with the attack on it, over the links from the navigator alone."""
    weights = jnp.where(hearing.sources == 0, weights, 0.0)
    added = (weights[None] * hearing.added(attack[order])).sum(axis=1)
    return navigator[order][:, None] * weights.sum(axis=0)[None] + added


def of_axes(
    inputs: Float[Array, "axes 2 m"], decoupling: Float[Array, "2 2 m"]
) -> Float[Array, "2 m"]:
    """The input whose r-th derivative on each axis is that of the law with that axis' weights.

    `L ⊗ I₂` keeps axes apart, so the solution with one axis' weights is right on that axis.
    """
    if len(inputs) == 1:
        return inputs[0]
    jerks = jnp.einsum("kim,aim->akm", decoupling, inputs)
    wanted = jnp.stack([jerks[0, 0], jerks[1, 1]])
    return jnp.linalg.solve(jnp.moveaxis(decoupling, 2, 0), wanted.T[..., None])[..., 0].T
