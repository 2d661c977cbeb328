"""Channel: messages are lost or delayed, and others may stand in for them.

A lost message is replaced here (`Lossy.substitutes`): by the message that was heard last, held or
continued by Taylor. A message that was live until now is heard for the last time now. Where a law
holds a derivative, vehicles hear messages at ticks alone. Other messages are continued; delayed
ones stay as they were when their tick ended.
"""

from dataclasses import replace
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxnet.engine.moment import Instants, LaneFlags, LinkFlags, Moment, PerAxis, PerLink, tell
from jaxnet.engine.plan import Plan
from jaxnet.engine.stages.known import Drives, KnownDrive, LinkDrives, LongerDrives, plus_messages
from jaxnet.engine.stages.late import Late, OnTime, late_degrees
from jaxnet.engine.stages.links import LinkErrors
from jaxnet.engine.stages.sensing import Sensed
from jaxnet.kinds.losses import Messages
from jaxnet.kinds.shapes import Memory
from jaxnet.model import control, plane, polynomial, xla
from jaxnet.model.hearing import AxisWeights
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Jets
from jaxnet.model.polynomial import Polynomial

# Coefficients of what stands in for a lost message, for vehicles of an order.
MISSING = {"drop": lambda order: 0, "hold": lambda order: 1, "extrapolate": lambda order: order + 1}


class Speakers(NamedTuple):
    """What vehicles and attackers say in a tick, for messages that are heard at its end."""

    time: Instants  # [s]
    signals: Jets
    sensed: Sensed
    links: LinkErrors


class Arrivals(NamedTuple):
    """Messages that the channel lets through at a tick, and the memory of the loss."""

    links: LinkFlags | None  # None where all arrive
    memory: Memory

    def without(self, cut: LinkFlags | None) -> "Arrivals":
        """The messages but those that an alarm cuts."""
        if self.links is None or cut is None:
            return self
        return self._replace(links=self.links & ~cut)


class Reception(eqx.Module):
    """Messages of a tick: all arrive, live."""

    lossy: ClassVar[bool] = False  # whether a message may be missing

    @property
    def stands(self) -> bool:
        """Whether others stand in for missing messages."""
        return False

    @property
    def arrivals(self) -> LinkFlags | None:
        """Messages that arrived, as a defence is told: None where all do."""
        return None

    def arriving(self, now: Moment, late: OnTime) -> Arrivals:
        """Messages that arrive at a tick."""
        return Arrivals(None, None)

    def next(
        self, now: Moment, late: OnTime, spoke: Speakers, speaking: Speakers, came: Arrivals
    ) -> "Reception":
        """Messages of a tick that `came`, with the substitutes that act from then on.

        In the tick before, vehicles `spoke` so; from now on they are `speaking`.
        """
        return self

    def usable(self, weights: AxisWeights) -> AxisWeights:
        """Weights of links with any message, live or not."""
        return weights

    def listened(self, weights: AxisWeights) -> AxisWeights:
        """Weights of the sources that count; a substituted message has that of its source."""
        return weights

    def in_force(self, weights: AxisWeights) -> AxisWeights:
        """Weights in force. They sum to less than 1 where others stand in for lost messages."""
        return weights

    def known(self, weights: AxisWeights, constant: KnownDrive) -> KnownDrive:
        """A known drive with what replaces live messages; `weights` are those without any loss."""
        return constant

    def changed(self, before: "Reception", lanes: LaneFlags) -> LaneFlags:
        """Lanes, with some, in which what is heard changed."""
        return lanes

    def at_tick(self, live: PerLink, path: Array) -> PerLink:
        """R of the messages that count at a tick, of those that links carry, relative to `path`."""
        return live


