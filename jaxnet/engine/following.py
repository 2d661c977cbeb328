"""The law that the nonlinear vehicles follow from one tick to the next, evaluated from the received jets.

`Following` is the base of the two ways to integrate the vehicles: `Collocation` and `Integration`.
"""

from typing import Any, Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine import tick
from jaxnet.engine.loop import Motion
from jaxnet.engine.plan import CONNECTED, Plan
from jaxnet.engine.signals import Signals
from jaxnet.engine.stepper import States
from jaxnet.engine.tick import DecisionState, Drive, Instants, KnownDrive
from jaxnet.model import control, linearised, signal
from jaxnet.model.hearing import AxisWeights
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Basis, Vectors
from jaxnet.model.strength import RowShares

Jerk = Float[Array, "2 m lanes"]
FollowingState = TypeVar("FollowingState", bound=Any)  # has the fields signals, followed and steps


class FollowedLaw(NamedTuple):
    """Weights, factors and jerk that vehicles follow until the next tick. Absent parts are None."""

    weights: AxisWeights
    factors: (
        Any  # by the network's solver, of these weights' Laplacian; None where none is solved for
    )
    jerk: Jerk | None  # held until the next tick
    response: Vectors | None  # L⁻¹ d, or d under a local law; for a linearised law or a first guess
    strength: RowShares | None = None  # of the rows of weights, under a local law
    known: KnownDrive | None = None  # what words add that are not live

    def guess(self, lane: Lane, now: Signals, own: Jets) -> Jerk | None:
        """Return the held derivative, or that of an exact cancellation: `R(y_0) - P(y)` plus the attacks'
        effect.

        The law is solved for the received jets from this first guess. None where the solver needs no guess.
        """
        if self.response is None:
            return self.jerk
        forced = signal.combined(self.response, now.drive)
        return now.path[:, None] + forced - control.feedback(lane.gain, own)


class Following(Motion[FollowingState], Generic[FollowingState]):
    """Motion of vehicles that follow a law. A subclass integrates the vehicles."""

    def followed_first(self) -> FollowedLaw:
        """Return the law followed before the first tick, needed for its shapes alone."""
        lane, network, plan = self.lane, self.network, self.plan
        decided = tick.before_first(lane, network, plan)
        if lane.law.needs_ticks():
            return FollowedLaw(
                tick.drive(lane, decided, plan).weights,
                None,
                jnp.zeros_like(lane.initial[:2]),
                None,
            )
        return follow_weights(lane, network, decided, plan, self.guesses)[0]

    @property
    def guesses(self) -> bool:
        """Return whether the motion needs a first guess of the jerk."""
        return self.network.solver.starts

    def basis(self, state: FollowingState) -> tuple[Instants, Basis]:
        """Return the time [s] and the attacks' functions now."""
        return state.signals.time, state.signals.basis

    def drive(self, state: FollowingState, decided: DecisionState) -> Drive:
        """Return the weights and attack vectors that the motion follows now."""
        if self.plan.in_field:
            return tick.drive(self.lane, decided, self.plan)
        vectors = tick.attack_vectors(self.lane, decided)
        return Drive(state.followed.weights, vectors, decided.noise, decided.coasting)

    def steps(self, state: FollowingState) -> Int[Array, " lanes"]:
        """Return the number of attempts so far."""
        return state.steps


def follow_weights(
    lane: Lane, network: Network, decided: DecisionState, plan: Plan, guesses: bool
) -> tuple[FollowedLaw, Bool[Array, " few"]]:
    """Return the law with weights and factors, and the lanes that do not fail as disconnected.

    `guesses` says whether the law needs the response for a first guess of the jerk. A linearised law always
    needs the response.
    """
    drive = tick.drive(lane, decided, plan)
    if not lane.law.couples():
        everybody = jnp.ones(lane.attack_scale.shape, bool)
        vectors = control.drive_vectors(lane.gain, drive.vectors)
        vectors = response(vectors, FollowedLaw(drive.weights, None, None, None), network)
        return FollowedLaw(
            drive.weights, None, None, vectors, drive.strength, drive.known
        ), everybody
    factors, residual = network.solver.factorise(network.hearing, drive.weights)
    followed = FollowedLaw(drive.weights, factors, None, None, known=drive.known)
    if guesses or lane.law.way() == "linearised":
        vectors = control.drive_vectors(lane.gain, drive.vectors)
        followed = followed._replace(response=response(vectors, followed, network))
    if drive.known is None:
        return followed, residual < CONNECTED
    return followed, ~tick.disconnected(lane, network, decided, plan)


