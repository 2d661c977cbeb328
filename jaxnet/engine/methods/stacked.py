"""The stacked engine: the paper's program to the letter, stepped by any adaptive solver of diffrax.

One lane is one pure vector field (`lane_field`). Its law solves the dense Kronecker-stacked system
`M u = …` (paper, sections 4.2 and 4.3). Stacked vectors list one vehicle after the other: `ȳ =
[y_1; …; y_m]` and `η_i = [ε_i; ε̇_i; ε̈_i]`. The paper has order 3; vehicles of order r have r
derivatives in η, and r in place of the third derivative. `diffrax.diffeqsolve` steps the field,
under `jax.vmap` over the lanes.

Vehicles decide at ticks which sources to retain, and keep the decision until the next tick. Each
tick is one `diffeqsolve`. With `tick: 0` vehicles decide inside the vector field. The engine is
slow, and shares neither its law nor its stepping with the other engines.
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

from jaxnet.engine import loop, vehicles
from jaxnet.engine.demand import signals
from jaxnet.engine.integration import decided_in_field, drive_along
from jaxnet.engine.loop import InStates
from jaxnet.engine.methods import Engine
from jaxnet.engine.moment import Instants, PerAxis, misusing
from jaxnet.engine.plan import Plan, Tolerances
from jaxnet.engine.stages.coasting import Coasting
from jaxnet.engine.stages.known import Known
from jaxnet.engine.stages.sensing import Sensed
from jaxnet.engine.status import Code, Status, fail
from jaxnet.engine.tick import Drive, Strength
from jaxnet.kinds.fields import Number, Positive, Within
from jaxnet.model import control, signal
from jaxnet.model.control import Gain, is_matrix
from jaxnet.model.lane import Lane, Network

LEAST_STEP = 4 * 2.0**-52  # over the time, at least 1 s: a smaller step does not move the time
# Diffrax's adaptive solvers that need only a vector field to choose their steps, by lower name.
SOLVERS_OF_DIFFRAX = {
    name.lower(): name
    for name, found in vars(diffrax).items()
    if inspect.isclass(found)
    and issubclass(found, diffrax.AbstractAdaptiveSolver)
    and not name.startswith("Abstract")
    and getattr(found, "term_structure", None) is diffrax.AbstractTerm
}

StateOfOne = Float[Array, "n m"]  # of one lane
Instant = Float[Array, ""]


def known_solver(name: str) -> str:
    """The name of a solver; raise ValueError with the allowed names if there is none."""
    if name in SOLVERS_OF_DIFFRAX.values():
        return name
    near = difflib.get_close_matches(name.lower(), SOLVERS_OF_DIFFRAX, n=1)
    hint = f" (did you mean '{SOLVERS_OF_DIFFRAX[near[0]]}'?)" if near else ""
    allowed = ", ".join(SOLVERS_OF_DIFFRAX.values())
    raise ValueError(f"must be an adaptive ODE solver of diffrax: {allowed}{hint}")


class Stacked(Engine):
    """The nonlinear vehicles under the stacked law, stepped by diffrax."""

    chunk: ClassVar[int] = 16
    shard: ClassVar[int] = 16
    in_field: ClassVar[bool] = True
    stops: ClassVar[bool] = False

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

    def options(self):
        return self.solver, self.max_steps

    def numbers(self, draw, gain, interval):
        """The tolerances, and the most steps that a lane may take in all."""
        rtol, atol = draw.one(self.rtol, "engine.rtol"), draw.one(self.atol, "engine.atol")
        return Tolerances(rtol, atol, draw.same(self.max_steps))

    @staticmethod
    def simulate(queue, count, network, clock, plan):
        """Advance all lanes in lockstep (`ByDiffrax`); lanes from `count` on are padding."""
        return loop.in_lockstep(ByDiffrax, queue, network, clock, plan)


class StackedState(NamedTuple):
    """State of lanes at a tick."""

    states: Float[Array, "n m lanes"]
    time: Instants
    steps: Int[Array, " lanes"]
    rest: None = None  # vehicles do not stop


class FieldInputs(NamedTuple):
    """Arguments of one lane's vector field besides time and state; no leaf has an axis of lanes."""

    lane: Lane
    drive: Drive  # until the next tick; with `tick: 0` its weights are decided in the field


