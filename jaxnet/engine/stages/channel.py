"""Channel: messages are lost or late, and others may stand in for them.

A lost message is replaced here (`Substituted`): by the message that was heard last, held or
continued by Taylor. A message that was live until now is heard for the last time now. Where a law
holds a derivative, vehicles hear messages at ticks alone. Other messages are continued; late ones
stay as they were when their tick ended.
"""

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.engine.moment import Instants, LaneFlags, LinkFlags, Moment, PerAxis, Received, tell
from jaxnet.engine.plan import Plan
from jaxnet.engine.stages.known import KnownDrive
from jaxnet.engine.stages.late import Late, OnTime, late_degrees
from jaxnet.engine.stages.links import LinkErrors
from jaxnet.engine.stages.sensing import Sensed
from jaxnet.kinds.losses import Messages
from jaxnet.kinds.shapes import Decision, Memory
from jaxnet.model import control, plane, polynomial, xla
from jaxnet.model.control import Gain
from jaxnet.model.hearing import AxisWeights, plus_slots
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Jets
from jaxnet.model.polynomial import Polynomial

# Coefficients of what stands in for a lost message, for vehicles of an order.
MISSING = {"drop": lambda order: 0, "hold": lambda order: 1, "extrapolate": lambda order: order + 1}


class Speakers(NamedTuple):
    """What vehicles and attackers say in a tick, for messages that are heard at its end."""

    signals: Jets
    sensed: Sensed
    links: LinkErrors


class Reception(eqx.Module):
    """Messages of a tick: all arrive, live."""

    lossy: ClassVar[bool] = False  # whether a message may be missing
    stands: ClassVar[bool] = False  # whether others stand in for missing ones
    errs: ClassVar[bool] = True  # whether errors of links come on top of what is heard

    @property
    def degrees(self) -> int:
        """Coefficients of what is known of live messages until the next tick."""
        return 1

    def since(self, lane: Lane) -> Instants:
        """Time of the tick, where anything depends on it [s]."""
        return jnp.zeros_like(lane.interval)

    def next(self, now: Moment, late: OnTime) -> "Reception":
        """The messages that arrive at a tick."""
        return self

    def listen(
        self, now: Moment, last: "Reception", late: OnTime, spoke: Speakers, speak: Speakers
    ) -> "Reception":
        """Messages of this tick, with the substitutes that act from now on.

        `last` are those of the tick before, in which vehicles `spoke` as told.
        """
        return self

    def there(self, sent: LinkFlags) -> LinkFlags:
        """Links, of some, on which a live or late message arrived."""
        return sent

    def judged_weights(
        self, weights: Float[Array, "slots m lanes"]
    ) -> Float[Array, "slots m lanes"]:
        """Weights of the messages that arrived, with sum 1, or all 0 where none arrived."""
        return weights

    def judged(self, received: Received, own: Jets) -> Received:
        """Jets that a vehicle judges; a slot without a message holds the vehicle itself."""
        return received

    def believed(self, decision: Decision, before: Decision) -> Decision:
        """A decision, where slots without a message keep that before."""
        return decision

    @property
    def arrivals(self) -> LinkFlags | None:
        """Messages that arrived, as a defence is told: None where all do."""
        return None

    def usable(self, weights: AxisWeights) -> AxisWeights:
        """Weights of links with any message, live or not."""
        return weights

    def in_force(self, weights: AxisWeights) -> AxisWeights:
        """Weights in force. They sum to less than 1 where others stand in for lost messages."""
        return weights

    def listened(self, weights: AxisWeights) -> AxisWeights:
        """Weights of the sources that count; a substituted message has that of its source."""
        return self.in_force(weights)

    def known(self, weights: AxisWeights, constant: KnownDrive) -> KnownDrive:
        """A known drive with what replaces live messages; `weights` are those without any loss."""
        return constant

    def mean(self, now: Moment, late: Late, weights: AxisWeights, start: Polynomial) -> Polynomial:
        """A drive plus the late messages, by weight."""
        return late.mean(now, weights, start)

    def changed(self, before: "Reception", lanes: LaneFlags) -> LaneFlags:
        """Lanes, with some, in which what is heard changed."""
        return lanes


