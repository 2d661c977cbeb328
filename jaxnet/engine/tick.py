"""A tick, the same in every engine: sense → tell → attack → channel → alarms → judge → drive.

    sense    a vehicle senses its own jets, with errors that stay the same until the next tick
    tell     a vehicle sends the jets that it senses; a defence may announce more
    attack   strategic attackers choose their vectors; attacked links carry false jets
    channel  messages are delayed, lost, or get errors; others stand in for lost and cut ones
    alarms   messages are tested; an alarm may cut a message, or a link
    judge    a vehicle decides which sources to retain, by jets with the noise of its defence
    drive    weights, the attacks' vectors, errors and kept drives, until the next tick

Each stage is an object in `stages`, part of the state of a lane, which the tick replaces by the
next one. A stage that is off is an object of the base class, which changes nothing. Lanes are last.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine.moment import Instants, LaneFlags, Moment, PerAxis, VehicleFlags
from jaxnet.engine.plan import Plan
from jaxnet.engine.stages import anchoring, coasting, detection, judging
from jaxnet.engine.stages.anchoring import Anchor, Pull
from jaxnet.engine.stages.channel import (
    Lossy,
    Reception,
    Speakers,
    drives_told,
    first_reception,
    held_derivative,
)
from jaxnet.engine.stages.coasting import Coasting, first_coasting
from jaxnet.engine.stages.known import Known, KnownDrive
from jaxnet.engine.stages.late import Late, OnTime, first_late, motion_told
from jaxnet.engine.stages.links import LinkErrors, first_link_errors
from jaxnet.engine.stages.sensing import Sensed, first_sensed
from jaxnet.kinds.shapes import Decision, Memory
from jaxnet.model import xla
from jaxnet.model.hearing import AxisWeights
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.model.polynomial import Polynomial
from jaxnet.model.signal import Basis, Vectors

SILENCE = 1e-300  # of ā, in each component: no position changes by it


class Strength(eqx.Module):
    """How strongly vehicles follow those whom they retain and hear (`model.retained`)."""

    each: Float[Array, "axes m lanes"] | None = None  # of rows of weights; None: 1

    def times(self, demand: PerAxis) -> PerAxis:
        return demand if self.each is None else self.each * demand

    def greatest(self, lane: Lane) -> Instants:
        """Greatest strength of any row of a lane."""
        return jnp.ones_like(lane.attack_scale) if self.each is None else self.each.max(axis=(0, 1))

    def rows(self, weights: AxisWeights) -> Float[Array, "axes m lanes"]:
        if self.each is None:
            return jnp.ones((len(weights), *weights.shape[2:]))
        return self.each


class Drive(NamedTuple):
    """What the motion follows from one tick to the next."""

    weights: AxisWeights  # of live messages; 0 for a vehicle that keeps its drive
    vectors: Vectors  # of the attacks [m]
    sensed: Sensed
    coasting: Coasting
    strength: Strength
    known: Known


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


class DecisionState(eqx.Module):
    """Decisions of one tick, and the memory of all stages."""

    instead: dict[str, Any]  # fields of the lane that this tick replaces
    plot: Memory  # of strategic attackers
    sensed: Sensed
    links: LinkErrors
    late: OnTime
    heard: Reception
    alarms: detection.Alarms
    judged: judging.Judged
    coasting: Coasting
    anchor: Anchor

    def of(self, lane: Lane) -> Lane:
        """The lane with what is in force until the next tick."""
        return lane._replace(**self.instead)

    def weights(self, lane: Lane) -> AxisWeights:
        """Weights until the next tick, of messages that arrived and that vehicles retain.

        They are 0 for a vehicle that keeps its drive. They sum to less than 1 where messages stand
        in for lost ones.
        """
        weights = self.judged.in_force(self.of(lane))
        return self.coasting.moving(self.heard.in_force(weights))

    def listened(self, lane: Lane) -> AxisWeights:
        """Weights until the next tick; a substituted message has the weight of its source."""
        weights = self.judged.in_force(self.of(lane))
        return self.coasting.moving(self.heard.listened(weights))

    def drive(self, lane: Lane) -> Drive:
        """What the motion follows after these decisions."""
        weights, lane = self.weights(lane), self.of(lane)
        if isinstance(self.late, Late):
            weights, known = jnp.zeros_like(weights), self.late.known
        else:
            known = self.live_known(lane, weights)
        weights, known, strength = self.held(lane, weights, known)
        return Drive(weights, lane.vectors, self.sensed, self.coasting, strength, known)

    def held(
        self, lane: Lane, weights: AxisWeights, known: Known
    ) -> tuple[AxisWeights, Known, Strength]:
        """Weights, known drives and strengths, of vehicles that may be held to their starts."""
        strength = self.row_strength(lane)
        if not self.anchor.present:
            return weights, known, strength
        pull = self.anchor.held(lane, Pull(weights, known, strength.rows(weights)))
        return pull.weights, pull.known, Strength(pull.strength)

    def row_strength(self, lane: Lane) -> Strength:
        if lane.strength is None:
            return Strength()
        retained = self.heard.usable(self.judged.believed(lane))
        return Strength(lane.strength.of(retained.sum(axis=1)))

    def live_known(self, lane: Lane, weights: AxisWeights) -> Known:
        """Known part of the drives until the next tick, where no message is delayed."""
        if not (self.heard.stands or self.coasting.drives or self.links.present):
            return Known()
        constant = self.constant_drive(lane, weights)
        return self.heard.known(self.coasting.moving(self.judged.in_force(lane)), constant)

    def constant_drive(self, lane: Lane, weights: AxisWeights) -> KnownDrive:
        """Kept drives, and errors of the messages with these weights, until the next tick."""
        drive, share = self.coasting.drive(lane), self.coasting.share(weights)
        if not (self.late.present and self.heard.stands):  # such messages have errors in them
            drive = self.links.of_mean(lane.gain, weights, drive)
        begin = jnp.zeros_like(lane.interval)
        return KnownDrive(Polynomial(drive[None]), share, lane.interval, begin)

    def late_known(self, now: Moment) -> KnownDrive:
        """Drives until the next tick where all messages are delayed."""
        assert isinstance(self.late, Late)
        assert isinstance(self.heard, Lossy)
        weights = self.weights(now.lane)
        constant = self.constant_drive(now.lane, weights)
        drive = self.heard.delayed(now, self.late, weights, constant.drive.terms)
        share = weights.sum(axis=1) + constant.share
        found = replace(constant, drive=Polynomial(drive), share=share, time=now.time)
        return replace(found, relative=now.plan.own_delay)

    def disconnected(self, lane: Lane, network: Network) -> LaneFlags:
        """Lanes that fail because decisions alone cut a vehicle off from the navigator.

        No lane fails where such vehicles coast, or where networks take turns, or under a law that
        has a solution all the same.
        """
        if not lane.law.couples() or coasting.coasts(lane) or lane.turns is not None:
            return jnp.zeros(lane.attack_scale.shape, bool)
        return self.cut_off(lane, network).any(axis=0)

    def cut_off(self, lane: Lane, network: Network) -> VehicleFlags:
        """Vehicles that decisions alone cut off from the navigator."""
        return coasting.cut_off(self.of(lane), network, self.judged, self.coasting)

    def changes(self, before: "DecisionState", lane: Lane) -> tuple[LaneFlags, VehicleFlags]:
        """Lanes in which anything changed, and vehicles whose retained sources did."""
        lanes, vehicles = self.judged.changed(before.judged, lane)
        if self.links.present or self.late.present:
            return jnp.ones_like(lanes), vehicles
        lanes = self.heard.changed(before.heard, lanes)
        lanes = self.coasting.changed(before.coasting, lanes)
        lanes = self.anchor.changed(before.anchor, lanes)
        for now, then in zip(*map(jax.tree.leaves, (self.instead, before.instead)), strict=True):
            lanes = lanes | xla.in_any_row(now != then)
        return lanes, vehicles


def before_first(lane: Lane, network: Network, plan: Plan) -> DecisionState:
    """State before the first tick: every vehicle retains every source, every message arrived."""
    time, zero = jnp.zeros_like(lane.attack_scale), jnp.zeros_like(lane.initial[:2])
    alarms = detection.first_alarms(lane, network.hearing)
    errors = (zero,) * len(lane.gain)
    told = zero if lane.defence.hears_messages() else None
    now = Moment(lane, network, plan, errors, lane.basis(time), time, zero, told)
    late = first_late(lane, plan)
    given = lane.instead(time) | ({"vectors": lane.vectors} if plan.strategic else {})
    state = DecisionState(
        instead=alarms.instead(lane, given, time),
        plot=None,
        sensed=first_sensed(lane),
        links=first_link_errors(lane),
        late=late,
        heard=first_reception(now, late),
        alarms=alarms,
        judged=judging.first_judged(now),
        coasting=first_coasting(lane),
        anchor=anchoring.first_anchor(lane),
    )
    if isinstance(late, Late):
        state = replace(state, late=replace(late, known=state.late_known(now)))
    if plan.strategic:
        state = replace(state, plot=lane.signal.begin(sight(now, state)))
    return state


def decide(now: Moment, before: DecisionState) -> DecisionState:
    lane = now.lane
    given = lane.instead(now.time)
    instead = before.alarms.instead(lane, given, now.time)
    sensed, anchor = before.sensed.next(now), before.anchor.next(now)
    state = replace(before, sensed=sensed, anchor=anchor, instead=instead)
    now = now._replace(lane=state.of(lane))
    if lane.defence.hears_messages():
        now = now._replace(told=drives_told(now, before.sensed, state.sensed))
    if now.plan.strategic:
        vectors, plot = lane.signal.aim(sight(now, state), state.plot)
        vectors = bounded(vectors, now.lane)
        now = now._replace(lane=now.lane._replace(vectors=vectors))
        given = given | {"vectors": vectors}
        state = replace(state, plot=plot)
    links, then = before.links.next(now, state.sensed), now._replace(lane=before.of(lane))
    if now.plan.engine.samples:  # nothing that is said after a tick is heard
        time = jnp.maximum(now.time - lane.interval, 0.0)
        then = then._replace(time=time, basis=lane.basis(time))
    spoke = Speakers(then.time, then.signals, before.sensed, before.links)
    speaking = Speakers(now.time, now.signals, state.sensed, links)
    came = before.heard.arriving(now, before.late)
    whole = lane._replace(**given)
    alarms = before.alarms.next(now, state.sensed, links, before.late, came, whole)
    state = replace(state, instead=alarms.instead(lane, given, now.time), alarms=alarms)
    now = now._replace(lane=state.of(lane))
    came = came.without(alarms.cut_messages)
    heard = before.heard.next(now, before.late, spoke, speaking, came)
    judged = before.judged.next(now, state.sensed, before.late, links, heard)
    kept = before.coasting.next(now, judged, heard, state.sensed)
    state = replace(state, links=links, heard=heard, judged=judged, coasting=kept)
    return replace(state, late=send(now, before, state))


def send(now: Moment, before: DecisionState, state: DecisionState) -> OnTime:
    """What links carry from this tick to the next, where it is heard later."""
    if not isinstance(state.late, Late):
        return state.late
    lane, law, known = now.lane, now.lane.law, state.late_known(now)
    told = (known.drive.terms,)
    if law.needs_ticks():
        held = held_derivative(now, before.sensed) if law.couples() else jnp.zeros_like(now.last)
        told = tuple(jet[None] for jet in (*state.sensed.of(now.own), held))
    elif law.tells_motion(now.plan.extrapolate != "none"):
        _, held, strength = state.held(lane, jnp.zeros_like(state.weights(lane)), known)
        assert isinstance(held, KnownDrive)
        follows = 1.0
        if held.relative:
            now = now._replace(lane=lane._replace(gain=0.0 * lane.gain))
        if not law.couples():
            follows = (held.share > 0).astype(float)
        told = motion_told(
            now, held.drive, state.sensed, lambda demand: strength.times(follows * demand)
        )
    lost = jnp.zeros_like(lane.weights, bool)
    if (lane.loss is not None or lane.alarms_cut) and state.heard.arrivals is not None:
        lost = state.late.arrival(now).came & ~state.heard.arrivals
    return state.late.send(now, state.sensed, lost, known, told)


def sight(now: Moment, state: DecisionState) -> Seen:
    """View of a strategic attacker at a tick: everything but the channel of the tick."""
    lane, hearing = now.lane, now.network.hearing

    def in_force(vectors: Vectors) -> AxisWeights:
        there = now._replace(lane=lane._replace(vectors=bounded(vectors, lane)))
        judged = state.judged.next(there, state.sensed, state.late, LinkErrors(), Reception())
        weights = judged.in_force(there.lane)
        if not coasting.coasts(lane):
            return weights
        return state.coasting.next(there, judged, Reception(), state.sensed).moving(weights)

    return Seen(
        now.errors,
        state.judged.seen(lane),
        lane.weights,
        hearing.sources,
        hearing.attacked,
        now.basis,
        now.time,
        lane.attack_scale,
        in_force,
    )


def bounded(vectors: Vectors, lane: Lane) -> Vectors:
    """Vectors scaled to ā; a norm over 1 is scaled down to 1.

    The Frobenius norm is no less than the spectral norm. The vectors are divided by their greatest
    component first, because the square of a large number is infinite. An attacked vehicle that
    sends 0 sends `SILENCE` ā instead, because links with a signal count as attacked.
    """
    vectors = jnp.where((vectors != 0).any(axis=(0, 2), keepdims=True), vectors, SILENCE)
    greatest = jnp.maximum(1.0, jnp.abs(vectors).max(axis=(0, 2), keepdims=True))
    unit = vectors / greatest
    norm = jnp.sqrt((unit**2).sum(axis=(0, 2), keepdims=True))
    unit = unit / jnp.maximum(1.0 / greatest, norm)
    attacked = (lane.vectors != 0).any(axis=(0, 2), keepdims=True)
    return jnp.where(attacked, lane.attack_scale[None, None, None] * unit, 0.0)
