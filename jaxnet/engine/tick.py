"""A tick, the same in every engine: sense → tell → attack → channel → judge → drive.

    sense    a vehicle senses its own jets, with errors that stay the same until the next tick
    tell     a vehicle sends the jets that it senses, and an announcement where its defence announces
    attack   strategic attackers choose their vectors; attacked links carry false jets
    channel  messages are late or lost, or get errors; a lost word may be replaced
    judge    a vehicle decides which sources to retain, by jets with the noise of its defence
    drive    the weights, the attacks' vectors, the errors and the kept drives, until the next tick

A vehicle that hears nobody keeps its last drive `z = y‴ + P(ŷ)`, where ŷ is what it senses. So does a group
of vehicles that hear only each other: the law has no solution for such a group. If decisions alone cut a
vehicle off from the navigator, its lane fails, or the vehicle coasts: it keeps its last drive too.

A word is X_j = R(y_j) plus R of the attack. All that a vehicle puts in place of live words is known until the
next tick: a kept drive, a late word (`late`), a word heard before, the error of a word. `KnownDrive` holds
their sum, a polynomial of the time since the tick:

    L_r X = a0_live R(y_0) + W_live R(a) + Σ_k z_k σ^k / k!,      L_r = I - A_live,

with σ the share of the tick that has passed. Over a short tick no coefficient is divided by a power of it.

Jets are relative to the navigator: E = y - y_0 and its derivatives, each (2, m, lanes). Lanes are last.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine import detection, late, stopping
from jaxnet.engine.detection import Detection
from jaxnet.engine.late import History, SentJets
from jaxnet.engine.plan import Plan
from jaxnet.engine.standstill import VehicleFlags
from jaxnet.engine.stepper import States
from jaxnet.engine.stopping import Stopped
from jaxnet.kinds.defences import Neighbourhood
from jaxnet.kinds.kind import KindError
from jaxnet.kinds.losses import Messages
from jaxnet.kinds.shapes import Decision, Memory
from jaxnet.model import control, plane, retained, signal, xla
from jaxnet.model.hearing import AxisWeights, plus_slots
from jaxnet.model.lane import Lane, Network, in_period
from jaxnet.model.plane import Jets
from jaxnet.model.shapes import LoopIndex
from jaxnet.model.signal import Basis, Vectors

Instants = Float[Array, " lanes"]
Sent = tuple[Float[Array, "2 sources lanes"], ...]
Received = tuple[Float[Array, "2 slots m lanes"], ...]
SomeReceived = tuple[Float[Array, "2 slots m lanes"] | None, ...]
LaneFlags = Bool[Array, " lanes"]
PerAxis = Float[Array, "2 m lanes"]
Words = Float[
    Array, "2 degrees slots m lanes"
]  # coefficients of σ^k / k!, with σ the share of the tick
EachSignal = Float[Array, "2 signals lanes"]
SignalJets = tuple[EachSignal, ...]


# Coefficients of the polynomial that stands in for a lost word, for vehicles of an order.
MISSING: dict[str, Callable[[int], int]] = {
    "drop": lambda order: 0,
    "hold": lambda order: 1,
    "extrapolate": lambda order: order + 1,
}


class Reception(NamedTuple):
    """Messages that arrived at a tick."""

    arrived: Bool[Array, "slots m lanes"]
    memory: Memory  # of the loss
    time: Instants  # of the tick [s]
    words: Words | None = (
        None  # that stand in for lost words; None where listeners drop a lost source
    )
    heard: Bool[Array, "slots m lanes"] | None = (
        None  # links that may be used; None: those of `arrived`, or
    )
    # all links, for which words stand in


class Coasting(NamedTuple):
    """Vehicles that keep their last drive until the next tick."""

    vehicles: VehicleFlags
    drive: PerAxis  # the drive z that they keep [m/s³]; 0 for other vehicles
    cut_off: (
        VehicleFlags  # of them, those that decisions alone cut off; nobody where their lane fails
    )
    stopped: Stopped | None  # of those that are cut off; None where a vehicle cannot stop


class Reading(NamedTuple):
    """What vehicles sense of themselves until the next tick."""

    errors: Jets  # of fresh readings
    jets: Jets  # as sensed, relative to no navigator


class KnownDrive(NamedTuple):
    """What known words add to the drives until the next tick (see the module's docstring)."""

    share: (
        Float[Array, "axes m lanes"] | None
    )  # of the weights of a row whose words are not live; None: 0
    drive: Float[Array, "2 degrees m lanes"]  # z_k [m/s³]
    interval: Instants  # from tick to tick [s]
    time: Instants | None = None  # of the tick [s]; None where the drive is constant

    def at(self, time: Float[Array, "*lanes"]) -> Float[Array, "2 m *lanes"]:
        """Return the drive at a time."""
        if self.time is None:
            return self.drive[:, 0]
        return after_share(self.drive, (time - self.time) / self.interval)


class DecisionState(NamedTuple):
    """Decisions of one tick, and the memory of defences and attackers. Absent parts are None."""

    decision: (
        Decision | None
    )  # of the defence, ([2,] slots, m, lanes); None if the defence decides nothing
    memory: Memory  # of the defence
    vectors: Vectors | None  # of attackers; None where all times have the lane's
    attacker_memory: Memory  # of strategic attackers
    noise: Jets | None = None  # errors of the jets that vehicles sense of themselves
    reception: Reception | None = None  # None where every message arrives
    coasting: Coasting | None = None  # None where no vehicle ever keeps its drive
    network: Int[Array, " lanes"] | None = (
        None  # number of the one in force; None where there is one
    )
    link_noise: SomeReceived | None = None  # errors of jets on links, None for an exact order
    drawn: SomeReceived | None = (
        None  # of these errors, those of the noise; None where words are not rounded
    )
    late: History | None = (
        None  # what links carried in the last ticks; None where words are not late
    )
    weights: Float[Array, "slots m lanes"] | None = (
        None  # of links; None where all times have the lane's
    )
    detection: Detection | None = None  # alarms until now; None without a detector
    reading: Reading | None = None  # what vehicles sense; None where no reading is read again
    known: KnownDrive | None = (
        None  # what late words add to the drives; None where words are not late
    )

    @property
    def may_stop(self) -> VehicleFlags | None:
        """Vehicles that are cut off and stop where they come to rest; None where nobody does."""
        coasting = self.coasting
        return None if coasting is None or coasting.stopped is None else coasting.cut_off

    @property
    def frozen(self) -> VehicleFlags | None:
        """Vehicles whose motion until the next tick needs no integrator; None where nobody may stop."""
        coasting = self.coasting
        return None if coasting is None or coasting.stopped is None else coasting.stopped.frozen

    @property
    def link_errors(self) -> Received | None:
        """Return the errors of the jets on each link, None without."""
        return None if self.link_noise is None else of_all_orders(self.link_noise)


class Drive(NamedTuple):
    """What the motion follows from one tick to the next."""

    weights: AxisWeights  # in force; 0 for a vehicle that keeps its drive
    vectors: Vectors  # of the attacks [m]
    noise: Jets | None  # errors of the sensed jets
    coasting: Coasting | None
    strength: Float[Array, "axes m lanes"] | None = (
        None  # of the rows of weights; None where it is 1
    )
    known: KnownDrive | None = None  # None where all words are live, without errors


class Told(NamedTuple):
    """Jets of the navigator and of the attacks' functions now, and R of both."""

    navigator: Float[Array, "derivatives 2 lanes"]
    basis: Basis
    path: Float[Array, "2 lanes"]
    functions: Float[Array, "functions lanes"]
    time: Instants


class Seen(NamedTuple):
    """View of a strategic attacker at a tick: everything.

    Attributes
    ----------
    errors
        Jets of the vehicles relative to the navigator [m, m/s, m/s²], each (2, m, lanes).
    decision
        Decision of the tick before.
    weights
        Weights of the graph, (slots, m, lanes).
    sources
        Numbers of the sources, (slots, m).
    attacked
        Whether a slot is attacked, (slots, m).
    basis
        Scalar functions of the attack at this tick.
    time
        Time [s], (lanes,).
    amplitude
        ā [m], the factor of unit vectors, (lanes,).
    in_force
        Function from vectors, as `aim` returns them, to the weights that they would put in force.

    Examples
    --------
    >>> import jax.numpy as jnp, jaxnet, numpy as np
    >>> from jaxnet.kinds.attacks import Attack, constant_basis
    >>> class Outward(Attack):
    ...     '''Send an offset along each vehicle's own error.'''
    ...
    ...     strategic = True
    ...
    ...     def basis(self, time):
    ...         return constant_basis(time)
    ...
    ...     def sizes(self, horizon):
    ...         return np.eye(4, 1)
    ...
    ...     def aim(self, seen, memory):
    ...         error = seen.errors[0]
    ...         return (error / jnp.hypot(*error)[None])[:, :, None], memory
    >>> keys = {"engine": "exact", "horizon": 1.0, "tail": 0.5, "attack": Outward()}
    >>> jaxnet.simulate(keys, samples=2, progress=False).lanes["status"].to_list()
    ['ok', 'ok']
    """

    errors: Jets
    decision: Decision
    weights: Float[Array, "slots m lanes"]
    sources: Int[Array, "slots m"]
    attacked: Bool[Array, "slots m"]
    basis: Basis
    time: Instants
    amplitude: Instants
    in_force: Callable[[Vectors], AxisWeights]


def before_first(lane: Lane, network: Network, plan: Plan) -> DecisionState:
    """Return the state before the first tick: every vehicle retains every source, every message arrived."""
    time, zero = jnp.zeros_like(lane.attack_scale), jnp.zeros_like(lane.initial[:2])
    errors = (zero,) * len(lane.gain)
    decision = memory = None
    if plan.decides:
        memory = lane.defence.start(surroundings(lane, network, time, None))
        everybody = jnp.ones(lane.weights.shape, bool)
        around = surroundings(lane, network, time, memory, (*errors, zero))
        carried = attack(network, tell(errors), errors)
        shape = jax.eval_shape(
            lambda: lane.defence.decide(errors, carried, everybody, memory, around)
        )
        decision = first_decision(shape[0], lane)
    noise = None if lane.sensor is None else (zero,) * max(3, len(lane.gain))
    history = None if lane.delay is None else late.first_history(lane, plan)
    channel = first_reception(lane, network, plan, errors, time, history), first_coasting(lane)
    number = None if lane.turns is None else jnp.zeros(time.shape, int)
    rest = noise, *channel, number, *first_link_errors(lane), history
    alarms = detection.first_detection(lane, network.hearing)
    again = None if lane.sensor is None else lane.sensor.stays(time, zero.shape[1])
    last = (
        alarms,
        None if again is None or noise is None else Reading(noise, (zero,) * len(lane.gain)),
    )
    if not plan.strategic:
        changing = None if lane.periods is None else lane.vectors
        weights = None if lane.periods is None or lane.periods.weights is None else lane.weights
        state = DecisionState(decision, memory, changing, None, *rest, weights, *last)
        return with_known(lane, network, state, plan)
    state = DecisionState(decision, memory, lane.vectors, None, *rest, None, *last)
    state = with_known(lane, network, state, plan)
    seen = sight(lane, network, plan, state, errors, lane.basis(time), time)
    return state._replace(attacker_memory=lane.signal.begin(seen))


def first_link_errors(lane: Lane) -> tuple[SomeReceived | None, SomeReceived | None]:
    """Return that jets on links have no errors before the first tick, as `disturb` returns their errors."""
    rounded, silent = (
        lane.steps is not None and lane.delay is None,
        jnp.zeros((2, *lane.weights.shape)),
    )
    drawn = None
    if lane.noise is not None:
        drawn = tuple(silent if errs else None for errs in erring_orders(lane))
    if not rounded:
        return drawn, None
    jets = max(3, len(lane.gain)) if drawn is None else len(drawn)
    return (silent,) * jets, drawn


def erring_orders(lane: Lane) -> list[bool]:
    """Return the orders of the jets on links that noise gives errors, of `max(3, r)`, and then the r-th."""
    below = [*lane.noise.erring(), *[False] * (len(lane.gain) - 3)]
    return below + [True] * lane.noise.errs_in_highest()


def of_all_orders(errors: SomeReceived) -> Received:
    """Return errors with 0 for the orders that have none."""
    nothing = jnp.zeros_like(next(error for error in errors if error is not None))
    return tuple(nothing if error is None else error for error in errors)


def first_decision(decided: jax.ShapeDtypeStruct, lane: Lane) -> Decision:
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


def first_reception(
    lane: Lane, network: Network, plan: Plan, errors: Jets, time: Instants, history: History | None
) -> Reception | None:
    """Return the reception before the first tick, None where every message arrives."""
    if not lane.lossy:
        return None
    messages = messages_of(lane, network, history, errors, time)
    memory = None if lane.loss is None else lane.loss.start(messages)
    terms = degrees(lane, plan)
    holds = plan.missing == "hold" and history is not None
    words = (
        jnp.zeros((2, terms, *lane.weights.shape)) if terms and (holds or history is None) else None
    )
    return Reception(messages.present, memory, time, words, messages.present if holds else None)


def degrees(lane: Lane, plan: Plan) -> int:
    """Return the number of coefficients of the words that are known before a tick, 0 without such words."""
    if lane.delay is not None:
        return late.word_degrees(lane)
    return MISSING[plan.missing](len(lane.gain)) if lane.lossy else 0


def first_coasting(lane: Lane) -> Coasting | None:
    """Return that no vehicle coasts before the first tick, None where no vehicle ever does."""
    if not (lane.lossy or coasts(lane)):
        return None
    nobody = jnp.zeros(lane.weights.shape[1:], bool)
    stopped = stopping.none_yet(lane) if coasts(lane) else None
    return Coasting(nobody, jnp.zeros_like(lane.initial[:2]), nobody, stopped)


def coasts(lane: Lane) -> bool:
    """Return whether vehicles that decisions cut off keep their drive; under a local law they have none."""
    return lane.defence.coasts() and lane.law.couples()


def decide(
    lane: Lane,
    network: Network,
    plan: Plan,
    before: DecisionState,
    errors: Jets,
    basis: Basis,
    time: Instants,
    drive: PerAxis | None = None,
) -> DecisionState:
    """Pass one tick: return the decisions for errors E, where the attacks' functions are `basis`.

    `drive` is the drive z of each vehicle until now, needed where vehicles may keep it.
    """
    state = before._replace(noise=sense(lane, before.noise, time))
    if before.reading is not None:
        own = plane.plus(errors, lane.path(time)[: len(errors), :, None])
        state = state._replace(**read_again(lane, before.reading, own, time))
    if lane.turns is not None:
        number = lane.turns.schedule.number(time, len(lane.turns.weights))
        state, lane = state._replace(network=number), with_network(lane, number)
    if lane.periods is not None:
        lane = in_period(lane, time)
        links = None if state.weights is None else lane.weights
        state = state._replace(vectors=lane.vectors, weights=links)
    if plan.strategic:
        seen = sight(lane, network, plan, state, errors, basis, time)
        vectors, memory = lane.signal.aim(seen, state.attacker_memory)
        state = state._replace(vectors=bounded(vectors, lane), attacker_memory=memory)
    state = state._replace(
        reception=channel(lane, network, before, errors, time),
        **disturb(lane, network, before, state, errors, basis, time),
    )
    state = state._replace(
        reception=listen(lane, network, plan, before, state, errors, basis, time, drive)
    )
    state = state._replace(detection=raise_alarms(lane, network, state, errors, basis, time))
    state = judge(lane, network, plan, state, errors, basis, time)
    own = plane.plus(errors, lane.path(time)[: len(errors), :, None])
    standing = control.feedback(lane.gain, sensed(own, state.noise))
    state = state._replace(coasting=keep_drive(lane, network, plan, state, drive, standing))
    if state.late is None:
        return state
    state = with_known(lane, network, state, plan)
    held = held_derivative(lane, before, errors, time, drive)
    return send(lane, network, plan, state, errors, basis, time, held)


def send(
    lane: Lane,
    network: Network,
    plan: Plan,
    state: DecisionState,
    errors: Jets,
    basis: Basis,
    time: Instants,
    held: PerAxis | None,
) -> DecisionState:
    """Return the state with what links carry from this tick to the next, which is heard later.

    `held` is the r-th derivative that vehicles hold until now and tell, None under other laws.
    """
    known, history = state.known, state.late
    assert history is not None
    assert known is not None
    jets = None
    if plan.decides:
        order = len(lane.gain)
        relative = tell(sensed(errors, state.noise)[:order])
        jets = SentJets(relative, lane.path(time)[:order], basis[:order])
    own = plane.plus(errors, lane.path(time)[: len(errors), :, None])
    if lane.law.needs_ticks():
        highest = jnp.zeros_like(own[0]) if held is None else held
        told = tuple(jet[:, None] for jet in (*sensed(own, state.noise), highest))
    elif not lane.law.couples() or plan.extrapolate != "none":
        strength = None
        if not lane.law.couples():
            assert known.share is not None
            strength, given = (known.share > 0).astype(float), row_strength(lane, state, plan)
            strength = strength if given is None else strength * given
        told = late.motion_of(lane.gain, known.drive, own, state.noise, strength, lane.interval)
    else:
        told = (known.drive,)
    if state.reception is not None and lane.loss is not None:
        arrived = late.arrival(history, lane, time).came
        history = late.without_lost(history, arrived & ~state.reception.arrived)
    rounding = (
        None if lane.steps is None else rounding_errors(lane, network, state, errors, basis, time)
    )
    sent = told, state.vectors, rounding, jets
    return state._replace(late=late.remember(history, lane, plan, *sent, time))


def held_derivative(
    lane: Lane, before: DecisionState, errors: Jets, time: Instants, drive: PerAxis | None
) -> PerAxis | None:
    """Return the r-th derivative that vehicles hold until now and tell, None under a law without one."""
    if not lane.law.couples() or not lane.law.needs_ticks() or drive is None:
        return None
    own = plane.plus(errors, lane.path(time)[: len(errors), :, None])
    return drive - control.feedback(lane.gain, sensed(own, before.noise))


def with_network(lane: Lane, number: Int[Array, " lanes"] | None) -> Lane:
    """Return the lane with the weights of the network in force; unchanged where there is one network."""
    if lane.turns is None or number is None:
        return lane
    _, *each = lane.turns
    weights, strength = jax.tree.map(
        lambda leaf: jax.vmap(lambda networks, one: networks[one], -1, -1)(leaf, number),
        tuple(each),
    )
    return lane._replace(weights=weights, strength=strength)


def sense(lane: Lane, last: Jets | None, time: Instants) -> Jets | None:
    """Return the errors of the jets that vehicles sense of themselves, None where vehicles sense exactly.

    `last` are the errors of the last tick. A sensor gives three errors; further derivatives are sensed
    exactly.
    """
    if lane.sensor is None or last is None:
        return None
    errors = xla.materialised(lambda: lane.sensor.next_errors(last[:3], time, lane.interval))
    return *errors, *[jnp.zeros_like(errors[0])] * (len(lane.gain) - len(errors))


def disturb(
    lane: Lane,
    network: Network,
    before: DecisionState,
    state: DecisionState,
    errors: Jets,
    basis: Basis,
    time: Instants,
) -> dict[str, SomeReceived | None]:
    """Return the errors of the jets on each link, and what noise draws of them; None without.

    Errors of the r-th derivative come last, after `max(3, r)` errors of lower ones.
    """
    jets = max(3, len(lane.gain))
    last, drawn = before.link_noise if before.drawn is None else before.drawn, None
    if lane.noise is not None and last is not None:
        sources, whole, erring = network.hearing.sources, of_all_orders(last), erring_orders(lane)
        before_now = *whole[:3], *whole[jets:]

        def draw() -> SomeReceived:
            found = list(lane.noise.next_errors(before_now, time, lane.interval, sources))
            found[3:3] = [None] * (jets - 3)
            return tuple(error if errs else None for error, errs in zip(found, erring, strict=True))

        drawn = xla.materialised(draw)
    if lane.steps is None or lane.delay is not None:  # late words are rounded when they are sent
        return {"link_noise": drawn}
    rounding = rounding_errors(lane, network, state, errors, basis, time)
    if drawn is not None:
        noise = of_all_orders(drawn)
        rounding = *plane.plus(rounding, noise), *noise[jets:]
    return {"link_noise": rounding, "drawn": drawn}


def rounding_errors(
    lane: Lane, network: Network, state: DecisionState, errors: Jets, basis: Basis, time: Instants
) -> Received:
    """Return the errors of the jets that links carry now if each jet is rounded to a multiple of its step."""
    steps, navigator = lane.steps, lane.path(time)[: len(lane.gain), :, None]
    assert steps is not None
    own = sensed(plane.plus(errors, navigator), state.noise)
    sent = tuple(jnp.concatenate(both, axis=1) for both in zip(navigator, own, strict=False))
    told = attack(network, sent, signal.jets(attack_vectors(lane, state), basis))

    def rounded(
        jet: Float[Array, "2 slots m lanes"], step: Instants
    ) -> Float[Array, "2 slots m lanes"]:
        unit = jnp.where(step > 0, step, 1.0)[None, None, None]
        return jnp.where((step > 0)[None, None, None], unit * jnp.round(jet / unit) - jet, 0.0)

    found = xla.materialised(lambda: tuple(map(rounded, told, steps)))
    return *found, *[jnp.zeros_like(found[0])] * (3 - len(found))


def read_again(lane: Lane, last: Reading, own: Jets, time: Instants) -> dict[str, Any]:
    """Return the errors and the reading of a tick at which some vehicles sense what they sensed last.

    `own` are the vehicles' jets.
    """
    fresh = sense(lane, last.errors, time)
    assert fresh is not None
    stays = xla.materialised(lambda: lane.sensor.stays(time, own[0].shape[1]))[None]
    held = [
        jnp.where(stays, old - jet, new)
        for old, jet, new in zip(last.jets, own, fresh, strict=False)
    ]
    noise = *held, *fresh[len(held) :]
    return {"noise": noise, "reading": Reading(fresh, plane.plus(own, noise))}


def word_errors(gain: control.Gain, noise: Received) -> Float[Array, "2 slots m lanes"]:
    """Return R of the errors of the jets on each link: `P(n) + n^(r)`."""
    total, highest = control.feedback(gain, noise), noise[max(3, len(gain)) :]
    return total + highest[0] if highest else total


def at_rest(state: DecisionState, states: States) -> States:
    """Return the states of vehicles, with those of rest for vehicles that have stopped."""
    stopped = None if state.coasting is None else state.coasting.stopped
    return states if stopped is None else jnp.where(stopped.vehicles[None], stopped.states, states)


def sensed(jets: Jets, noise: Jets | None) -> Jets:
    """Return the jets with the errors of the sensor."""
    return jets if noise is None else plane.plus(jets, noise)


def channel(
    lane: Lane, network: Network, before: DecisionState, errors: Jets, time: Instants
) -> Reception | None:
    """Return the messages that arrive at a tick, None where every message arrives."""
    if before.reception is None:
        return None
    messages, memory = messages_of(lane, network, before.late, errors, time), None
    arrived = messages.present
    if lane.loss is not None:
        lost, memory = lane.loss.lost(messages, before.reception.memory)
        arrived = xla.materialised(lambda: messages.present & ~lost)
    heard = before.reception.heard
    return Reception(arrived, memory, time, heard=None if heard is None else heard | arrived)


def listen(
    lane: Lane,
    network: Network,
    plan: Plan,
    before: DecisionState,
    state: DecisionState,
    errors: Jets,
    basis: Basis,
    time: Instants,
    drive: PerAxis | None,
) -> Reception | None:
    """Return the reception with the late words that arrive, or with those that stand in for lost words from
    this tick on.

    A word that was live until now is heard for the last time now. Where a law holds a derivative, vehicles
    hear words at ticks alone. Other words are continued; late ones stay as they were when their tick ended.
    """
    last, now = before.reception, state.reception
    if now is not None and before.late is not None:
        if now.heard is None:
            return now
        return now._replace(words=late_words(lane, network, plan, before, state, time))
    if last is None or now is None or last.words is None:
        return now
    speaking, heard = (
        (state, now.arrived | (time <= 0)[None, None])
        if lane.law.needs_ticks()
        else (before, last.arrived)
    )
    words, gain = last.words, lane.gain
    signals = signal.jets(attack_vectors(lane, speaking), basis)
    if plan.missing == "hold" and lane.law.solves() and drive is not None:
        sources = jnp.concatenate([control.driven(gain, lane.path(time))[:, None], drive], axis=1)
        fresh = network.hearing.received(sources, control.driven(gain, signals))
        if before.link_errors is not None:
            fresh = fresh + word_errors(gain, before.link_errors)
        fresh = fresh[:, None]
    else:
        held = (
            held_derivative(lane, before, errors, time, drive) if plan.missing == "hold" else None
        )
        jets = heard_jets(lane, network, speaking, errors, signals, time, held)
        fresh = expanded(gain, jets, lane.interval)[:, : words.shape[1]]
    words = jnp.where(heard[None, None], fresh, continued(words, jnp.ones_like(time)))
    return now._replace(words=words)


def late_words(
    lane: Lane,
    network: Network,
    plan: Plan,
    before: DecisionState,
    state: DecisionState,
    time: Instants,
) -> Words:
    """Return the late words that arrive, and on other links those heard last, which listeners hold."""
    last, now, history = before.reception, state.reception, before.late
    assert history is not None
    words = late.arriving_words(
        history, late.arrival(history, lane, time), lane, network.hearing, plan
    )
    assert last is not None
    assert last.words is not None
    assert now is not None
    if state.link_errors is not None:
        words = words.at[:, 0].add(word_errors(lane.gain, state.link_errors))
    ended = after_share(last.words, jnp.ones_like(time))
    ended = jnp.pad(ended[:, None], [(0, 0), (0, words.shape[1] - 1), *[(0, 0)] * 3])
    return jnp.where(now.arrived[None, None], words, ended)


def heard_jets(
    lane: Lane,
    network: Network,
    state: DecisionState,
    errors: Jets,
    signals: SignalJets,
    time: Instants,
    held: PerAxis | None,
) -> Received:
    """Return the jets on each link now, r of vehicles and r + 1 of the navigator; others are 0.

    Where vehicles tell the r-th derivative that they hold, `held`, there are r + 1 of them too.
    """
    navigator, order = lane.path(time)[: len(lane.gain) + 1, :, None], len(lane.gain)
    own = sensed(plane.plus(errors, navigator), state.noise)
    sent = [jnp.concatenate(both, axis=1) for both in zip(navigator, own, strict=False)]
    highest = jnp.zeros_like(own[0]) if held is None else held
    sent.append(jnp.concatenate([navigator[order], highest], axis=1))
    received = attack(network, tuple(sent), signals)
    if state.link_errors is not None:
        ahead = [received[order] + error for error in state.link_errors[max(3, order) :]]
        received = *plane.plus(received[:order], state.link_errors), *(ahead or [received[order]])
    leads = (network.hearing.sources == 0)[None, ..., None]
    return *received[:order], jnp.where(leads | (held is not None), received[order], 0.0)


def expanded(gain: control.Gain, jets: Received, interval: Instants) -> Words:
    """Return R of the Taylor polynomial of jets, as coefficients of σ^k / k!."""
    nothing = [jnp.zeros_like(jets[0])] * len(jets)
    rates = (control.driven(gain, [*jets[k:], *nothing]) for k in range(len(jets)))
    return jnp.stack([late.weighed(each, interval**k) for k, each in enumerate(rates)], axis=1)


def continued(
    words: Float[Array, "2 degrees *some lanes"], share: Instants
) -> Float[Array, "2 degrees *some lanes"]:
    """Return the coefficients of polynomials about a time that is later by a share of a tick."""
    return jnp.stack([after_share(words[:, k:], share) for k in range(words.shape[1])], axis=1)


def after_share(
    words: Float[Array, "2 degrees *some"], share: Float[Array, "*lanes"]
) -> Float[Array, "2 *some"]:
    """Return the values of polynomials after a share of a tick."""
    powers = signal.powers_of(share, words.shape[1])
    higher = (late.weighed(words[:, k], powers[k]) for k in range(1, len(powers)))
    return sum(higher, words[:, 0])


def messages_of(
    lane: Lane, network: Network, history: History | None, errors: Jets, time: Instants
) -> Messages:
    """Return the messages on their way at a tick."""
    sources, own = network.hearing.sources, errors[0]
    apart = plane.length(network.hearing.sent(tell(errors)[0]) - own[:, None])
    present = lane.weights > 0
    if history is not None:
        present = present & late.arrival(history, lane, time).came
    return Messages(time, sources, present, apart, lane.interval)


def keep_drive(
    lane: Lane,
    network: Network,
    plan: Plan,
    state: DecisionState,
    drive: PerAxis | None,
    standing: PerAxis,
) -> Coasting | None:
    """Return the vehicles that keep their drive: those that no believed message reaches.

    The drive of a vehicle that has stopped is `standing`, P of what it senses. `state` has the decisions of
    this tick, and the vehicles that kept their drive at the tick before. A vehicle that still keeps its drive
    keeps the same one. Under a local law, a vehicle that hears nobody has no drive, and others need no word
    from the navigator.
    """
    before = state.coasting
    if before is None or drive is None:
        return before
    off = cut_off(lane, network, state, plan) if coasts(lane) else jnp.zeros_like(before.cut_off)
    keeps = off
    if state.reception is not None:
        heard = weights_without_loss(lane, state, plan) > 0
        usable = usable_links(state.reception, plan)
        if usable is not None:
            heard = heard & usable[None]
        nobody = ~heard.any(axis=1)
        if not lane.law.couples():
            return before._replace(vehicles=nobody.all(axis=0))
        alone = nobody | off[None]
        keeps = (alone | ~network.hearing.reached(heard, alone)).any(axis=0)
    last, stopped = jnp.where(before.vehicles[None], before.drive, drive), before.stopped
    if stopped is not None:
        last = jnp.where(stopped.vehicles[None], standing, last)
    kept = xla.materialised(lambda: jnp.where(keeps[None], last, 0.0))
    return Coasting(keeps, kept, off, stopped)


def raise_alarms(
    lane: Lane, network: Network, state: DecisionState, errors: Jets, basis: Basis, time: Instants
) -> Detection | None:
    """Return the alarms after the words of this tick, None without a detector.

    A residual is what a link carries minus what its source tells, plus the errors of both. It is 0 plus the
    errors, to the last bit, where the link carries what the source tells.
    """
    if state.detection is None:
        return None
    sent, hearing = tell(sensed(errors, state.noise)), network.hearing
    carried = attack(network, sent, signal.jets(attack_vectors(lane, state), basis))
    residuals = tuple(one - hearing.sent(told) for one, told in zip(carried, sent, strict=True))
    if state.noise is not None:
        residuals = plane.plus(residuals, tuple(map(hearing.sent, tell(state.noise))))
    if state.link_errors is not None:
        residuals = plane.plus(residuals, state.link_errors)
    arrived = lane.weights > 0 if state.reception is None else state.reception.arrived
    return detection.detect(state.detection, lane, hearing, residuals, arrived, time)


def tell(errors: Jets) -> Sent:
    """Return the jets that the navigator and the vehicles send, each (2, 1 + m, lanes).

    The navigator's jets come first and are 0, because jets are relative to the navigator.
    """
    return tuple(jnp.concatenate([jnp.zeros_like(jet[:, :1]), jet], axis=1) for jet in errors)


def attack(network: Network, sent: Sent, signals: SignalJets) -> Received:
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
    signals, own = signal.jets(attack_vectors(lane, before), basis), sensed(errors, before.noise)
    heard = lane._replace(weights=arrived_weights(lane, before.reception))
    received, arrived = attack(network, tell(own), signals), None
    if before.late is not None:
        arrival = late.arrival(before.late, lane, time)
        received = late.arriving_jets(before.late, arrival, lane, network.hearing, lane.path(time))
    if before.link_errors is not None:
        received = plane.plus(received, before.link_errors)
    if before.reception is not None:  # a slot without a message holds the vehicle itself
        arrived = before.reception.arrived
        received = tuple(
            jnp.where(arrived[None], jet, mine[:, None])
            for jet, mine in zip(received, own, strict=False)
        )
    decision, memory = lane.defence.decide(
        own,
        lane.defence.observed(received, time),
        before.decision,
        before.memory,
        surroundings(heard, network, time, before.memory, signals, arrived, lane.weights > 0),
    )
    decision = of_heard(decision, lane)
    if before.reception is not None and before.decision is not None:
        decision = jnp.where(before.reception.arrived, decision, before.decision)
    return before._replace(decision=decision, memory=memory)


def arrived_weights(lane: Lane, reception: Reception | None) -> Float[Array, "slots m lanes"]:
    """Return the weights of the messages that arrived, with sum 1, or all 0 where none arrived."""
    if reception is None:
        return lane.weights
    arrived = jnp.where(reception.arrived, lane.weights, 0.0)
    total = arrived.sum(axis=0, keepdims=True)
    return arrived / jnp.where(total > 0, total, 1.0)


def drive(lane: Lane, state: DecisionState, plan: Plan) -> Drive:
    """Return what the motion follows after these decisions."""
    weights, vectors = weights_in_force(lane, state, plan), attack_vectors(lane, state)
    strength = row_strength(lane, state, plan)
    known = known_now(lane, state, plan, weights) if state.late is None else state.known
    live = weights if lane.delay is None else jnp.zeros_like(weights)
    return Drive(live, vectors, state.noise, state.coasting, strength, known)


def with_known(lane: Lane, network: Network, state: DecisionState, plan: Plan) -> DecisionState:
    """Return the state with what late words add to the drives."""
    if state.late is None or state.reception is None:
        return state
    heard, history, reception = weights_in_force(lane, state, plan), state.late, state.reception
    known = constant_drive(lane, state, heard, late.word_degrees(lane))
    if reception.words is None:
        arrival = late.arrival(history, lane, reception.time)
        drive = late.mean_words(history, arrival, lane, network.hearing, plan, heard, known.drive)
    else:
        drive = plus_slots(known.drive, heard, slot_of(reception.words))
    share = heard.sum(axis=1)
    share = share if known.share is None else share + known.share
    return state._replace(known=KnownDrive(share, drive, lane.interval, reception.time))


def known_now(lane: Lane, state: DecisionState, plan: Plan, live: AxisWeights) -> KnownDrive | None:
    """Return what known words add until the next tick where no word is late, None where there are none.

    `live` are the weights of the words that arrive.
    """
    reception, coasting = state.reception, None if not lane.law.couples() else state.coasting
    if reception is None or reception.words is None:
        if coasting is None and state.link_noise is None:
            return None
        return constant_drive(lane, state, live, 1)
    given = jnp.where(reception.arrived[None], 0.0, weights_without_loss(lane, state, plan))
    given = given if coasting is None else jnp.where(coasting.vehicles[None, None], 0.0, given)
    known = constant_drive(lane, state, live, reception.words.shape[1])
    share = given.sum(axis=1)
    share = share if known.share is None else share + known.share
    drive = plus_slots(known.drive, given, slot_of(reception.words))
    return KnownDrive(share, drive, lane.interval, reception.time)


def constant_drive(
    lane: Lane, state: DecisionState, heard: AxisWeights, degrees: int
) -> KnownDrive:
    """Return what kept drives, and errors of the words with weights `heard`, add until the next tick."""
    coasting, reception = None if not lane.law.couples() else state.coasting, state.reception
    share, drive = None, jnp.zeros((2, *heard.shape[2:]))
    if coasting is not None:
        share = jnp.broadcast_to(coasting.vehicles[None].astype(float), heard[:, 0].shape)
        drive = coasting.drive
    if state.link_errors is not None and (reception is None or reception.heard is None):
        drive = drive + (heard * word_errors(lane.gain, state.link_errors)).sum(axis=1)
    rest = jnp.zeros((2, degrees - 1, *drive.shape[1:]))
    return KnownDrive(share, jnp.concatenate([drive[:, None], rest], axis=1), lane.interval)


def slot_of(words: Words) -> Callable[[LoopIndex], Float[Array, "2 degrees m lanes"]]:
    """Return the function that gives the words of a slot."""
    return lambda slot: jax.lax.dynamic_index_in_dim(words, slot, axis=2, keepdims=False)


def row_strength(
    lane: Lane, state: DecisionState, plan: Plan
) -> Float[Array, "axes m lanes"] | None:
    """Return how strongly each vehicle follows those that it retains and hears, None where it is 1."""
    lane = with_network(lane, state.network)
    if lane.strength is None:
        return None
    weights = link_weights(lane, state)[None]
    if plan.decides:
        believed = retained.support(state.decision).reshape(-1, *lane.weights.shape)
        weights = jnp.where(believed, weights, 0.0)
    usable = None if state.reception is None else usable_links(state.reception, plan)
    if usable is not None:
        weights = jnp.where(usable[None], weights, 0.0)
    return lane.strength.of(weights.sum(axis=1))


def sight(
    lane: Lane,
    network: Network,
    plan: Plan,
    state: DecisionState,
    errors: Jets,
    basis: Basis,
    time: Instants,
) -> Seen:
    """Return the view of a strategic attacker at a tick: everything but the channel of the tick."""

    def in_force(vectors: Vectors) -> AxisWeights:
        chosen = state._replace(vectors=bounded(vectors, lane), reception=None, link_noise=None)
        judged = judge(lane, network, plan, chosen, errors, basis, time)
        zero = jnp.zeros_like(errors[0])
        kept = keep_drive(lane, network, plan, judged, zero, zero) if coasts(lane) else None
        return weights_in_force(lane, judged._replace(coasting=kept), plan)

    heard, decision = network.hearing, state.decision
    if decision is None:
        decision = jnp.ones(lane.weights.shape, bool)
    rest = basis, time, lane.attack_scale, in_force
    return Seen(errors, decision, lane.weights, heard.sources, heard.attacked, *rest)


def surroundings(
    lane: Lane,
    network: Network,
    time: Instants,
    memory: Memory,
    signals: SignalJets | None = None,
    arrived: Bool[Array, "slots m lanes"] | None = None,
    linked: Bool[Array, "slots m lanes"] | None = None,
) -> Neighbourhood:
    """Return the inputs of a defence besides the received jets; `signals` are the attacks' jets."""
    heard, trusted = network.hearing, network.trusted
    attacked = (heard.added(jnp.abs(lane.vectors).sum(axis=2)) != 0).any(axis=0)
    announced = None if signals is None else lane.defence.announcement(memory)
    if announced is not None:
        sent = jnp.concatenate([jnp.zeros_like(announced[:, :1]), announced], axis=1)
        carried = heard.received(sent, control.driven(lane.gain, signals))
        announced = lane.announces.received(
            heard.sent(sent), carried, attacked, heard.signals, time
        )
        announced = lane.defence.overheard(announced, heard.sources, time)
    rest = (
        network.shared,
        announced,
        attacked,
        arrived,
        lane.weights > 0 if linked is None else linked,
    )
    return Neighbourhood(heard.sources, lane.weights, trusted, lane.gain, time, *rest)


def of_heard(decision: Decision, lane: Lane) -> Decision:
    """Return a decision in which slots of sources that the lane does not hear never count."""
    heard = jnp.broadcast_to(lane.weights > 0, decision.shape)
    return decision | ~heard if decision.dtype == bool else jnp.where(heard, decision, 0.0)


def bounded(vectors: Vectors, lane: Lane) -> Vectors:
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


def link_weights(lane: Lane, state: DecisionState) -> Float[Array, "slots m lanes"]:
    """Return the weights of the links until the next tick."""
    return lane.weights if state.weights is None else state.weights


def weights_in_force(lane: Lane, state: DecisionState, plan: Plan) -> AxisWeights:
    """Return the weights until the next tick, of messages that arrived and that vehicles retain.

    They are 0 for a vehicle that keeps its drive. They sum to less than 1 where words stand in for lost ones.
    """
    weights, coasting = weights_without_loss(lane, state, plan), state.coasting
    if state.reception is not None:
        usable = usable_links(state.reception, plan)
        counting = state.reception.arrived if usable is None else usable
        weights = jnp.where(counting[None], weights, 0.0)
        if usable is not None:
            total = weights.sum(axis=1, keepdims=True)
            weights = weights / jnp.where(total > 0, total, 1.0)
    return weights if coasting is None else jnp.where(coasting.vehicles[None, None], 0.0, weights)


def usable_links(reception: Reception, plan: Plan) -> Bool[Array, "slots m lanes"] | None:
    """Return the links with a word, live, late or held; None where a word stands in on every other link."""
    if plan.missing == "drop":
        return reception.arrived
    return reception.heard


def weights_without_loss(lane: Lane, state: DecisionState, plan: Plan) -> AxisWeights:
    """Return the weights that would be in force if every message had arrived.

    Under a local law, a vehicle that retains nobody has weights 0; under others, not-a-number.
    """
    lane = with_network(lane, state.network)
    links = link_weights(lane, state)
    if not plan.decides:
        return links[None]
    weights = retained.in_force(links, state.decision)
    if lane.law.couples():
        return weights
    believed = retained.support(state.decision).reshape(weights.shape) & (links > 0)[None]
    return jnp.where(believed.any(axis=1, keepdims=True), weights, 0.0)


def cut_off(lane: Lane, network: Network, state: DecisionState, plan: Plan) -> VehicleFlags:
    """Return the vehicles that decisions alone, without any loss, cut off from the navigator.

    A vehicle that has stopped passes on nothing that it hears.
    """
    weights = weights_without_loss(lane, state, plan)
    heard, alone = weights > 0, (weights == 0).all(axis=1)
    if state.coasting is not None and state.coasting.stopped is not None:
        on_its_way = ~state.coasting.stopped.vehicles[None]
        heard, alone = heard & on_its_way[:, None], alone & on_its_way
    return ~network.hearing.reached(heard, alone).all(axis=0)


def disconnected(lane: Lane, network: Network, state: DecisionState, plan: Plan) -> LaneFlags:
    """Return the lanes that fail because decisions alone cut a vehicle off from the navigator.

    No lane fails where such vehicles coast, or under a local law, which has a solution all the same, or where
    networks take turns.
    """
    if not lane.law.couples() or coasts(lane) or lane.turns is not None:
        return jnp.zeros(lane.attack_scale.shape, bool)
    return cut_off(lane, network, state, plan).any(axis=0)


def changes(
    now: DecisionState, before: DecisionState, lane: Lane
) -> tuple[LaneFlags, VehicleFlags]:
    """Return the lanes in which a decision changed, and the vehicles whose retained sources changed."""
    lanes, others = (
        jnp.zeros(lane.attack_scale.shape, bool),
        jnp.zeros(lane.weights.shape[1:], bool),
    )
    if now.decision is not None:
        supports = [retained.support(one.decision) for one in (now, before)]
        others = xla.materialised(
            lambda: retained.changed(*supports)
        )  # 2.7 times, W-MSR, 12 vehicles
        lanes = xla.in_any_row(others)
        if now.decision.dtype != bool:
            lanes = xla.in_any_row(now.decision != before.decision)
    if now.reception is not None and before.reception is not None:
        lanes = lanes | xla.in_any_row(now.reception.arrived != before.reception.arrived)
        if now.reception.words is not None and now.late is None:
            moved = (now.reception.words != before.reception.words) & ~now.reception.arrived[
                None, None
            ]
            lanes = lanes | xla.in_any_row(moved)
    if now.link_noise is not None or now.late is not None:
        lanes = jnp.ones_like(lanes)
    if (
        now.coasting is not None
        and now.coasting.stopped is not None
        and before.coasting is not None
    ):
        told = (now.coasting.drive != before.coasting.drive) & now.coasting.stopped.vehicles[None]
        lanes = lanes | xla.in_any_row(told)
    if now.network is not None and before.network is not None:
        lanes = lanes | (now.network != before.network)
    if now.vectors is not None and before.vectors is not None:
        lanes = lanes | xla.in_any_row(now.vectors != before.vectors)
    if now.weights is not None and before.weights is not None:
        lanes = lanes | xla.in_any_row(now.weights != before.weights)
    return lanes, others


def drive_along(
    lane: Lane,
    states: Float[Array, "n m lanes"],
    rates: Float[Array, "n m lanes"],
    noise: Jets | None,
) -> PerAxis:
    """Return the drive `z = y‴ + P(ŷ)` of vehicles whose states change at these rates."""
    own, (*_, jerk) = jax.jvp(lane.vehicle.output_jets, (states,), (rates,))
    return jerk + control.feedback(lane.gain, sensed(own, noise))


def exchange(
    lane: Lane,
    network: Network,
    drive: Drive,
    own: Jets,
    told: Told,
    last: PerAxis,
) -> PerAxis:
    """Return the r-th derivative that vehicles hold until the next tick, under a law that holds one.

    `own` are a vehicle's own jets of y, and `last` is the derivative held until now, which a vehicle that
    hears nobody still holds.
    """
    own, weights = sensed(own, drive.noise), drive.weights
    if not lane.law.couples():
        demand = followed_demand(lane, network, drive, own, told.navigator, told.basis, told.time)
    else:
        attack = signal.combined(control.drive_vectors(lane.gain, drive.vectors), told.functions)
        demand = control.demand(own, told.path, attack, network.hearing, weights, lane.gain)
        demand = demand if drive.known is None else demand + drive.known.drive[:, 0]
    if drive.coasting is not None and lane.law.couples():
        demand = jnp.where(drive.coasting.vehicles[None], last, demand)
        if drive.coasting.stopped is not None:
            demand = jnp.where(drive.coasting.stopped.vehicles[None], 0.0, demand)

    def heard(jerk: PerAxis) -> PerAxis:
        sources = jnp.concatenate([jnp.zeros_like(jerk[:, :1]), jerk], axis=1)
        return network.hearing.mean(weights, sources, jnp.zeros_like(drive.vectors[:, :, 0]))

    return lane.law.exchange(last, demand, heard)


def followed_demand(
    lane: Lane,
    network: Network,
    drive: Drive,
    own: Jets,
    navigator: Float[Array, "jets 2 lanes"],
    basis: Basis,
    time: Instants,
) -> PerAxis:
    """Return the r-th derivative that the local law asks for; `own` are the jets that vehicles sense."""
    attack, known = signal.jets(drive.vectors, basis), drive.known
    silent = (drive.weights == 0).all(axis=1)
    if known is not None and known.share is not None:
        silent = silent & (known.share == 0)
    demand = control.local_demand(own, navigator, attack, network.hearing, drive.weights, lane.gain)
    demand = jnp.where(silent, 0.0, demand)
    demand = demand if known is None else demand + known.at(time)
    return demand if drive.strength is None else drive.strength * demand