class Lossy(Reception):
    """Messages of which some are lost. Nothing stands in for them."""

    arrived: LinkFlags
    memory: Memory  # of the loss
    time: Instants  # of the tick [s]

    lossy: ClassVar[bool] = True

    def since(self, lane: Lane) -> Instants:
        return self.time

    def next(self, now: Moment, late: OnTime) -> "Reception":
        messages, memory = messages_of(now, late), None
        arrived = messages.present
        if now.lane.loss is not None:
            lost, memory = now.lane.loss.lost(messages, self.memory)
            arrived = xla.materialised(lambda: messages.present & ~lost)
        return self.arriving(arrived, memory, now.time)

    def arriving(self, arrived: LinkFlags, memory: Memory, time: Instants) -> "Reception":
        return Lossy(arrived, memory, time)

    def there(self, sent: LinkFlags) -> LinkFlags:
        return sent & self.arrived

    def judged_weights(
        self, weights: Float[Array, "slots m lanes"]
    ) -> Float[Array, "slots m lanes"]:
        return with_sum_one(jnp.where(self.arrived, weights, 0.0), axis=0)

    def judged(self, received: Received, own: Jets) -> Received:
        each = zip(received, own, strict=False)
        return tuple(jnp.where(self.arrived[None], jet, mine[:, None]) for jet, mine in each)

    def believed(self, decision: Decision, before: Decision) -> Decision:
        return jnp.where(self.arrived, decision, before)

    @property
    def arrivals(self) -> LinkFlags | None:
        return self.arrived

    def usable(self, weights: AxisWeights) -> AxisWeights:
        return jnp.where(self.arrived[None], weights, 0.0)

    def in_force(self, weights: AxisWeights) -> AxisWeights:
        return with_sum_one(self.usable(weights), axis=1)

    def changed(self, before: "Reception", lanes: LaneFlags) -> LaneFlags:
        assert isinstance(before, Lossy)
        return lanes | xla.in_any_row(self.arrived != before.arrived)


class Substituted(Lossy):
    """Messages for which others stand in where they are lost."""

    messages: Polynomial

    stands: ClassVar[bool] = True

    @property
    def degrees(self) -> int:
        return len(self.messages.terms)

    def arriving(self, arrived: LinkFlags, memory: Memory, time: Instants) -> "Reception":
        return Substituted(arrived, memory, time, self.messages)

    def listen(
        self, now: Moment, last: Reception, late: OnTime, spoke: Speakers, speak: Speakers
    ) -> Reception:
        assert isinstance(last, Substituted)
        lane, degrees = now.lane, len(last.messages.terms)
        speakers, heard = spoke, last.arrived
        if lane.law.needs_ticks():
            speakers, heard = speak, self.arrived | (now.time <= 0)[None, None]
        holds = now.plan.missing == "hold"
        if holds and lane.law.solves():
            path = control.driven(lane.gain, now.navigator)
            sources = jnp.concatenate([path[:, None], now.last], axis=1)
            lies = control.driven(lane.gain, speakers.signals)
            fresh = now.network.hearing.received(sources, lies)
            fresh = spoke.links.of_message(lane.gain, fresh)[None]
        else:
            told = holds and lane.law.couples() and lane.law.needs_ticks()
            held = held_derivative(now, spoke.sensed) if told else None
            jets = heard_jets(now, speakers, held)
            fresh = expanded(lane.gain, jets, lane.interval)[:degrees]
        continued = last.messages.about(jnp.ones_like(now.time)).terms
        messages = Polynomial(jnp.where(heard[None, None], fresh, continued))
        return Substituted(self.arrived, self.memory, self.time, messages)

    def usable(self, weights: AxisWeights) -> AxisWeights:
        return weights

    def in_force(self, weights: AxisWeights) -> AxisWeights:
        return jnp.where(self.arrived[None], weights, 0.0)

    def listened(self, weights: AxisWeights) -> AxisWeights:
        return self.usable(weights)

    def known(self, weights: AxisWeights, constant: KnownDrive) -> KnownDrive:
        weights = jnp.where(self.arrived[None], 0.0, weights)
        drive = Polynomial(plus_slots(constant.drive.terms, weights, self.slot))
        share = weights.sum(axis=1) + constant.share
        return KnownDrive(drive, share, constant.interval, self.time)

    def mean(self, now: Moment, late: Late, weights: AxisWeights, start: Polynomial) -> Polynomial:
        return Polynomial(plus_slots(start.terms, weights, self.slot))

    def slot(self, slot: Array) -> Float[Array, "degrees 2 m lanes"]:
        terms = self.messages.terms
        return jax.lax.dynamic_index_in_dim(terms, slot, axis=2, keepdims=False)

    def changed(self, before: Reception, lanes: LaneFlags) -> LaneFlags:
        assert isinstance(before, Substituted)
        moved = (self.messages.terms != before.messages.terms) & ~self.arrived[None, None]
        return super().changed(before, lanes) | xla.in_any_row(moved)


