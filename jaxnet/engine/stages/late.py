"""Delayed messages: each link has a memory of what it carried some ticks ago (theorems.md O16).

Under the exact law a message is X_j = R(y_j) plus R of the attack. A delayed one is known before
the tick in which a vehicle follows it, and so is the drive `z_i = Σ_j w_ij X_j` of the vehicle,
which is the vehicle's own next message. So no system of equations is left to solve. Under a local
law, a message is P(y_j). Under a law by exchanges, it is the derivative that the vehicle holds
until now, plus P(y_j).

Over a tick, a message is the polynomial through its values at Chebyshev's points of the tick.
Messages that are polynomials stay the same to rounding; navigator and attack are interpolated.
Where vehicles extrapolate, or follow a local law, a message is made of the motion of its source, a
power series over a tick. Where a law holds a derivative from tick to tick, a message is the one
number that its listener hears at a tick.
"""

import functools
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine.moment import (
    Instants,
    LinkFlags,
    Moment,
    PerAxis,
    Received,
    attacked_links,
    tell,
)
from jaxnet.engine.plan import Plan
from jaxnet.engine.stages.known import (
    Drives,
    KnownDrive,
    LinkDrives,
    LongerDrives,
    padded,
    plus_messages,
)
from jaxnet.engine.stages.links import rounding_errors
from jaxnet.engine.stages.sensing import Sensed
from jaxnet.model import chance, control, plane, polynomial, signal, xla
from jaxnet.model.hearing import AxisWeights, Hearing, plus_slots
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Jets
from jaxnet.model.polynomial import Polynomial, scaled
from jaxnet.model.shapes import LoopIndex
from jaxnet.model.signal import Vectors

DEGREES = 8  # coefficients. A harmonic of ω [rad/s] errs by under (ωh/4)⁸ / 20,160 of its size.
NOT_ARRIVING = 2**30  # ticks by which a message is delayed that is lost


class Said(NamedTuple):
    """What navigator and vehicles tell, and the functions of attacks; one tick has no axis d."""

    sources: Float[Array, "*d orders degrees 2 sources lanes"]
    functions: Float[Array, "*d orders degrees B lanes"]

    def on(
        self, hearing: Hearing, vectors: Vectors
    ) -> Float[Array, "orders degrees 2 slots m lanes"]:
        """What each link carries of one tick, with these vectors of the attacks."""

        def carried(sources: Array, functions: Array) -> Array:
            return hearing.received(sources, signal.combined(vectors, functions))

        return jax.vmap(jax.vmap(carried))(*self)


class Past(NamedTuple):
    """What was sent in the last d ticks, the oldest first; d is the greatest delay.

    A message is a sum of its orders: of one, or of those of y, ẏ, …, y^(r).
    """

    messages: Said
    jets: Said | None  # which listeners judge or test, of degree 1; None where nobody does
    true: Float[Array, "*d orders 2 sources lanes"] | None  # jets; None: sensors do not err
    vectors: Float[Array, "*d 2 signals B lanes"] | None  # of attacks; None: always the lane's
    rounding: tuple[Float[Array, "*d 2 slots m lanes"], ...]  # errors of jets, if any
    ticks: Int[Array, "*d slots m lanes"] | None  # delays of messages; None if those of links

    def vectors_of(self, lane: Lane) -> Vectors:
        return lane.vectors if self.vectors is None else self.vectors


class Arrival(NamedTuple):
    """Messages that arrive at a tick: the newest on each link, if newer than all before."""

    came: Bool[Array, "#slots #m lanes"]
    entry: Int[Array, "slots m lanes"] | None  # its place in the past; None for the first

    def of(self, past: Past, links: Callable[[Past], Array]) -> Array:
        """What arrives, where `links` gives what all links carry of one tick."""
        if self.entry is None:
            return links(oldest(past))
        each = jax.vmap(links)(past)
        place = self.entry.reshape(*[1] * (each.ndim - self.entry.ndim), *self.entry.shape)
        return jnp.take_along_axis(each, place, axis=0)[0]


class SteadyDelay(NamedTuple):
    """A delay that all messages of a link have."""

    time: Float[Array, "*links lanes"]  # [s], (lanes,) for all links, or (slots, m, lanes)

    @property
    def alike(self) -> bool:
        """Whether all links of a lane have the same."""
        return self.time.ndim == 1

    def draw(self, time: Instants, links: tuple[int, ...]) -> None:
        """Messages have no delays of their own."""

    def seconds(self, ticks: Any, interval: Instants) -> Float[Array, "*links lanes"]:
        """Delay [s] of messages that arrive so many ticks later."""
        return self.time

    def arrival(self, past: Past, time: Instants, interval: Instants) -> Arrival:
        lift = (None,) * (self.time.ndim - 1)
        came = time[lift] > self.time - interval[lift] / 2
        if not lift:
            return Arrival(came[None, None], None)
        ticks = jnp.round(self.time / interval[lift]).astype(int)
        return Arrival(came, depth(past) - ticks)


