"""The law that nonlinear vehicles follow from tick to tick, evaluated from the received jets.

`Followed` has a subclass for each other way in which vehicles follow a law. `Following` is the base
of the two ways to integrate the vehicles: `Collocation` and `Integration`.
"""

from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxnet.engine import tick, vehicles
from jaxnet.engine.demand import Signals, coupled_demand, exchange, local_jerk
from jaxnet.engine.loop import Motion
from jaxnet.engine.moment import LaneFlags, PerAxis
from jaxnet.engine.plan import CONNECTED
from jaxnet.engine.stages.known import Known, KnownDrive
from jaxnet.engine.subset import LaneIndices, for_each, picked, put
from jaxnet.engine.tick import DecisionState, Drive, Strength
from jaxnet.engine.vehicles import States
from jaxnet.model import control, linearised, signal
from jaxnet.model.hearing import AxisWeights
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Vectors
from jaxnet.solvers.choice import factorised_at_once

FollowingState = TypeVar("FollowingState", bound=Any)  # has the fields signals, followed and steps


class Scene(NamedTuple):
    """Lanes that follow a law, and the signals of an instant."""

    lane: Lane
    network: Network
    decided: DecisionState
    now: Signals

    def outputs(self, states: States) -> Jets:
        return vehicles.outputs(self.lane, states, self.now.time)

    def sensed(self, own: Jets) -> Jets:
        return self.decided.sensed.of(own)

    def lies(self) -> PerAxis:
        """What vehicles tell of their places beside the truth; nothing if the navigator's lie."""
        hearing, vectors = self.network.hearing, self.decided.of(self.lane).vectors
        of_navigator = (hearing.attacked & (hearing.sources == 0)).any()
        return jnp.where(of_navigator, 0.0, signal.jets(vectors, self.now.basis)[0])


class Followed(eqx.Module):
    """What vehicles follow until the next tick: the law solved from the received jets."""

    weights: AxisWeights
    factors: Any  # by the network's solver, of the Laplacian of the weights
    response: Vectors | None  # L⁻¹ d, for a first guess; None where the solver needs none
    strength: Strength
    known: Known

    def drive(self, lane: Lane, decided: DecisionState) -> Drive:
        vectors = decided.of(lane).vectors
        rest = decided.sensed, decided.coasting, self.strength, self.known
        return Drive(self.weights, vectors, *rest)

    def guess(self, lane: Lane, now: Signals, own: Jets) -> PerAxis | None:
        """A first guess of the jerk: `R(y_0) - P(y)` plus the attacks' effect (exact cancellation).

        None where the solver needs none.
        """
        if self.response is None:
            return None
        forced = signal.combined(self.response, now.drive)
        return now.path[:, None] + forced - control.feedback(lane.gain, own)

    def jerk(self, scene: Scene, own: Jets, start: PerAxis | None) -> PerAxis:
        """The jerk of vehicles that sense these jets; `start` is a first guess.

        With gains of each vehicle the law is `-P_i(ε_i) = -P(ε_i) - (P_i - P)(ε_i)`.
        """
        lane, network, decided, now = scene
        drive = self.drive(lane, decided)
        demand = coupled_demand(lane, network, drive, own, now)
        if lane.gain_apart is not None:
            lies = signal.jets(drive.vectors, now.basis)
            for gain, mine, led, lie in zip(
                lane.gain_apart, own, now.navigator, lies, strict=False
            ):
                sources = jnp.concatenate([led[:, None], mine], axis=1)
                error = mine - network.hearing.mean(self.weights, sources, lie)
                demand = demand - gain[None] * error
        return network.solver.apply(network.hearing, self.factors, demand, start)

    def inputs(self, scene: Scene, states: States) -> PerAxis:
        """The inputs that the law asks of vehicles with these states."""
        own = scene.sensed(scene.outputs(states))
        jerk = self.jerk(scene, own, self.guess(scene.lane, scene.now, own))
        return vehicles.asked(scene.lane, states, jerk, scene.now.time, scene.lies)

    def rates(self, scene: Scene, states: States) -> States:
        lane, time = scene.lane, scene.now.time
        return vehicles.rates(lane, states, self.inputs(scene, states), time)

    def unresolved(self, path: Float[Array, "2 lanes"], drive: Float[Array, "b lanes"]) -> PerAxis:
        """Effect on the jerk of errors of this size of the signals R(y_0) and R(β)."""
        if self.response is None:
            return jnp.zeros((2, *self.weights.shape[2:]))
        return path[:, None] + signal.combined(jnp.abs(self.response), drive)


class FollowsLinearised(Followed):
    """Inputs linear in the error of the state."""

    def inputs(self, scene, states):
        """With `z - R(y_0) = L⁻¹ d - P(n)` for the sensors' errors n."""
        lane, now = scene.lane, scene.now
        drive = signal.combined(self.response, now.drive)
        drive = scene.decided.sensed.less_feedback(lane.gain, drive)
        path = (jnp.broadcast_to(jet[:, None], drive.shape) for jet in now.navigator)
        path = vehicles.in_formation(lane, tuple(path), now.time)
        return linearised.inputs_near_navigator(lane, states, path, drive)


class FollowsLocal(Followed):
    """The local law, evaluated at every instant; the response is d."""

    def jerk(self, scene, own, start):
        lane, network, decided, now = scene
        return local_jerk(lane, network, self.drive(lane, decided), own, now)


