"""A tick, the same in every engine: tell → attack → judge → drive.

    tell     a vehicle sends its jets, and an announcement where its defence announces
    attack   strategic attackers choose their vectors; attacked links carry false jets
    judge    a vehicle decides which sources to retain, by jets with the noise of its defence
    drive    the weights and the attacks' vectors that the motion follows until the next tick

Vehicles know their own jets, and links lose nothing: sensors and channels are no part of a tick yet.
Jets are relative to the navigator: E = y - y_0 and its derivatives, each (2, m, lanes). Lanes are last.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine.plan import Plan
from jaxnet.kinds.defences import Neighbourhood
from jaxnet.kinds.kind import KindError
from jaxnet.model import control, retained, signal, xla
from jaxnet.model.hearing import AxisWeights
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Basis, Vectors

Instants = Float[Array, " lanes"]
Sent = tuple[Float[Array, "2 sources lanes"], ...]
Received = tuple[Float[Array, "2 slots m lanes"], ...]
LaneFlags = Bool[Array, " lanes"]
VehicleFlags = Bool[Array, "m lanes"]


class DecisionState(NamedTuple):
    """Decisions of one tick, and the memory of defences and attackers. Absent parts are None."""

    decision: Any  # of the defence, ([2,] slots, m, lanes); None where the defence decides nothing
    memory: Any  # of the defence
    vectors: Vectors | None  # of strategic attackers
    attacker_memory: Any  # of strategic attackers


class Drive(NamedTuple):
    """Weights and attack vectors that the motion follows from one tick to the next."""

    weights: AxisWeights  # in force
    vectors: Vectors  # of the attacks [m]


class Seen(NamedTuple):
    """View of a strategic attacker at a tick: everything."""

    errors: Jets
    decision: Any  # of the tick before
    weights: Float[Array, "slots m lanes"]
    sources: Int[Array, "slots m"]
    attacked: Bool[Array, "slots m"]
    basis: Basis
    time: Instants
    amplitude: Instants  # ā, the factor of unit vectors [m]
    in_force: Any  # function from vectors, as `aim` returns them, to weights (axes, slots, m, lanes)


def before_first(lane: Lane, network: Network, plan: Plan) -> DecisionState:
    """Return the state before the first tick: every vehicle retains every source."""
    time, zero = jnp.zeros_like(lane.attack_scale), jnp.zeros_like(lane.initial[:2])
    errors = zero, zero, zero
    decision = memory = None
    if plan.decides:
        memory = lane.defence.start(surroundings(lane, network, time, None))
        everybody = jnp.ones(lane.weights.shape, bool)
        around = surroundings(lane, network, time, memory, (*errors, errors[0]))
        carried = attack(network, tell(errors), errors)
        shape = jax.eval_shape(lambda: lane.defence.decide(errors, carried, everybody, memory, around))
        decision = first_decision(shape[0], lane)
    if not plan.strategic:
        return DecisionState(decision, memory, None, None)
    state = DecisionState(decision, memory, lane.vectors, None)
    seen = sight(lane, network, plan, state, errors, lane.signal.basis(time), time)
    return state._replace(attacker_memory=lane.signal.begin(seen))


def first_decision(decided: Any, lane: Lane) -> Any:
    """Return the decision that retains every source, in the form of the defence's decisions.

    Raises KindError where a decision of the defence has another shape or type than allowed.
    """
    slots = lane.weights.shape
    if decided.shape not in (slots, (2, *slots)) or decided.dtype not in (jnp.bool_, jnp.float64):
        raise KindError(
            f"{lane.defence.kind}.decide: a decision is boolean or double precision, of shape {slots} or"
            f" {(2, *slots)} (got {decided.dtype} of shape {decided.shape})"
        )
    if decided.dtype == jnp.bool_:
        return jnp.ones(decided.shape, bool)
    return jnp.broadcast_to(lane.weights, decided.shape)


def decide(
    lane: Lane,
    network: Network,
    plan: Plan,
    before: DecisionState,
    errors: Jets,
    basis: Basis,
    time: Instants,
) -> DecisionState:
    """Pass one tick: return the decisions for errors E, where the attacks' functions are `basis`."""
    if plan.strategic:
        seen = sight(lane, network, plan, before, errors, basis, time)
        vectors, memory = lane.signal.aim(seen, before.attacker_memory)
        before = before._replace(vectors=bounded(vectors, lane), attacker_memory=memory)
    return judge(lane, network, plan, before, errors, basis, time)


def tell(errors: Jets) -> Sent:
    """Return the jets that the navigator and the vehicles send, each (2, 1 + m, lanes).

    The navigator's jets come first and are 0, because jets are relative to the navigator.
    """
    return tuple(jnp.concatenate([jnp.zeros_like(jet[:, :1]), jet], axis=1) for jet in errors)


def attack(network: Network, sent: Sent, signals: Any) -> Received:
    """Return the jets on each link, with the attacks' jets on attacked links."""
    return tuple(network.hearing.received(*both) for both in zip(sent, signals, strict=False))