class DrawnDelay(NamedTuple):
    """A delay that each message draws. A message that a newer one overtakes is not heard."""

    key: Float[Array, " lanes"]  # of the random numbers
    chances: Float[Array, "d lanes"]  # that a message is delayed by at most 1, 2, …, d ticks

    alike = False  # not all links of a lane have the same

    def draw(self, time: Instants, links: tuple[int, ...]) -> Int[Array, "slots m lanes"]:
        """Ticks by which the messages of a tick are delayed."""
        drawn = chance.drawn(self.key, time, "delay", "uniform", links)
        return 1 + (drawn[None] >= self.chances[:-1, None, None]).sum(axis=0)

    def seconds(self, ticks: Any, interval: Instants) -> Float[Array, "slots m lanes"]:
        return ticks.astype(float) * interval[None, None]

    def arrival(self, past: Past, time: Instants, interval: Instants) -> Arrival:
        assert past.ticks is not None
        age = ages(past)
        there = past.ticks <= age
        last = len(age) - 1 - there[::-1].argmax(axis=0)
        due = (past.ticks == age) & (jnp.arange(len(age))[:, None, None, None] == last[None])
        return Arrival(due.any(axis=0), last)


class OnTime(eqx.Module):
    """Messages that arrive in the tick in which they are sent."""

    present: ClassVar[bool] = False

    def arriving(self, now: Moment, sent: LinkFlags) -> LinkFlags:
        """Links, of some, on which a message arrives."""
        return sent

    def jets(self, now: Moment, live: Received) -> Received:
        """Jets that listeners judge by; `live` are those of this tick."""
        return live

    def errors(self, now: Moment, live: Received) -> Received:
        """What attacks, sensors and rounding add to messages; `live` is what they add now."""
        return live

    def attacked(self, now: Moment) -> LinkFlags:
        """Links on which the message that arrives is attacked."""
        return now.attacked_links()