class Lossy(Reception):
    """Messages of which some are missing. Others may stand in for them."""

    arrived: LinkFlags
    memory: Memory  # of the loss
    time: Instants  # of the tick [s]
    substitutes: Polynomial | None  # by link; None: missing messages are dropped
    heard: LinkFlags | None  # links on which a delayed message has ever arrived; None if on time

    lossy: ClassVar[bool] = True

    @property
    def stands(self):
        return self.substitutes is not None

    @property
    def arrivals(self):
        return self.arrived

    def arriving(self, now, late):
        messages = messages_of(now, late)
        if now.lane.loss is None:
            return Arrivals(messages.present, None)
        lost, memory = now.lane.loss.lost(messages, self.memory)
        return Arrivals(xla.materialised(lambda: messages.present & ~lost), memory)

    def next(self, now, late, spoke, speaking, came):
        arrived, memory = came
        assert arrived is not None
        heard = None if self.heard is None else self.heard | arrived
        there = replace(self, arrived=arrived, memory=memory, time=now.time, heard=heard)
        if self.substitutes is None:
            return there
        ended = jnp.ones_like(now.time)
        if isinstance(late, Late):
            new, fresh = arrived, late.messages(now)
            fresh = fresh.at[0].set(speaking.links.of_message(now.lane.gain, fresh[0]))
            ended = self.substitutes.at(ended)[None]
            continued = jnp.pad(ended, [(0, len(fresh) - 1), *[(0, 0)] * 4])
        else:
            new, speakers = self.arrived, spoke
            if now.plan.at_ticks(now.lane.law) and not holds_drives(now):
                new, speakers = arrived | (now.time <= 0)[None, None], speaking
            fresh, continued = spoken(now, spoke, speakers), self.substitutes.about(ended).terms
        return replace(there, substitutes=Polynomial(jnp.where(new[None, None], fresh, continued)))

    @property
    def usable_links(self) -> LinkFlags | None:
        """Links with any message, live or not; None for all."""
        return self.heard if self.stands else self.arrived

    def usable(self, weights):
        links = self.usable_links
        return weights if links is None else jnp.where(links[None], weights, 0.0)

    def listened(self, weights):
        weights = self.usable(weights)
        return weights if self.usable_links is None else with_sum_one(weights, axis=1)

    def in_force(self, weights):
        weights = self.listened(weights)
        live = self.usable_links is not None
        return weights if live else jnp.where(self.arrived[None], weights, 0.0)

    def known(self, weights, constant):
        if self.substitutes is None:
            return constant
        weights = jnp.where(self.arrived[None], 0.0, weights)
        drive = plus_messages(constant.drive.terms, weights, self.substitutes.terms)
        share = weights.sum(axis=1) + constant.share
        return replace(constant, drive=Polynomial(drive), share=share, time=self.time)

    def delayed(self, now: Moment, late: Late, weights: AxisWeights, drive: Drives) -> LongerDrives:
        """A drive plus the delayed messages that act until the next tick, by weight."""
        if self.substitutes is None:
            return late.heard(now, weights, drive)
        return plus_messages(drive, weights, self.substitutes.terms)

    def changed(self, before, lanes):
        assert isinstance(before, Lossy)
        lanes = lanes | xla.in_any_row(self.arrived != before.arrived)
        if self.substitutes is None or before.substitutes is None:
            return lanes
        moved = (self.substitutes.terms != before.substitutes.terms) & ~self.arrived[None, None]
        return lanes | xla.in_any_row(moved)

    def at_tick(self, live, path):
        if self.substitutes is not None:
            live = jnp.where(self.arrived[None], live, self.substitutes.terms[0] - path)
        links = self.usable_links
        return live if links is None else jnp.where(links[None], live, jnp.nan)


def first_reception(now: Moment, late: OnTime) -> Reception:
    """Messages before the first tick: all arrived."""
    lane, plan = now.lane, now.plan
    if not lane.lossy:
        return Reception()
    messages, substitutes, heard = messages_of(now, late), None, None
    if plan.missing != "drop":
        nothing = jnp.zeros((degrees(lane, plan), 2, *lane.weights.shape))
        substitutes, heard = Polynomial(nothing), messages.present if late.present else None
    memory = None if lane.loss is None else lane.loss.start(messages)
    return Lossy(messages.present, memory, now.time, substitutes, heard)


def degrees(lane: Lane, plan: Plan) -> int:
    """Coefficients of the messages that are known before a tick, 0 without such messages."""
    if lane.delay is not None:
        return late_degrees(lane, plan)
    return MISSING[plan.missing](len(lane.gain)) if lane.lossy else 0