def undisturbed(lane: Lane) -> FieldInputs:
    """Arguments of the vector field of one lane in which nothing happens at ticks."""
    rest = Sensed(), Coasting(), Strength(), Known()
    return FieldInputs(lane, Drive(lane.weights[None], lane.vectors, *rest))


def with_lane_axis(tree: Any) -> Any:
    """One lane as the last axis, which kinds need."""
    return jax.tree.map(lambda leaf: leaf[..., None], tree)


class ByDiffrax(InStates):
    """Motion of lanes under the stacked law: diffrax solves each lane from tick to tick."""

    def begin(self):
        zero = jnp.zeros_like(self.lane.attack_scale)
        return StackedState(vehicles.first_states(self.lane), zero, jnp.zeros(zero.shape, int))

    def basis(self, state):
        return state.time, self.lane.basis(state.time)

    def steps(self, state):
        return state.steps

    def hold(self, state, decided, at):
        """The state unchanged, and the lanes in which a vehicle is cut off and does not coast."""
        return state, decided.disconnected(self.lane, self.network)

    def drive_now(self, state, decided):
        """`y‴ + P(ŷ)`, with y‴ of the vector field."""
        field = functools.partial(lane_field, network=self.network, plan=self.plan)
        followed = FieldInputs(self.lane, self.drive(state, decided))
        slope = jax.vmap(field, -1, -1)(state.time, state.states, followed)
        return drive_along(self.lane, state.states, slope, state.time, decided)

    def advance(self, state, decided, ticks, status):
        """The state at the next tick; a lane that has failed stays where it is."""
        tolerances, clock = self.numbers, self.clock
        ok = status == Status.ok
        end = jnp.where(ok, jnp.broadcast_to(clock.at(ticks + 1), state.time.shape), state.time)
        solve = functools.partial(solution, network=self.network, plan=self.plan)
        followed = FieldInputs(self.lane, self.drive(state, decided))
        moved, steps, reason = jax.vmap(solve, -1, -1)(
            followed, tolerances, state.time, end, state.states
        )
        steps, last = state.steps + steps, clock.outputs * clock.ticks
        status = jnp.where(ok, reason, status)
        needed = steps + (ticks + 1 < last).astype(int)  # a tick takes one step at least
        status = fail(status, Status.max_steps, needed > tolerances.max_steps)
        return StackedState(moved, end, steps), status, ok