class Late(OnTime):
    """Messages that arrive some ticks later."""

    past: Past
    leading: Float[Array, "degrees 2 lanes"]  # R(y_0) from the last tick on
    known: KnownDrive

    present: ClassVar[bool] = True

    def arrival(self, now: Moment) -> Arrival:
        return now.lane.delay.arrival(self.past, now.time, now.lane.interval)

    def arriving(self, now, sent):
        return sent & self.arrival(now).came

    def jets(self, now, live):
        arrival, lane, hearing = self.arrival(now), now.lane, now.network.hearing

        def on_links(sent: Past) -> Array:
            assert sent.jets is not None
            return sent.jets.on(hearing, sent.vectors_of(lane))[:, 0]

        each = zip(arrival.of(self.past, on_links), now.navigator, strict=False)
        jets = tuple(jet - path[:, None, None] for jet, path in each)
        return plane.plus(jets, self.rounding(arrival)) if self.past.rounding else jets

    def errors(self, now, live):
        arrival, lane, hearing = self.arrival(now), now.lane, now.network.hearing

        def on_links(sent: Past) -> Array:
            assert sent.jets is not None
            true = sent.jets.sources[:, 0] if sent.true is None else sent.true
            told = sent.jets.on(hearing, sent.vectors_of(lane))[:, 0]
            return told - jax.vmap(hearing.sent)(true)

        errors = tuple(arrival.of(self.past, on_links))
        return plane.plus(errors, self.rounding(arrival)) if self.past.rounding else errors

    def attacked(self, now):
        if self.past.vectors is None:
            return now.attacked_links()
        hearing = now.network.hearing
        return self.arrival(now).of(self.past, lambda sent: attacked_links(hearing, sent.vectors))

    def rounding(self, arrival: Arrival) -> Received:
        each = range(len(self.past.rounding))
        return tuple(arrival.of(self.past, lambda sent, k=k: sent.rounding[k]) for k in each)

    def messages(self, now: Moment) -> LinkDrives:
        """The messages that arrive at a tick."""
        lane, hearing, arrival = now.lane, now.network.hearing, self.arrival(now)
        ticks = None if arrival.entry is None else depth(self.past) - arrival.entry
        delay = lane.delay.seconds(ticks, lane.interval)
        gains = message_gains(lane.gain, delay, now.plan.extrapolate)

        def on_links(sent: Past) -> Array:
            carried = sent.messages.on(hearing, sent.vectors_of(lane))
            own = sent.messages.sources[:-1, :, :, None, 1:]
            return carried.at[:-1].add(-own) if now.plan.own_delay else carried

        orders = arrival.of(self.past, on_links)
        if not lane.law.couples():  # the highest derivative is told by the navigator alone
            leads = lane.law.heeds_highest(hearing.sources)[..., None]
            orders = [*orders[:-1], jnp.where(leads, orders[-1], 0.0)]
        messages = orders[0]
        if len(orders) > 1:
            messages = functools.reduce(jnp.add, map(scaled, orders, gains))
        if self.past.rounding:
            errors = map(scaled, self.rounding(arrival), gains)
            messages = messages.at[0].add(sum(errors))
        return messages

    def heard(self, now: Moment, weights: AxisWeights, start: Drives) -> LongerDrives:
        """A drive plus the messages that arrive at a tick, by weight."""
        arrival, hearing, past = self.arrival(now), now.network.hearing, self.past
        if arrival.entry is not None or past.rounding or past.messages.sources.shape[1] > 1:
            return plus_messages(start, weights, self.messages(now))
        sent = oldest(past)  # all links are alike: faster
        sources, functions = (each[0] for each in sent.messages)

        def in_slot(slot: LoopIndex) -> Drives:
            there = hearing.at(slot).carried_sources[0]
            return sources.at[:, :, there].get(mode="promise_in_bounds")

        vectors, drive = sent.vectors_of(now.lane), padded(start, len(sources))
        for b in range(vectors.shape[2]):
            added = hearing.mean_added(weights, vectors[:, :, b])
            drive = drive + functions[:, b, None, None] * added[None]
        return plus_slots(drive, weights, in_slot)

    def send(
        self,
        now: Moment,
        sensed: Sensed,
        lost: LinkFlags,
        known: KnownDrive,
        told: tuple[Drives, ...],
    ) -> "Late":
        """Messages that vehicles send from this tick to the next, heard later.

        `told` are y, ẏ, …, y^(r) as vehicles tell them from now on, or their messages alone. `lost`
        are the links on which the channel loses the message that arrives.
        """
        lane, path, past, jets = now.lane, known_parts(now, len(told)), self.past, None
        sources = jnp.concatenate([path[0][:, :, :, None], jnp.stack(told)], axis=3)
        messages = Said(sources, path[1])
        if len(past.messages.sources[0]) < len(told):  # links are alike
            delay = lane.delay.time if lane.delay.alike else None
            gains = message_gains(lane.gain, delay, now.plan.extrapolate)
            messages = Said(*(control.feedback(gains, each)[None] for each in messages))
        if past.jets is not None:
            told_jets = absolute(now, sensed.of(now.errors))
            jets = Said(told_jets[:, None], now.basis[: now.order, None])
        latest = Past(
            messages,
            jets,
            absolute(now, now.errors) if past.true is not None else None,
            lane.vectors if past.vectors is not None else None,
            rounding_errors(now, sensed) if past.rounding else (),
            lane.delay.draw(now.time, lane.weights.shape[:2]),
        )
        if past.ticks is not None:
            gone = lost[None] & (past.ticks == ages(past))
            past = past._replace(ticks=jnp.where(gone, NOT_ARRIVING, past.ticks))
        past = jax.tree.map(
            lambda queue, last: jnp.concatenate([queue[1:], last[None]]), past, latest
        )
        leading = path[0][0] if len(told) == 1 else control.driven(lane.gain, path[0])
        return Late(past, leading, known)


def first_late(lane: Lane, plan: Plan) -> OnTime:
    """Messages before the first tick: all is 0."""
    if lane.delay is None:
        return OnTime()
    d, r, degrees = plan.late, len(lane.gain), late_degrees(lane, plan)
    (slots, m, lanes), changing = lane.weights.shape, plan.strategic or lane.periods is not None
    alike = lane.law.couples() and (plan.extrapolate == "none" or lane.delay.alike)

    def nothing(*shape: int) -> Float[Array, "*shape"]:
        return jnp.zeros((*shape, lanes))

    def said(*orders: int) -> Said:
        return Said(nothing(d, *orders, 2, 1 + m), nothing(d, *orders, lane.vectors.shape[2]))

    drawn, tests = lane.delay.draw(jnp.zeros(lanes), (slots, m)), lane.detector is not None
    past = Past(
        messages=said(1 if alike else r + 1, degrees),
        jets=said(r, 1) if plan.decides or tests else None,
        true=nothing(d, r, 2, 1 + m) if tests and lane.sensor is not None else None,
        vectors=nothing(d, *lane.vectors.shape[:3]) if changing else None,
        rounding=() if lane.steps is None else (nothing(d, 2, slots, m),) * max(3, r),
        ticks=None if drawn is None else jnp.full((d, slots, m, lanes), NOT_ARRIVING, int),
    )
    # `tick.before_first` gives the drive its shape
    known = KnownDrive(Polynomial(nothing(degrees, 2, m)), nothing(1, m), lane.interval, nothing())
    return Late(past, nothing(degrees, 2), known)