def messages_of(now: Moment, late: OnTime) -> Messages:
    hearing, own = now.network.hearing, now.errors[:1]
    if now.lane.formation is not None:
        own = (own[0] + now.lane.offsets(now.time)[0],)
    apart = plane.length(hearing.sent(tell(own)[0]) - own[0][:, None])
    present = late.arriving(now, now.lane.weights > 0)
    return Messages(now.time, hearing.sources, present, apart, now.lane.interval)


def held_derivative(now: Moment, sensed: Sensed) -> PerAxis:
    """The r-th derivative that vehicles hold until now; `sensed` are the readings until now."""
    return now.last - control.feedback(now.lane.gain, sensed.of(now.own))


def holds_drives(now: Moment) -> bool:
    """Whether a listener holds drives, which are known once the law is solved."""
    return now.plan.missing == "hold" and now.lane.law.solves()


def spoken(now: Moment, spoke: Speakers, speakers: Speakers) -> LinkDrives:
    """Messages on all links now, as their listeners hold or continue them.

    To continue one, a listener knows r jets of a vehicle and r + 1 of the navigator. Where vehicles
    hold the r-th derivative, their messages have it too.
    """
    lane, gain, order, hearing = now.lane, now.lane.gain, now.order, now.network.hearing
    links, holds = speakers.links, now.plan.missing == "hold"
    if holds_drives(now):
        path = control.driven(gain, lane.path(spoke.time))
        sources = jnp.concatenate([path[:, None], now.last], axis=1)
        fresh = hearing.received(sources, control.driven(gain, speakers.signals))
        return links.of_message(gain, fresh)[None]
    tells = holds and lane.law.couples() and lane.law.needs_ticks()
    own = speakers.sensed.of(now.own)
    own = *own, held_derivative(now, spoke.sensed) if tells else jnp.zeros_like(own[0])
    navigator = now.navigator[: order + 1, :, None]
    sent = (jnp.concatenate(both, axis=1) for both in zip(navigator, own, strict=True))
    received = tuple(map(hearing.received, sent, speakers.signals))
    highest = links.of_highest(received[order], order)
    leads = lane.law.heeds_highest(hearing.sources)[None, ..., None]
    jets = *links.of(received[:order]), jnp.where(leads | tells, highest, 0.0)
    nothing = [jnp.zeros_like(highest)] * len(jets)
    rates = [control.driven(gain, [*jets[k:], *nothing]) for k in range(1 if holds else len(jets))]
    return polynomial.taylor(rates, lane.interval).terms


def drives_told(now: Moment, spoke: Sensed, sensed: Sensed) -> PerAxis:
    """R of what vehicles tell at a tick: their drive until now, or P under a local law [m/s³]."""
    if now.lane.law.solves():
        return now.last
    told = control.feedback(now.lane.gain, sensed.of(now.own))
    return told + held_derivative(now, spoke) if now.lane.law.couples() else told


def messages_now(now: Moment, late: OnTime, links: LinkErrors, heard: Reception) -> PerLink | None:
    """R of what each link carries at a tick [m/s³], relative to R of the navigator's path.

    It is not-a-number where there is no message, and None where no defence asks. Under a local law
    the highest derivative comes from the navigator alone.
    """
    if now.told is None:
        return None
    lane, gain, hearing = now.lane, now.lane.gain, now.network.hearing
    path = control.driven(gain, now.navigator)[:, None, None]
    if isinstance(late, Late):
        live = late.messages(now)[0] - path
    else:
        highest, added = now.navigator[now.order], hearing.added(now.signals[now.order])
        if lane.law.couples():
            highest = jnp.zeros_like(highest)
        else:
            leads = lane.law.heeds_highest(hearing.sources)[None, ..., None]
            added = jnp.where(leads, added + highest[:, None, None], 0.0)
        sent = jnp.concatenate([-highest[:, None], now.told - path[:, 0]], axis=1)
        live = hearing.received(sent, control.feedback(gain, now.signals)) + added
    return heard.at_tick(links.of_message(gain, live), path)


def with_sum_one(weights: Array, axis: int) -> Array:
    """Weights divided by their sum, or all 0."""
    total = weights.sum(axis=axis, keepdims=True)
    return weights / jnp.where(total > 0, total, 1.0)