def response(vectors: Vectors, followed: FollowedLaw, network: Network) -> Vectors:
    """Return `L⁻¹ d` for the attacks' vectors, or d where nothing is solved for."""

    def of_one(vector: Float[Array, "2 told lanes"]) -> Jerk:
        right = network.hearing.mean_added(followed.weights, vector)
        if followed.factors is None:
            return right
        return network.solver.apply(network.hearing, followed.factors, right, None)

    return jnp.moveaxis(jax.lax.map(of_one, jnp.moveaxis(vectors, 2, 0)), 0, 2)


def exchanged(
    lane: Lane,
    network: Network,
    decided: DecisionState,
    last: Jerk,
    now: Signals,
    states: States,
    plan: Plan,
) -> tuple[FollowedLaw, Bool[Array, " few"]]:
    """Return the law with weights and exchanged jerk, and the lanes that do not fail as disconnected."""
    drive, own = tick.drive(lane, decided, plan), lane.vehicle.output_jets(states)
    told = tick.Told(now.navigator, now.basis, now.path, now.drive, now.time)
    jerk = tick.exchange(lane, network, drive, own, told, last)
    return FollowedLaw(drive.weights, None, jerk, None), ~tick.disconnected(
        lane, network, decided, plan
    )


def law_jerk(
    lane: Lane,
    network: Network,
    followed: FollowedLaw,
    decided: DecisionState,
    now: Signals,
    own: Jets,
    start: Jerk | None,
) -> Jerk:
    """Return the jerk that the law asks for, solved from the received jets with the weights in force.

    `own` are the jets that vehicles sense of themselves. `start` is a first guess of the jerk. A local law is
    evaluated, not solved. With gains of each vehicle the law is `-P_i(ε_i) = -P(ε_i) - (P_i - P)(ε_i)`.
    """
    vectors = tick.attack_vectors(lane, decided)
    if not lane.law.couples():
        rest = followed.strength, followed.known
        drive = Drive(followed.weights, vectors, decided.noise, decided.coasting, *rest)
        return tick.followed_demand(lane, network, drive, own, now.navigator, now.basis, now.time)
    attack = signal.combined(control.drive_vectors(lane.gain, vectors), now.drive)
    demand = control.demand(own, now.path, attack, network.hearing, followed.weights, lane.gain)
    if followed.known is not None:
        demand = demand + followed.known.at(now.time)
    if lane.gain_apart is not None:
        heard = heard_means(network, followed.weights, now, own, signal.jets(vectors, now.basis))
        demand = demand - sum(
            each[None] * (a - b) for each, a, b in zip(lane.gain_apart, own, heard, strict=True)
        )
    return network.solver.apply(network.hearing, followed.factors, demand, start)


def heard_means(
    network: Network, weights: AxisWeights, now: Signals, own: Jets, signals: Jets
) -> list[Float[Array, "2 m lanes"]]:
    """Return the weighted means of the received jets below the order, `Σ_j w_ij (y_j + a_ij)` and so on."""
    sources = [
        jnp.concatenate([a[:, None], b], axis=1) for a, b in zip(now.navigator, own, strict=False)
    ]
    return [network.hearing.mean(weights, *both) for both in zip(sources, signals, strict=False)]


def linearised_inputs(
    lane: Lane, followed: FollowedLaw, decided: DecisionState, now: Signals, states: States
) -> Float[Array, "2 m lanes"]:
    """Return the inputs of a linearised law: with `z - R(y_0) = L⁻¹ d - P(n)` for the sensors' errors n."""
    drive = signal.combined(followed.response, now.drive)
    if decided.noise is not None:
        drive = drive - control.feedback(lane.gain, decided.noise)
    return linearised.inputs_near_navigator(lane, states, now.navigator, drive)