class Holds(Followed):
    """A jerk that is held."""

    held: PerAxis

    def guess(self, lane, now, own):
        return self.held

    def jerk(self, scene, own, start):
        return self.held


class Following(Motion[FollowingState], Generic[FollowingState]):
    """Motion of vehicles that follow a law. A subclass integrates the vehicles."""

    @property
    def guesses(self) -> bool:
        """Whether the motion needs a first guess of the jerk."""
        return self.network.solver.starts

    def nothing_followed(self) -> Followed:
        def first() -> Followed:
            lane, network = self.lane, self.network
            decided = tick.before_first(lane, network, self.plan)
            if lane.law.needs_ticks():
                return holding(decided.drive(lane).weights, jnp.zeros_like(lane.initial[:2]))
            return follow_weights(lane, network, decided, self.guesses)[0]

        return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), jax.eval_shape(first))

    def follow(
        self,
        state: FollowingState,
        followed: Followed,
        decided: DecisionState,
        few: LaneIndices,
        states: Callable[[], States],
    ) -> tuple[Followed, Followed, Bool[Array, " few"]]:
        """What all lanes follow with new decisions in a few, what these follow, which succeed."""
        lane, chosen = jax.tree.map(lambda leaf: picked(leaf, few), (self.lane, decided))
        if isinstance(followed, Holds):
            given = followed.held, state.signals, states()
            last, now, there = jax.tree.map(lambda leaf: picked(leaf, few), given)
            own = vehicles.outputs(lane, there, now.time)
            jerk = exchange(lane, self.network, chosen, own, now, last)
            new = holding(chosen.drive(lane).weights, jerk)
            connected = ~chosen.disconnected(lane, self.network)
        else:
            new, connected = follow_weights(lane, self.network, chosen, self.guesses)
        whole = jax.tree.map(lambda every, theirs: put(every, few, theirs), followed, new)
        return whole, new, connected

    def follow_anew(
        self,
        flagged: LaneFlags,
        state: FollowingState,
        decided: DecisionState,
        states: Callable[[], States],
    ) -> tuple[Followed, LaneFlags]:
        """What lanes follow, anew in the flagged ones, and the lanes with a vehicle cut off."""

        def some(few: LaneIndices, carry: tuple[Followed, LaneFlags]) -> tuple[Followed, LaneFlags]:
            followed, cut_off = carry
            followed, _, connected = self.follow(state, followed, decided, few, states)
            return followed, put(cut_off, few, ~connected)

        at_once = factorised_at_once(self.lane.initial.shape[1])
        return for_each(flagged, at_once, some, (state.followed, jnp.zeros_like(flagged)))

    def held_drive(self, state: FollowingState, decided: DecisionState) -> PerAxis:
        """`q + P(ŷ)` of a q that is held, whatever limits leave of it."""
        own = vehicles.outputs(self.lane, self.states(state), state.signals.time)
        return decided.sensed.drive(self.lane.gain, state.followed.held, own)

    def navigator(self, state):
        return state.signals.navigator

    def asked(self, state, decided):
        scene = Scene(self.lane, self.network, decided, state.signals)
        return state.followed.inputs(scene, decided.coasting.at_rest(self.states(state)))

    def basis(self, state):
        return state.signals.time, state.signals.basis

    def drive(self, state, decided):
        if self.plan.in_field:
            return decided.drive(self.lane)
        return state.followed.drive(self.lane, decided)

    def steps(self, state):
        return state.steps


def holding(weights: AxisWeights, jerk: PerAxis) -> Holds:
    return Holds(weights, None, None, Strength(), Known(), jerk)


def follow_weights(
    lane: Lane, network: Network, decided: DecisionState, guesses: bool
) -> tuple[Followed, Bool[Array, " few"]]:
    """The law with weights and factors, and the lanes that do not fail as disconnected.

    `guesses` says whether the law needs the response for a first guess of the jerk. A linearised
    law always needs the response.
    """
    drive, way = decided.drive(lane), lane.law.way()
    weights, vectors = drive.weights, control.drive_vectors(lane.gain, drive.vectors)
    if way == "local":
        response = of_each(vectors, lambda each: network.hearing.mean_added(weights, each))
        everybody = jnp.ones(lane.attack_scale.shape, bool)
        rest = response, drive.strength, drive.known
        return FollowsLocal(weights, None, *rest), everybody
    factors, residual = network.solver.factorise(network.hearing, weights)
    response = None
    if guesses or way == "linearised":

        def solved(each: Float[Array, "2 told lanes"]) -> PerAxis:
            right = network.hearing.mean_added(weights, each)
            return network.solver.apply(network.hearing, factors, right, None)

        response = of_each(vectors, solved)
    follows = FollowsLinearised if way == "linearised" else Followed
    followed = follows(weights, factors, response, drive.strength, drive.known)
    if isinstance(drive.known, KnownDrive):
        return followed, ~decided.disconnected(lane, network)
    return followed, residual < CONNECTED


def of_each(vectors: Vectors, solved: Callable[[Float[Array, "2 told lanes"]], PerAxis]) -> Vectors:
    """Vectors of the attacks' effect, one function after the other."""
    return jnp.moveaxis(jax.lax.map(solved, jnp.moveaxis(vectors, 2, 0)), 0, 2)