class Controller(diffrax.PIDController):
    """Diffrax's PID controller with other reasons to fail."""

    def adapt_step_size(
        self, t0, t1, y0, y1_candidate, args, y_error: Any, error_order, controller_state
    ) -> Any:
        """Adapt the step, and name the failure of a step too small to move the time.

        The failure is `max_steps_reached` where state and error are finite, else `dt_min_reached`.
        """
        *found, result = super().adapt_step_size(
            t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state
        )
        results = diffrax.RESULTS
        finite = jnp.isfinite(y1_candidate).all() & jnp.isfinite(y_error).all()
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
    """One lane's state at the end of a tick, the steps it took, and its status.

    The whole tick is the first step: guessing one would fail where the field does.
    """
    solver, max_steps = plan.options

    def field(time: Any, state: StateOfOne, followed: FieldInputs) -> StateOfOne:
        return lane_field(time, state, followed, network, plan)

    def stands(
        time: Instant, state: StateOfOne, followed: FieldInputs, **_: object
    ) -> Bool[Array, ""]:
        lane, there, drive = with_lane_axis((followed.lane, state, followed.drive))
        return vehicles.passed_singular(lane, there, drive.coasting.may_stop(lane)).any()

    shortest = LEAST_STEP * jnp.maximum(end, 1.0)
    controller = Controller(tolerances.rtol, tolerances.atol, dtmin=shortest, force_dtmin=False)
    found = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        getattr(diffrax, solver)(),
        begin,
        end,
        end - begin,
        state,
        followed,
        stepsize_controller=controller,
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
    lane, there, now, drive = with_lane_axis((followed.lane, state, time, followed.drive))
    frozen = drive.coasting.frozen(lane)
    if plan.in_field:
        chosen = decided_in_field(lane, network, signals(lane, now), there, plan).drive(lane)
        drive = drive._replace(weights=chosen.weights, strength=chosen.strength)
    hearing, weights, order = network.hearing, drive.weights, len(lane.gain)
    navigator, attack = lane.path(now), signal.jets(drive.vectors, lane.basis(now))
    own = drive.sensed.of(vehicles.outputs(lane, there, now))

    def received(weights: Any, sent: PerAxis, k: int) -> PerAxis:
        sources = jnp.concatenate([navigator[k][:, None], sent], axis=1)
        return hearing.mean(weights, sources, attack[k])

    error = jnp.stack([jet - received(weights, jet, k) for k, jet in enumerate(own)])
    graph, strength = jax.vmap(hearing.matrix)(weights), drive.strength.rows(weights)
    direct = weights
    if not lane.law.couples():  # only the navigator tells its r-th derivative
        graph = jnp.zeros_like(graph)
        heeded = lane.law.heeds_highest(hearing.sources)
        direct = jnp.where(heeded[None, ..., None], weights, 0.0)
        silent = drive.known.silent((weights == 0).all(axis=1))
        error = jnp.where(silent[None], 0.0, error)
    highest = drive.known.plus(received(direct, jnp.zeros_like(own[0]), order), now)
    if lane.gain_apart is not None:
        highest = highest - (lane.gain_apart[:, None] * error).sum(axis=0)
    psi = lane.vehicle.decoupling(there)  # singular at rest
    decoupling = jnp.where(frozen[None, None], jnp.eye(2)[..., None, None], psi)
    given = (
        vehicles.drift(lane, there, now),
        decoupling,
        graph,
        control.damped(strength * highest, lane.damping, own),
        strength[None] * error,
    )
    if (taken := lane.inputs(now)) is not None:
        obeys = ~misusing(drive.vectors)
        asked = signal.combined(drive.vectors, taken)
        given = (*given[:3], jnp.where(obeys, given[3], asked), jnp.where(obeys, given[4], 0.0))
    inputs = stacked_inputs(*(each[..., 0] for each in (*given, lane.gain)))
    rates = vehicles.rates(lane, there, inputs[..., None], now)
    return jnp.where(frozen[None], 0.0, rates)[..., 0]


def stacked_inputs(
    drift: Float[Array, "2 m"],
    decoupling: Float[Array, "2 2 m"],
    weights: Float[Array, "axes m sources"],
    highest: Float[Array, "2 m"],
    error: Float[Array, "r 2 m"],
    gain: Gain,
) -> Float[Array, "2 m"]:
    """Solve `M u = Ψ⁻¹ [-σ + (A ⊗ I₂) σ + a0 ⊗ y_0^(r) + d^(r) + K η]` for the inputs u.

    `M = Ψ⁻¹ (I - A ⊗ I₂) Ψ`, `Ψ = diag{ψ_1, …, ψ_m}`, and `K = -I_m ⊗ [k0 I₂, k1 I₂, …]`. `drift`
    is σ of each vehicle, `decoupling` is ψ, `highest` is `a0 ⊗ y_0^(r) + d^(r)`, and `error` holds
    the jets ε, ε̇, …. Where rules decide by axis, A has another matrix on each axis.
    """
    m = drift.shape[1]
    by_axis = jnp.broadcast_to(weights[..., 1:], (2, m, m))
    laplacian = jnp.eye(2 * m) - jnp.einsum("aij,ab->iajb", by_axis, jnp.eye(2)).reshape(2 * m, -1)
    psi = jax.scipy.linalg.block_diag(*jnp.moveaxis(decoupling, 2, 0))
    row = jnp.concatenate(gain, axis=1) if is_matrix(gain) else jnp.kron(gain[None], jnp.eye(2))
    eta, sigma = error.transpose(2, 0, 1).reshape(-1), drift.T.reshape(-1)
    demand = highest.T.reshape(-1) - laplacian @ sigma - jnp.kron(jnp.eye(m), row) @ eta
    mixing = jnp.linalg.solve(psi, laplacian @ psi)
    return jnp.linalg.solve(mixing, jnp.linalg.solve(psi, demand)).reshape(m, 2).T