class SubstitutedLate(Substituted):
    """Late messages; those heard last stand in where none arrives."""

    heard: LinkFlags  # links on which a message has ever arrived

    errs: ClassVar[bool] = False

    def arriving(self, arrived: LinkFlags, memory: Memory, time: Instants) -> "Reception":
        return SubstitutedLate(arrived, memory, time, self.messages, self.heard | arrived)

    def listen(
        self, now: Moment, last: Reception, late: OnTime, spoke: Speakers, speak: Speakers
    ) -> Reception:
        assert isinstance(last, Substituted)
        assert isinstance(late, Late)
        fresh = late.messages(now).terms
        fresh = fresh.at[0].set(speak.links.of_message(now.lane.gain, fresh[0]))
        ended = last.messages.at(jnp.ones_like(now.time))[None]
        ended = jnp.pad(ended, [(0, len(fresh) - 1), *[(0, 0)] * 4])
        messages = Polynomial(jnp.where(self.arrived[None, None], fresh, ended))
        return SubstitutedLate(self.arrived, self.memory, self.time, messages, self.heard)

    def usable(self, weights: AxisWeights) -> AxisWeights:
        return jnp.where(self.heard[None], weights, 0.0)

    def in_force(self, weights: AxisWeights) -> AxisWeights:
        return with_sum_one(self.usable(weights), axis=1)

    def listened(self, weights: AxisWeights) -> AxisWeights:
        return self.in_force(weights)


def first_reception(now: Moment, late: OnTime) -> Reception:
    """Messages before the first tick: all arrived."""
    lane, plan = now.lane, now.plan
    if not lane.lossy:
        return Reception()
    messages = messages_of(now, late)
    memory = None if lane.loss is None else lane.loss.start(messages)
    terms, first = degrees(lane, plan), (messages.present, memory, now.time)
    nothing = Polynomial(jnp.zeros((terms, 2, *lane.weights.shape)))
    if late.present:
        held = plan.missing == "hold"
        return SubstitutedLate(*first, nothing, messages.present) if held else Lossy(*first)
    return Substituted(*first, nothing) if terms else Lossy(*first)


def degrees(lane: Lane, plan: Plan) -> int:
    """Coefficients of the messages that are known before a tick, 0 without such messages."""
    if lane.delay is not None:
        return late_degrees(lane)
    return MISSING[plan.missing](len(lane.gain)) if lane.lossy else 0


def messages_of(now: Moment, late: OnTime) -> Messages:
    hearing, own = now.network.hearing, now.errors[0]
    apart = plane.length(hearing.sent(tell(now.errors)[0]) - own[:, None])
    present = late.arriving(now, now.lane.weights > 0)
    return Messages(now.time, hearing.sources, present, apart, now.lane.interval)


def held_derivative(now: Moment, sensed: Sensed) -> PerAxis:
    """The r-th derivative that vehicles hold until now; `sensed` are the readings until now."""
    return now.last - control.feedback(now.lane.gain, sensed.of(now.own))


def heard_jets(now: Moment, speakers: Speakers, held: PerAxis | None) -> Received:
    """Jets on each link now, r of vehicles and r + 1 of the navigator; others are 0.

    Where vehicles tell the r-th derivative that they hold, there are r + 1 of them too.
    """
    order, hearing = now.order, now.network.hearing
    navigator = now.navigator[: order + 1, :, None]
    own = speakers.sensed.of(now.own)
    sent = [jnp.concatenate(both, axis=1) for both in zip(navigator, own, strict=False)]
    highest = jnp.zeros_like(own[0]) if held is None else held
    sent.append(jnp.concatenate([navigator[order], highest], axis=1))
    carried = (hearing.received(*both) for both in zip(sent, speakers.signals, strict=False))
    received = speakers.links.of_all(tuple(carried))
    leads = (hearing.sources == 0)[None, ..., None]
    return *received[:order], jnp.where(leads | (held is not None), received[order], 0.0)


def expanded(
    gain: Gain, jets: Received, interval: Instants
) -> Float[Array, "degrees 2 slots m lanes"]:
    """R of the Taylor polynomial of jets, as coefficients."""
    nothing = [jnp.zeros_like(jets[0])] * len(jets)
    rates = [control.driven(gain, [*jets[k:], *nothing]) for k in range(len(jets))]
    return polynomial.taylor(rates, interval).terms


def with_sum_one(weights: Array, axis: int) -> Array:
    """Weights divided by their sum, or all 0."""
    total = weights.sum(axis=axis, keepdims=True)
    return weights / jnp.where(total > 0, total, 1.0)
