"""Alarms about the messages that arrive, and what they cut (theorems.md O17).

An observer predicts a message. By default that is the true jets of its source when the message was
sent: the residual is then what attack and errors add. An alarm acts at its own tick.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine.moment import Instants, LinkFlags, Moment, attacked_links, misusing, tell
from jaxnet.engine.stages.channel import Arrivals
from jaxnet.engine.stages.late import OnTime
from jaxnet.engine.stages.links import LinkErrors
from jaxnet.engine.stages.sensing import Sensed
from jaxnet.kinds.detectors import JudgedMessages
from jaxnet.kinds.observers import Compared, HeardMessages
from jaxnet.kinds.shapes import Memory
from jaxnet.kinds.ticks import TICK_ROUNDING
from jaxnet.model import plane, whitening, xla
from jaxnet.model.hearing import Hearing
from jaxnet.model.lane import Lane
from jaxnet.model.shapes import LoopIndex


class TestedLinks(NamedTuple):
    """Links as alarms have left them.

    Attributes
    ----------
    first
        Time [s] of the first alarm about a message that was attacked, or honest: (2, slots, m,
        lanes). It is infinite before any alarm, and not-a-number before any such message was
        tested.
    attacked, honest
        Links of the network in force with and without an attack, (slots, m, lanes).
    cut
        Links that an alarm has cut, (slots, m, lanes); None where alarms cut none.
    isolated
        Time [s] of the first tick at which all attacked links were cut, (lanes,); infinite before.
    """

    first: Float[Array, "2 slots m *lanes"]
    attacked: Bool[Array, "slots m *lanes"]
    honest: Bool[Array, "slots m *lanes"]
    cut: Bool[Array, "slots m *lanes"] | None
    isolated: Float[Array, "*lanes"]


class Alarms(eqx.Module):
    """Alarms until now: none, nobody tests messages."""

    def next(
        self,
        now: Moment,
        sensed: Sensed,
        links: LinkErrors,
        late: OnTime,
        came: Arrivals,
        whole: Lane,
    ) -> "Alarms":
        """Alarms with those of a tick; `whole` is the lane with the links that were cut."""
        return self

    @property
    def cut_messages(self) -> LinkFlags | None:
        """Messages of this tick that an alarm cuts; None where none cuts any."""
        return None

    def instead(self, lane: Lane, given: dict[str, Any], time: Instants) -> dict[str, Any]:
        """What stands in place of fields of the lane at a time, where `given` does otherwise."""
        return given

    def links(self, lane: Lane, hearing: Hearing, time: Instants) -> TestedLinks | None:
        """Links as alarms have left them; None without a detector."""
        return None

    @property
    def shares(self) -> Float[Array, "2 lanes"] | None:
        """Alarms over judged messages, of attacked and of honest links; None without a detector."""
        return None


class Detection(Alarms):
    """Alarms and judged messages until now, of attacked links and of honest links."""

    alarms: Int[Array, "2 lanes"]
    judged: Int[Array, "2 lanes"]
    first: Float[Array, "2 slots m lanes"]  # as in `TestedLinks`
    memory: Memory  # of the detector
    observed: Memory  # of its observer
    isolated: Instants  # as in `TestedLinks`
    cut: LinkFlags | None  # messages of this tick that are not heard; None where alarms cut none
    until: Float[Array, "slots m lanes"] | None  # [s] to which links are cut; None: no link ever is

    def next(self, now, sensed, links, late, came, whole):
        lane, detector = now.lane, now.lane.detector
        heard = heard_at(now, sensed, links, late, came)
        compared = detector.predicts.compared(heard, self.observed)
        if lane.misuses:  # liars monitor nobody
            known = compared.known & ~misusing(lane.vectors)[None]
            compared = compared._replace(known=known)
        messages = judged_messages(lane, heard, compared)
        alarms, memory = detector.alarms(messages, self.memory)
        judged, attacked = messages.judged, late.attacked(now)
        each = jnp.stack([attacked & judged, ~attacked & judged])
        raised, each = xla.stored((alarms & judged, each))
        with_alarm = each & raised[None]
        first = jnp.where(each & jnp.isnan(self.first), jnp.inf, self.first)
        counted = replace(
            self,
            alarms=self.alarms + jnp.stack([*map(xla.rows_set, with_alarm)]),
            judged=self.judged + jnp.stack([*map(xla.rows_set, each)]),
            first=jnp.where(with_alarm & jnp.isinf(first), now.time[None, None, None], first),
            memory=memory,
        )
        return counted.acting(now, heard, raised, whole)

    def acting(
        self, now: Moment, heard: HeardMessages, raised: LinkFlags, whole: Lane
    ) -> "Detection":
        """Cut what raised an alarm. The observer learns from the other messages."""
        lane, detector, until = now.lane, now.lane.detector, self.until
        if not detector.acts:
            return replace(self, observed=detector.predicts.advance(heard, self.observed))
        if detector.cuts == "both_ways":
            raised = raised | reverse(now.network.hearing, raised)
        if until is not None:
            lasting = detector.return_after
            ends = jnp.inf if lasting is None else (now.time + lasting)[None, None]
            until = jnp.where(raised, ends, until)
        found = replace(self, cut=raised, until=until)
        weights = whole._replace(**found.instead(whole, {}, now.time)).weights
        heard = heard._replace(arrived=heard.arrived & ~raised, weights=weights)
        memories = self.memory, detector.predicts.advance(heard, self.observed)
        if until is not None:
            cut, first = is_cut(until, now.time), first_memories(lane, heard)
            memories = jax.tree.map(lambda new, old: anew(cut, new, old), first, memories)
            attacked = (whole.weights > 0) & now.attacked_links()
            isolated = xla.in_any_row(attacked) & ~xla.in_any_row(attacked & ~cut)
            since = jnp.where(isolated, now.time, jnp.inf)
            found = replace(found, isolated=jnp.minimum(self.isolated, since))
        return replace(found, memory=memories[0], observed=memories[1])

    @property
    def cut_messages(self):
        return self.cut

    def instead(self, lane, given, time):
        """Links that are cut have no weight until they return."""
        return given if self.until is None else lane.without(is_cut(self.until, time), given)

    def links(self, lane, hearing, time):
        whole = lane._replace(**lane.instead(time))
        linked, attacked = whole.weights > 0, attacked_links(hearing, lane.vectors)
        cut = None if self.until is None else is_cut(self.until, time)
        return TestedLinks(self.first, linked & attacked, linked & ~attacked, cut, self.isolated)

    @property
    def shares(self):
        return jnp.where(self.judged > 0, self.alarms / jnp.maximum(self.judged, 1), jnp.nan)


def first_alarms(lane: Lane, hearing: Hearing) -> Alarms:
    if lane.detector is None:
        return Alarms()
    nothing, never = jnp.zeros((2, *lane.attack_scale.shape), int), jnp.zeros_like(lane.weights)
    detector, (memory, observed) = lane.detector, first_memories(lane, silence(lane, hearing))
    return Detection(
        alarms=nothing,
        judged=nothing,
        first=jnp.full((2, *lane.weights.shape), jnp.nan),
        memory=memory,
        observed=observed,
        isolated=jnp.full_like(lane.attack_scale, jnp.inf),
        cut=jnp.zeros(lane.weights.shape, bool) if detector.acts else None,
        until=never if detector.cuts_links else None,
    )


def first_memories(lane: Lane, heard: HeardMessages) -> tuple[Memory, Memory]:
    """Memories of detector and observer before any message, at the time of a tick."""
    observer = lane.detector.predicts
    nothing = {key: jnp.zeros_like(getattr(heard, key)) for key in ("received", "errors", "own")}
    silent = heard._replace(arrived=lane.weights > 0, **nothing)
    observed = observer.start(silent)
    messages = judged_messages(lane, silent, observer.compared(silent, observed))
    return lane.detector.start(messages), observed


def silence(lane: Lane, hearing: Hearing) -> HeardMessages:
    """Messages before the first tick, all 0."""
    silent = jnp.zeros((len(lane.gain), 2, *lane.weights.shape))
    return HeardMessages(
        jnp.zeros_like(lane.attack_scale),
        lane.interval,
        hearing.sources,
        lane.weights,
        lane.weights > 0,
        silent,
        silent,
        error_variances(lane, hearing),
        silent[:, :, 0],
    )


def heard_at(
    now: Moment, sensed: Sensed, links: LinkErrors, late: OnTime, came: Arrivals
) -> HeardMessages:
    """Messages of a tick.

    Errors are what a link carries minus what its source tells, plus the errors of both. They are
    the errors alone, to the last bit, where the link carries what the source tells.
    """
    lane, hearing, sent = now.lane, now.network.hearing, tell(sensed.of(now.errors))
    carried = now.carried(sent)
    errors = tuple(one - hearing.sent(told) for one, told in zip(carried, sent, strict=True))
    still = tuple(jnp.zeros_like(jet) for jet in now.errors)
    errors = plane.plus(errors, tuple(map(hearing.sent, tell(sensed.of(still)))))
    told, path = links.of(late.jets(now, carried)), now.navigator[: now.order, :, None, None]
    received = xla.stored(plane.plus(told, path))
    return HeardMessages(
        now.time,
        lane.interval,
        hearing.sources,
        lane.weights,
        lane.weights > 0 if came.links is None else came.links,
        jnp.stack(received),
        jnp.stack(links.of(late.errors(now, errors))),
        error_variances(lane, hearing),
        jnp.stack(sensed.of(now.own)),
    )


def judged_messages(lane: Lane, heard: HeardMessages, compared: Compared) -> JudgedMessages:
    """Messages with their residuals whitened."""
    residuals, orders = whitening.whitened(compared.residuals, compared.variances)
    judged = compared.known & ((orders > 0) | (not lane.detector.whitens))
    apart = compared.residuals[0]
    return JudgedMessages(
        heard.time, heard.sources, residuals, orders, judged, heard.interval, apart
    )


def error_variances(lane: Lane, hearing: Hearing) -> Float[Array, "orders slots m lanes"]:
    """Variance of a message's error per axis and order below r; the navigator has no sensor.

    The error of rounding counts as uniform. Where nobody needs them, variances are 0.
    """
    sources, noise = hearing.sources, lane.noise
    total = [jnp.zeros_like(lane.weights)] * len(lane.gain)
    if not lane.detector.needs_variances:
        return jnp.stack(total)
    of_links = None if noise is None else (noise, ~noise.exact_links(sources))
    of_sensors = None if lane.sensor is None else (lane.sensor, sources > 0)
    for kind, links in filter(None, (of_links, of_sensors)):
        for order, size in enumerate(kind.deviations()[: len(total)]):
            if size is not None:
                by = jnp.where(links[..., None], size[None, None] ** 2, 0.0)
                total[order] = total[order] + by
    if lane.steps is not None:
        total = [
            each + step[None, None] ** 2 / 12 for each, step in zip(total, lane.steps, strict=True)
        ]
    return jnp.stack(total)


def is_cut(until: Float[Array, "slots m lanes"], time: Instants) -> LinkFlags:
    return until > time[None, None] + TICK_ROUNDING


def reverse(hearing: Hearing, links: LinkFlags) -> LinkFlags:
    """Links whose listener is the source, and whose source is the listener, of one of these."""
    slots, m = hearing.sources.shape
    source, listener = jnp.maximum(hearing.sources - 1, 0), jnp.arange(1, m + 1)[None]

    def in_slot(slot: LoopIndex, found: LinkFlags) -> LinkFlags:
        back = (hearing.sources[slot][source] == listener) & (hearing.sources > 0)
        return found | (back[..., None] & links[slot][source])

    return jax.lax.fori_loop(0, slots, in_slot, jnp.zeros_like(links))


def anew(cut: LinkFlags, first: Array, memory: Array) -> Array:
    """A memory that starts anew on links that are cut, if it has a part for each link."""
    if memory.shape[-3:] != cut.shape:
        return memory
    return jnp.where(cut[(None,) * (memory.ndim - cut.ndim)], first, memory)