def absolute(now: Moment, errors: Jets) -> Float[Array, "orders 2 sources lanes"]:
    """Jets of navigator and vehicles, relative to nobody, from those relative to the navigator."""
    each = zip(tell(errors), now.navigator, strict=False)
    return jnp.stack([jet + path[:, None] for jet, path in each])


def oldest(past: Past) -> Past:
    return jax.tree.map(lambda leaf: leaf[0], past)


def depth(past: Past) -> int:
    """Number of ticks that are remembered."""
    return len(past.messages.sources)


def ages(past: Past) -> Int[Array, "d 1 1 1"]:
    """Ticks that have passed since each entry."""
    return jnp.arange(depth(past), 0, -1)[:, None, None, None]


def late_degrees(lane: Lane, plan: Plan) -> int:
    """Coefficients of a message: one where vehicles hear messages at ticks alone."""
    return 1 if plan.at_ticks(lane.law) else DEGREES


def message_gains(
    gain: Float[Array, "r lanes"], delay: Float[Array, "*links lanes"] | None, extrapolate: str
) -> Float[Array, "derivatives *some lanes"]:
    """Factors of y, ẏ, …, y^(r) in a message: those of R, or of R after the delay by Taylor.

    `jets` continues the derivatives below r, `jerk` also the r-th.
    """
    if extrapolate == "none" or delay is None:
        return jnp.concatenate([gain, jnp.ones_like(gain[:1])])
    order, powers = len(gain), [jnp.ones_like(delay)]
    gain = gain.reshape(order, *[1] * (delay.ndim - 1), -1)
    for n in range(1, order + 1):
        powers.append(powers[-1] * delay / n)
    factors = [sum(gain[n - j] * powers[j] for j in range(n + 1)) for n in range(order)]
    jerk = sum(gain[k] * powers[order - k] for k in range(order))
    return jnp.stack([*factors, powers[0] + jerk if extrapolate == "jerk" else powers[0]])


def known_parts(now: Moment, orders: int) -> tuple[Array, Array]:
    """The navigator's path and the attacks' functions over the tick, (orders, degrees, …).

    Of one order, these are R of them.
    """
    lane, held = now.lane, now.plan.at_ticks(now.lane.law)
    points = np.zeros(1) if held else polynomial.chebyshev_points(DEGREES)
    instants = now.time[None] + jnp.asarray(points)[:, None] * lane.interval[None]

    def at(time: Instants) -> list[Array]:
        each = (lane.path(time), lane.basis(time))
        if orders == 1:
            return [control.driven(lane.gain, jets)[None] for jets in each]
        return [jets[: now.order + 1] for jets in each]

    parts = xla.materialised(lambda: jax.vmap(at)(instants))
    path, functions = parts if held else (polynomial.interpolated(each).terms for each in parts)
    return path.swapaxes(0, 1), functions.swapaxes(0, 1)


def motion_told(
    now: Moment, drive: Polynomial, sensed: Sensed, strength: Callable[[PerAxis], PerAxis]
) -> tuple[Drives, ...]:
    """y, ẏ, …, y^(r) from now on, by the power series of `y^(r) = s (z - P(y + n)) - D(y + n)`.

    `strength` multiplies by s, and D is the damping. In the series, time is counted in ticks.
    """
    lane, order, interval = now.lane, now.order, now.lane.interval
    powers = [interval**k for k in range(order + 1)]
    series = [scaled(jet, powers[k]) for k, jet in enumerate(now.own)]
    first = [scaled(jet, powers[k]) for k, jet in enumerate(sensed.of(now.own))]
    gain, damping = control.gain_in_ticks(lane.gain, powers), lane.damping
    if damping is not None:
        damping = control.gain_in_ticks(damping, powers)

    def further(own: Jets, term: PerAxis) -> tuple[Jets, PerAxis]:
        new = strength(scaled(term, powers[order]) - control.feedback(gain, own))
        new = control.damped(new, damping, own)
        return (*own[1:], new), new

    # A loop, as XLA would compute a term again in each later one: 1.5 times, 12 vehicles.
    begin = (*series[1:], further(tuple(first), drive.terms[0])[1])
    series = [*series, begin[-1], *jax.lax.scan(further, begin, drive.terms[1:])[1]]
    degrees = len(drive.terms)
    told = [scaled(jnp.stack(series[k : k + degrees]), 1 / powers[k]) for k in range(order + 1)]
    begin = (*sensed.of(tuple(each[0] for each in told[:order])), told[order][0])
    return tuple(each.at[0].set(start) for each, start in zip(told, begin, strict=True))
