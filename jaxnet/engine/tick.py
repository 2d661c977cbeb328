"""One tick, the same in every engine: receive → decide → (exchange) → (follow) → measure.

At a tick attackers that are strategic choose their vectors, every vehicle receives the jets that its sources
send, attacked or not, and decides whom to retain. Jets are told relative to the navigator's, in which form
all engines know them: E = y - y_0 and its derivatives.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine.metrics import SERIES, Observation
from jaxnet.engine.plan import Plan
from jaxnet.engine.status import LEAST_SPEED, Code, Status, fail
from jaxnet.kinds.defences import Neighbourhood
from jaxnet.kinds.kind import KindError
from jaxnet.kinds.vehicles import SPEED
from jaxnet.model import control, retained, signal, xla
from jaxnet.model.hearing import AxisWeights
from jaxnet.model.lane import Lane, Network


class Mind(NamedTuple):
    """What was decided at a tick, and what is remembered of it."""

    decision: Any  # of the defence: ([2,] slots, m, lanes), () where nobody decides
    memory: Any  # of the defence
    vectors: Any  # of attackers that are strategic (2, m, B, lanes), else ()
    plot: Any  # their memory


class Seen(NamedTuple):
    """What a strategic attacker sees at a tick: everything."""

    errors: Any  # E and its first two derivatives, each (2, m, lanes)
    decision: Any  # of the tick before
    weights: Float[Array, "slots m lanes"]
    sources: Int[Array, "slots m"]
    attacked: Bool[Array, "slots m"]
    basis: Float[Array, "4 functions lanes"]
    time: Float[Array, "lanes"]
    amplitude: Float[Array, "lanes"]  # ā, by which unit vectors are multiplied [m]
    in_force: Any  # what weights (axes, slots, m, lanes) vectors like those of `aim` would lead to now


def begin(lane: Lane, network: Network, plan: Plan) -> Mind:
    """Before the first tick: everybody is retained."""
    time, errors = jnp.zeros_like(lane.amplitude), (jnp.zeros_like(lane.initial[:2]),) * 3
    decision, memory = (), ()
    if plan.decides:
        memory = lane.defence.start(surroundings(lane, network, time))
        everybody = jnp.ones(lane.weights.shape, bool)
        around = surroundings(lane, network, time, memory, (*errors, errors[0]))
        shape = jax.eval_shape(
            lambda: lane.defence.decide(errors, received(network, errors, errors), everybody, memory, around)
        )
        decision = first_decision(shape[0], lane)
    if not plan.strategic:
        return Mind(decision, memory, (), ())
    mind = Mind(decision, memory, lane.vectors, ())
    nothing = sight(lane, network, plan, mind, errors, lane.signal.basis(time), time)
    return mind._replace(plot=lane.signal.begin(nothing))


def sight(lane: Lane, network: Network, plan: Plan, mind: Mind, errors: Any, basis: Any, time: Any) -> Seen:
    """What a strategic attacker sees."""

    def in_force(vectors: Any) -> AxisWeights:
        chosen = mind._replace(vectors=bounded(vectors, lane))
        return weights_of(lane, believe(lane, network, plan, chosen, errors, basis, time), plan)

    heard, decision = network.hearing, mind.decision
    if isinstance(decision, tuple):  # nobody decides
        decision = jnp.ones(lane.weights.shape, bool)
    rest = basis, time, lane.amplitude, in_force
    return Seen(errors, decision, lane.weights, heard.sources, heard.attacked, *rest)


def first_decision(decided: Any, lane: Lane) -> Any:
    """Everybody retained, in the form in which the defence decides; raises KindError if that is none."""
    slots = lane.weights.shape
    if decided.shape not in (slots, (2, *slots)) or decided.dtype not in (jnp.bool_, jnp.float64):
        raise KindError(
            f"{lane.defence.kind}.decide: a decision is boolean or double precision, of shape {slots} or"
            f" {(2, *slots)} (got {decided.dtype} of shape {decided.shape})"
        )
    if decided.dtype == jnp.bool_:
        return jnp.ones(decided.shape, bool)
    return jnp.broadcast_to(lane.weights, decided.shape)


def surroundings(
    lane: Lane, network: Network, time: Any, memory: Any = (), attack: Any = ()
) -> Neighbourhood:
    """What a defence is told besides the jets; `attack` are the signals' jets."""
    heard, trusted = network.hearing, network.trusted
    attacked = (heard.added(jnp.abs(lane.vectors).sum(axis=2)) != 0).any(axis=0)
    announced = lane.defence.announcement(memory)
    if not isinstance(announced, tuple):
        sent = jnp.concatenate([jnp.zeros_like(announced[:, :1]), announced], axis=1)
        carried = heard.received(sent, control.driven(lane.gain, attack))
        announced = lane.announces.received(heard.sent(sent), carried, attacked, heard.signals, time)
        announced = lane.defence.overheard(announced, heard.sources, time)
    rest = network.shared, announced, attacked
    return Neighbourhood(heard.sources, lane.weights, trusted, lane.gain, time, *rest)


def received(network: Network, errors: Any, attack: Any) -> tuple[Any, ...]:
    """Jets in each slot, attacked or not, each (2, slots, m, lanes)."""
    return tuple(
        network.hearing.received(jnp.concatenate([jnp.zeros_like(sent[:, :1]), sent], axis=1), added)
        for sent, added in zip(errors, attack, strict=False)
    )