def judge(
    lane: Lane,
    network: Network,
    plan: Plan,
    before: DecisionState,
    errors: Jets,
    basis: Basis,
    time: Instants,
) -> DecisionState:
    """Return the state with the sources that each vehicle retains, for the attackers' chosen vectors."""
    if not plan.decides:
        return before
    signals = signal.jets(attack_vectors(lane, before), basis)
    decision, memory = lane.defence.decide(
        errors,
        lane.defence.observed(attack(network, tell(errors), signals), time),
        before.decision,
        before.memory,
        surroundings(lane, network, time, before.memory, signals),
    )
    return before._replace(decision=of_heard(decision, lane), memory=memory)


def drive(lane: Lane, state: DecisionState, plan: Plan) -> Drive:
    """Return the weights and attack vectors that the motion follows after these decisions."""
    return Drive(weights_in_force(lane, state, plan), attack_vectors(lane, state))


def sight(
    lane: Lane, network: Network, plan: Plan, state: DecisionState, errors: Jets, basis: Basis, time: Instants
) -> Seen:
    """Return the view of a strategic attacker at a tick."""

    def in_force(vectors: Any) -> AxisWeights:
        chosen = state._replace(vectors=bounded(vectors, lane))
        judged = judge(lane, network, plan, chosen, errors, basis, time)
        return weights_in_force(lane, judged, plan)

    heard, decision = network.hearing, state.decision
    if decision is None:
        decision = jnp.ones(lane.weights.shape, bool)
    rest = basis, time, lane.attack_scale, in_force
    return Seen(errors, decision, lane.weights, heard.sources, heard.attacked, *rest)


def surroundings(
    lane: Lane, network: Network, time: Instants, memory: Any, signals: Any = None
) -> Neighbourhood:
    """Return the inputs of a defence besides the received jets; `signals` are the attacks' jets."""
    heard, trusted = network.hearing, network.trusted
    attacked = (heard.added(jnp.abs(lane.vectors).sum(axis=2)) != 0).any(axis=0)
    announced = None if signals is None else lane.defence.announcement(memory)
    if announced is not None:
        sent = jnp.concatenate([jnp.zeros_like(announced[:, :1]), announced], axis=1)
        carried = heard.received(sent, control.driven(lane.gain, signals))
        announced = lane.announces.received(heard.sent(sent), carried, attacked, heard.signals, time)
        announced = lane.defence.overheard(announced, heard.sources, time)
    rest = network.shared, announced, attacked
    return Neighbourhood(heard.sources, lane.weights, trusted, lane.gain, time, *rest)


def of_heard(decision: Any, lane: Lane) -> Any:
    """Return a decision in which slots of sources that the lane does not hear never count."""
    heard = jnp.broadcast_to(lane.weights > 0, decision.shape)
    return decision | ~heard if decision.dtype == bool else jnp.where(heard, decision, 0.0)


def bounded(vectors: Any, lane: Lane) -> Vectors:
    """Return vectors scaled to ā; a norm over 1 is scaled down to 1.

    The Frobenius norm is no less than the spectral norm. The vectors are divided by their greatest component
    first, because the square of a large number is infinite.
    """
    greatest = jnp.maximum(1.0, jnp.abs(vectors).max(axis=(0, 2), keepdims=True))
    unit = vectors / greatest
    norm = jnp.sqrt((unit**2).sum(axis=(0, 2), keepdims=True))
    unit = unit / jnp.maximum(1.0 / greatest, norm)
    attacked = (lane.vectors != 0).any(axis=(0, 2), keepdims=True)
    return jnp.where(attacked, lane.attack_scale[None, None, None] * unit, 0.0)


def attack_vectors(lane: Lane, state: DecisionState) -> Vectors:
    """Return the attacks' vectors (2, m, B, lanes) until the next tick."""
    return lane.vectors if state.vectors is None else state.vectors


def weights_in_force(lane: Lane, state: DecisionState, plan: Plan) -> AxisWeights:
    """Return the weights until the next tick."""
    return retained.in_force(lane.weights, state.decision) if plan.decides else lane.weights[None]


def changes(now: DecisionState, before: DecisionState, lane: Lane) -> tuple[LaneFlags, VehicleFlags]:
    """Return the lanes in which a decision changed, and the vehicles whose retained sources changed."""
    lanes, others = jnp.zeros(lane.attack_scale.shape, bool), jnp.zeros(lane.weights.shape[1:], bool)
    if now.decision is not None:
        supports = [retained.support(one.decision) for one in (now, before)]
        others = xla.materialised(lambda: retained.changed(*supports))
        lanes = others.sum(axis=0) > 0  # callers sum too, and XLA then sums once
        if now.decision.dtype != bool:
            lanes = retained.changed(now.decision, before.decision).any(axis=0)
    if now.vectors is not None and before.vectors is not None:
        lanes = lanes | (now.vectors != before.vectors).any(axis=(0, 1, 2))
    return lanes, others


def exchange(
    lane: Lane, network: Network, weights: AxisWeights, own: Jets, path: Any, attack: Any, last: Any
) -> Float[Array, "2 m lanes"]:
    """Return the jerk that vehicles hold until the next tick, under a law that holds a jerk.

    `own` are a vehicle's own jets of y, `path` is R(y_0), `attack` is R(a), and `last` is the jerk held until
    now.
    """
    demand = control.demand(own, path, attack, network.hearing, weights, lane.gain)

    def heard(jerk: Any) -> Any:
        sources = jnp.concatenate([jnp.zeros_like(jerk[:, :1]), jerk], axis=1)
        return network.hearing.mean(weights, sources, jnp.zeros_like(attack))

    return lane.law.exchange(last, demand, heard)