def decide(
    lane: Lane, network: Network, plan: Plan, mind: Mind, errors: Any, basis: Any, time: Float[Array, "lanes"]
) -> Mind:
    """Have attackers choose, and vehicles receive and decide."""
    if plan.strategic:
        vectors, plot = lane.signal.aim(sight(lane, network, plan, mind, errors, basis, time), mind.plot)
        mind = mind._replace(vectors=bounded(vectors, lane), plot=plot)
    return believe(lane, network, plan, mind, errors, basis, time)


def believe(
    lane: Lane, network: Network, plan: Plan, mind: Mind, errors: Any, basis: Any, time: Float[Array, "lanes"]
) -> Mind:
    """Have vehicles receive and decide."""
    if not plan.decides:
        return mind
    attack = signal.jets(vectors_of(lane, mind), basis)
    decision, memory = lane.defence.decide(
        errors,
        lane.defence.observed(received(network, errors, attack), time),
        mind.decision,
        mind.memory,
        surroundings(lane, network, time, mind.memory, attack),
    )
    return mind._replace(decision=of_heard(decision, lane), memory=memory)


def of_heard(decision: Any, lane: Lane) -> Any:
    """A decision in which a slot without a source, or of one that this lane does not hear, never counts."""
    heard = jnp.broadcast_to(lane.weights > 0, decision.shape)
    return decision | ~heard if decision.dtype == bool else jnp.where(heard, decision, 0.0)


def bounded(vectors: Any, lane: Lane) -> Any:
    """Vectors scaled to ā, and down where their norm (no less than the spectral one) is over 1.

    The norm is taken of vectors over their greatest component, for the square of a great one is infinite.
    """
    greatest = jnp.maximum(1.0, jnp.abs(vectors).max(axis=(0, 2), keepdims=True))
    unit = vectors / greatest
    norm = jnp.sqrt((unit**2).sum(axis=(0, 2), keepdims=True))
    unit = unit / jnp.maximum(1.0 / greatest, norm)
    attacked = (lane.vectors != 0).any(axis=(0, 2), keepdims=True)
    return jnp.where(attacked, lane.amplitude[None, None, None] * unit, 0.0)


def vectors_of(lane: Lane, mind: Mind) -> Any:
    """The attacks' vectors (2, m, B, lanes) until the next tick."""
    return lane.vectors if isinstance(mind.vectors, tuple) else mind.vectors


def weights_of(lane: Lane, mind: Mind, plan: Plan) -> AxisWeights:
    """The weights in force."""
    return retained.in_force(lane.weights, mind.decision) if plan.decides else lane.weights[None]


def changed(now: Mind, before: Mind, lane: Lane) -> tuple[Bool[Array, "lanes"], Bool[Array, "m lanes"]]:
    """Lanes in which anything was decided otherwise, and vehicles that retain others than before."""
    lanes, others = jnp.zeros(lane.amplitude.shape, bool), jnp.zeros(lane.weights.shape[1:], bool)
    if not isinstance(now.decision, tuple):
        supports = [retained.support(one.decision) for one in (now, before)]
        others = xla.computed(lambda: retained.changed(*supports))
        lanes = others.sum(axis=0) > 0  # as callers count them, which XLA then does once
        if now.decision.dtype != bool:
            lanes = retained.changed(now.decision, before.decision).any(axis=0)
    if not isinstance(now.vectors, tuple):
        lanes = lanes | (now.vectors != before.vectors).any(axis=(0, 1, 2))
    return lanes, others


def exchanged(
    lane: Lane, network: Network, weights: AxisWeights, own: Any, path: Any, attack: Any, last: Any
) -> Float[Array, "2 m lanes"]:
    """The jerk that vehicles hold until the next tick, where the law has one held.

    From their own jets, `R(y_0)`, `R(a)`, and what they held until now.
    """
    demand = control.demand(own, path, attack, network.hearing, weights, lane.gain)

    def heard(jerk: Any) -> Any:
        sources = jnp.concatenate([jnp.zeros_like(jerk[:, :1]), jerk], axis=1)
        return network.hearing.mean(weights, sources, jnp.zeros_like(attack))

    return lane.law.exchange(last, demand, heard)


def status_at_start(lane: Lane) -> Code:
    """Lanes that cannot begin: at rest, or not finite."""
    still = (jnp.abs(lane.initial[SPEED]) < LEAST_SPEED).any(axis=0)
    status = fail(jnp.zeros(still.shape, int), Status.singular, still)
    return fail(status, Status.nonfinite, ~jnp.isfinite(lane.initial).all(axis=(0, 1)))


def room(plan: Plan, seen: Any) -> dict[str, Any]:
    """Stacks over output times of what is saved, not-a-number as yet; `seen` makes an observation."""
    shapes = jax.eval_shape(lambda: series(plan, seen()))
    return {name: jnp.full((plan.rows, *one.shape), jnp.nan) for name, one in shapes.items()}


def series(plan: Plan, seen: Observation) -> dict[str, Any]:
    """What is saved of an observation, lanes last."""
    return {name: SERIES[name](seen) for name in plan.save}
