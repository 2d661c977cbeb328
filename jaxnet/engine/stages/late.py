"""Late messages: what each link carried some ticks ago, as a polynomial of time (theorems.md O16).

Under the exact law a message is X_j = R(y_j) plus R of the attack. A late one is known before the
tick in which a vehicle follows it, and so is the drive `z_i = Σ_j w_ij X_j` of the vehicle, which
is the vehicle's own next message. So no system of equations is left to solve. Under a local law, a
message is P(y_j). Under a law by exchanges, it is the derivative that the vehicle holds until now,
plus P(y_j).

Over a tick, a message is the polynomial through its values at Chebyshev's points of the tick.
LateMessages that are polynomials stay the same to rounding; navigator and attack are interpolated.
Vehicles that extrapolate, or that follow a local law, tell their motion, a power series over a
tick. Where a law holds a derivative from tick to tick, a message is the one number that its
listener hears at a tick.
"""

import functools
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from jaxnet.engine.moment import Instants, LinkFlags, Moment, PerAxis, Received, tell
from jaxnet.engine.plan import Plan
from jaxnet.engine.stages.known import Drives, Known, KnownDrive
from jaxnet.engine.stages.links import rounding_errors
from jaxnet.engine.stages.sensing import Sensed
from jaxnet.model import chance, control, plane, polynomial, signal, xla
from jaxnet.model.hearing import AxisWeights, Hearing, plus_slots
from jaxnet.model.lane import Lane
from jaxnet.model.polynomial import Polynomial, scaled
from jaxnet.model.shapes import LoopIndex
from jaxnet.model.signal import Vectors

DEGREES = 8  # coefficients. A harmonic of ω [rad/s] errs by under (ωh/4)⁸ / 20,160 of its size.
NOT_ARRIVING = 2**30  # ticks by which a message is late that is lost

LateMessages = Float[Array, "degrees 2 slots m lanes"]
SomeLinks = Bool[Array, "#slots #m lanes"]


class SentJets(NamedTuple):
    """Jets of y at a tick, which listeners judge by."""

    told: tuple[
        Float[Array, "*d 2 sources lanes"], ...
    ]  # relative to the navigator, which is first
    navigator: Float[Array, "*d r 2 lanes"]
    functions: Float[Array, "*d r B lanes"]  # of the attacks


class Past(NamedTuple):
    """What vehicles, navigator and attackers sent in the last d ticks, the oldest tick first.

    d is the greatest delay in ticks. Of one tick, the arrays have no axis d. A message is the sum
    of its orders: of one, or of those of y, ẏ, …, y^(r). What no lane of a program needs is absent.
    """

    told: tuple[Float[Array, "*d degrees 2 sources lanes"], ...]
    functions: Float[Array, "*d orders degrees B lanes"]  # of the attacks
    vectors: Float[Array, "*d 2 signals B lanes"] | None  # of the attacks; None: always the lane's
    rounding: tuple[
        Float[Array, "*d 2 slots m lanes"], ...
    ]  # errors of jets; none without rounding
    jets: SentJets | None  # None where nobody judges
    # by which messages are late, where each has its own
    ticks: Int[Array, "*d slots m lanes"] | None


class Arrival(NamedTuple):
    """Messages that arrive at a tick: the newest on each link, if newer than all before."""

    came: SomeLinks
    entry: Int[Array, "*links lanes"] | None  # its place in the history; None for the first

    def entries(self, past: Any) -> Any:
        """The tick that all messages are of, or where links differ, all ticks."""
        return past if self.entry is not None else jax.tree.map(lambda leaf: leaf[0], past)

    def carried(self, entries: Any, links: Callable[[Any], Any]) -> Any:
        """What the messages carry, where `links` gives what all links carry of one tick."""
        if self.entry is None:
            return links(entries)
        entry = self.entry

        def of_entry(each: Float[Array, "d *some"]) -> Float[Array, "*some"]:
            place = entry.reshape(*[1] * (each.ndim - entry.ndim), *entry.shape)
            return jnp.take_along_axis(each, place, axis=0)[0]

        return jax.tree.map(of_entry, jax.vmap(links)(entries))


class SteadyDelay(NamedTuple):
    """A delay that all messages of a link have."""

    time: Float[Array, "*links lanes"]  # [s], (lanes,) for all links, or (slots, m, lanes)

    def draw(self, time: Instants, links: tuple[int, ...]) -> None:
        """LateMessages have no delays of their own."""

    def seconds(self, ages: Any, interval: Instants) -> Float[Array, "*links lanes"]:
        """Delay [s] of messages, which arrive so many ticks late."""
        return self.time

    def on(self, links: Callable[[Array], Array]) -> "SteadyDelay":
        return self if self.time.ndim == 1 else SteadyDelay(links(self.time))

    def alike(self) -> bool:
        """Whether all links of a lane have the same."""
        return self.time.ndim == 1

    def arrival(self, past: Past, time: Instants, interval: Instants) -> Arrival:
        lift = (None,) * (self.time.ndim - 1)
        came = time[lift] > self.time - interval[lift] / 2
        if not lift:
            return Arrival(came[None, None], None)
        return Arrival(came, depth(past) - jnp.round(self.time / interval[lift]).astype(int))


class DrawnDelay(NamedTuple):
    """A delay that each message draws. A message that a newer one overtakes is not heard."""

    key: Float[Array, " lanes"]  # of the random numbers
    chances: Float[Array, "d lanes"]  # that a message is late by at most 1, 2, …, d ticks

    def draw(self, time: Instants, links: tuple[int, ...]) -> Int[Array, "slots m lanes"]:
        """Ticks by which the messages of a tick are late."""
        drawn = chance.drawn(self.key, time, "delay", "uniform", links)
        return 1 + (drawn[None] >= self.chances[:-1, None, None]).sum(axis=0)

    def seconds(self, ages: Any, interval: Instants) -> Float[Array, "*links lanes"]:
        return ages.astype(float) * interval.reshape(*[1] * (ages.ndim - 1), -1)

    def on(self, links: Callable[[Array], Array]) -> "DrawnDelay":
        """The delay on some links, which each message has on its own."""
        return self

    def alike(self) -> bool:
        return False

    def arrival(self, past: Past, time: Instants, interval: Instants) -> Arrival:
        assert past.ticks is not None
        age = ages(past)
        there = past.ticks <= age
        last = len(age) - 1 - there[::-1].argmax(axis=0)
        due = (past.ticks == age) & (jnp.arange(len(age))[:, None, None, None] == last[None])
        return Arrival(due.any(axis=0), last)


class OnTime(eqx.Module):
    """LateMessages that arrive in the tick in which they are sent."""

    present: ClassVar[bool] = False

    def arriving(self, now: Moment, sent: LinkFlags) -> LinkFlags:
        """Links, of some, on which a message arrives."""
        return sent

    def jets(self, now: Moment, live: Received) -> Received:
        """Jets that listeners judge by; `live` are those of this tick."""
        return live

    def live(self, weights: AxisWeights) -> AxisWeights:
        """Weights of live messages, of these weights in force."""
        return weights

    def known_or(self, compute: Callable[[], Known]) -> Known:
        """Known part of the drives until the next tick; `compute` gives that of live messages."""
        return compute()


class Late(OnTime):
    """LateMessages that arrive some ticks later."""

    past: Past
    leading: Float[Array, "degrees 2 lanes"]  # R(y_0) from the last tick on
    known: KnownDrive

    present: ClassVar[bool] = True

    def arrival(self, now: Moment) -> Arrival:
        return now.lane.delay.arrival(self.past, now.time, now.lane.interval)

    def arriving(self, now: Moment, sent: LinkFlags) -> LinkFlags:
        return sent & self.arrival(now).came

    def live(self, weights: AxisWeights) -> AxisWeights:
        return jnp.zeros_like(weights)

    def known_or(self, compute: Callable[[], Known]) -> Known:
        return self.known

    def jets(self, now: Moment, live: Received) -> Received:
        lane, arrival = now.lane, self.arrival(now)

        def on_links(sent: Past) -> Received:
            assert sent.jets is not None
            signals = signal.jets(vectors_of(sent, lane), sent.jets.functions)
            found = tuple(
                now.network.hearing.received(*both) + then[:, None, None]
                for *both, then in zip(sent.jets.told, signals, sent.jets.navigator, strict=True)
            )
            return plane.plus(found, sent.rounding) if sent.rounding else found

        there = arrival.carried(arrival.entries(self.past), on_links)
        return tuple(
            jet - path[:, None, None] for jet, path in zip(there, now.navigator, strict=False)
        )

    def messages(self, now: Moment) -> Polynomial:
        heard = Arrivals(self.past, self.arrival(now), now.lane, now.network.hearing, now.plan)

        def plus_lie(slot: LoopIndex, listener: LoopIndex, messages: LateMessages) -> LateMessages:
            lie = heard.falsehood(slot, listener)
            return xla.add_slice(messages, (0, 0, slot, listener), lie[:, :, None, None])

        return Polynomial(heard.hearing.over_attacked_links(plus_lie, heard.sent()))

    def mean(self, now: Moment, weights: AxisWeights, start: Polynomial) -> Polynomial:
        """`start` plus the messages that arrive at a tick, by weight."""
        heard = Arrivals(self.past, self.arrival(now), now.lane, now.network.hearing, now.plan)

        def plus_lie(slot: LoopIndex, listener: LoopIndex, total: Drives) -> Drives:
            lie = weights[None, :, slot, listener] * heard.falsehood(slot, listener)
            return xla.add_slice(total, (0, 0, listener), lie[:, :, None])

        total = plus_slots(start.terms, weights, lambda slot: heard.at(slot).sent()[:, :, 0])
        return Polynomial(heard.hearing.over_attacked_links(plus_lie, total))

    def send(
        self,
        now: Moment,
        sensed: Sensed,
        lost: LinkFlags,
        known: KnownDrive,
        told: tuple[Drives, ...],
    ) -> "Late":
        """What links carry from this tick to the next, heard later.

        `told` are y, ẏ, …, y^(r) as vehicles tell them from now on, or their messages alone. `lost`
        are the links on which the channel loses the message that arrives.
        """
        lane, plan, order, gains = now.lane, now.plan, now.order, common_gains(now.lane, now.plan)
        path, functions, drive = known_parts(now, gains)
        if gains is not None and len(told) > 1:
            told = (control.feedback(gains, told),)
        of_navigator = path.swapaxes(0, 1)[:, :, :, None]  # (orders, degrees, 2, 1, lanes)
        told = tuple(jnp.concatenate(both, axis=2) for both in zip(of_navigator, told, strict=True))
        jets = None
        if plan.decides:
            relative = tell(sensed.of(now.errors)[:order])
            jets = SentJets(relative, now.navigator[:order], now.basis[:order])
        latest = Past(
            told,
            functions.swapaxes(0, 1),
            lane.vectors if self.past.vectors is not None else None,
            rounding_errors(now, sensed) if self.past.rounding else (),
            jets,
            lane.delay.draw(now.time, lane.weights.shape[:2]),
        )
        past = jax.tree.map(push, without_lost(self.past, lost), latest)
        return Late(past, drive, known)


class Arrivals(NamedTuple):
    """The late messages that arrive at a tick, and the links on which they do."""

    past: Past
    arrival: Arrival
    lane: Lane
    hearing: Hearing
    plan: Plan

    def at(self, slot: LoopIndex) -> "Arrivals":

        def one(leaf: Array, axis: int = 0) -> Array:
            return jax.lax.dynamic_index_in_dim(leaf, slot, axis)

        entry = None if self.arrival.entry is None else one(self.arrival.entry)
        return Arrivals(
            self.past._replace(rounding=tuple(one(each, -3) for each in self.past.rounding)),
            Arrival(self.arrival.came, entry),
            self.lane._replace(delay=self.lane.delay.on(one)),
            self.hearing.at(slot),
            self.plan,
        )

    def gains(self, delay: Any, entry: Any) -> Float[Array, "derivatives *some lanes"]:
        ticks = None if entry is None else depth(self.past) - entry
        seconds = delay.seconds(ticks, self.lane.interval)
        return message_gains(self.lane.gain, seconds, self.plan.extrapolate)

    def sent(self) -> LateMessages:
        """The messages without what attacks add.

        Of vehicles that tell no highest derivative, only the navigator's counts.
        """
        lane, arrival = self.lane, self.arrival
        gains = self.gains(lane.delay, arrival.entry)

        def on_links(sources: Float[Array, "degrees 2 sources lanes"]) -> LateMessages:
            return sources.at[:, :, self.hearing.carried_sources].get(mode="promise_in_bounds")

        each = [arrival.carried(order, on_links) for order in arrival.entries(self.past.told)]
        if len(each) > 1:
            each = [scaled(*both) for both in zip(each, gains, strict=True)]
        if not lane.law.couples():
            leads = (self.hearing.sources == 0)[None, None, ..., None]
            each[-1] = jnp.where(leads, each[-1], 0.0)
        messages = functools.reduce(jnp.add, each)
        if not self.past.rounding:
            return messages
        errors = arrival.carried(arrival.entries(self.past.rounding), lambda jets: jets)
        return messages.at[0].add(sum(map(scaled, errors, gains)))

    def falsehood(self, slot: LoopIndex, listener: LoopIndex) -> Float[Array, "degrees 2 lanes"]:
        """What an attack adds to the message that arrives on a link."""
        lane = self.lane
        number = jnp.asarray(self.hearing.signals)[slot, listener]
        entry = None if self.arrival.entry is None else self.arrival.entry[slot, listener]
        here = Arrival(self.arrival.came, entry)

        def signals(sent: Past) -> Float[Array, "orders degrees 2 lanes"]:
            vectors = vectors_of(sent, lane)[:, number]  # (2, B, lanes)
            parts = (
                vectors[None, None, :, b] * sent.functions[:, :, None, b]
                for b in range(vectors.shape[1])
            )
            return sum(parts, jnp.zeros(()))

        each = here.carried(here.entries(self.past), signals)
        if len(each) > 1:
            delay = lane.delay.on(lambda links: links[slot, listener])
            each = each * self.gains(delay, entry)[:, None, None]
        if not lane.law.couples():
            leads = jnp.asarray(self.hearing.sources)[slot, listener] == 0
            each = each.at[-1].multiply(jnp.where(leads, 1.0, 0.0))
        return each.sum(axis=0)


def first_late(lane: Lane, plan: Plan) -> OnTime:
    """LateMessages before the first tick: all is 0."""
    if lane.delay is None:
        return OnTime()
    d, r, (slots, m, lanes) = plan.late, len(lane.gain), lane.weights.shape
    orders, degrees = r + 1 if common_gains(lane, plan) is None else 1, late_degrees(lane)
    functions, changing = lane.vectors.shape[2], plan.strategic or lane.periods is not None

    def nothing(*shape: int) -> Float[Array, "*shape"]:
        return jnp.zeros((*shape, lanes))

    jets = None
    if plan.decides:
        jets = SentJets((nothing(d, 2, 1 + m),) * r, nothing(d, r, 2), nothing(d, r, functions))
    drawn = lane.delay.draw(jnp.zeros(lanes), (slots, m))
    past = Past(
        told=(nothing(d, degrees, 2, 1 + m),) * orders,
        functions=nothing(d, orders, degrees, functions),
        vectors=nothing(d, *lane.vectors.shape[:3]) if changing else None,
        rounding=(nothing(d, 2, slots, m),) * max(3, r) if lane.steps is not None else (),
        jets=jets,
        ticks=None if drawn is None else jnp.full((d, slots, m, lanes), NOT_ARRIVING, int),
    )
    drive = Polynomial(nothing(degrees, 2, m))  # `tick.before_first` gives it its shape
    known = KnownDrive(drive, nothing(1, m), lane.interval, jnp.zeros(lanes))
    return Late(past, nothing(degrees, 2), known)


def depth(past: Past) -> int:
    """Number of ticks that are remembered."""
    return len(past.functions)


def ages(past: Past) -> Int[Array, "d 1 1 1"]:
    """Ticks that have passed since each entry."""
    return jnp.arange(depth(past), 0, -1)[:, None, None, None]


def without_lost(past: Past, lost: LinkFlags) -> Past:
    """The past without the messages that are lost at the tick of their arrival."""
    if past.ticks is None:
        return past
    gone = lost[None] & (past.ticks == ages(past))
    return past._replace(ticks=jnp.where(gone, NOT_ARRIVING, past.ticks))


def vectors_of(sent: Past, lane: Lane) -> Vectors:
    """The attacks' vectors when something was sent."""
    return lane.vectors if sent.vectors is None else sent.vectors


def late_degrees(lane: Lane) -> int:
    """Coefficients of a message: one where a law holds a derivative between ticks."""
    return 1 if lane.law.needs_ticks() else DEGREES


def common_gains(lane: Lane, plan: Plan) -> Float[Array, "derivatives lanes"] | None:
    """Factors of derivatives in messages if all links of a lane share them (one sum), else None."""
    if not lane.law.couples():
        return None
    if plan.extrapolate == "none":
        return message_gains(lane.gain, None, plan.extrapolate)
    if lane.delay.alike():
        return message_gains(lane.gain, lane.delay.time, plan.extrapolate)
    return None


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


def known_parts(
    now: Moment, gains: Float[Array, "derivatives lanes"] | None
) -> tuple[Array, Array, Array]:
    """Navigator's and attacks' part of a message's orders, (degrees, orders, …), and R(y_0)."""
    lane, held = now.lane, now.lane.law.needs_ticks()
    points = np.zeros(1) if held else polynomial.chebyshev_points(DEGREES)
    instants = now.time[None] + jnp.asarray(points)[:, None] * lane.interval[None]

    def functions_at(time: Instants) -> tuple[Array, Array, Array]:
        path, functions = (each[: now.order + 1] for each in (lane.path(time), lane.basis(time)))
        drive = control.driven(lane.gain, path)
        if gains is None:
            return path, functions, drive
        return *(control.feedback(gains, each)[None] for each in (path, functions)), drive

    parts = xla.materialised(lambda: jax.vmap(functions_at)(instants))
    path, functions, drive = (
        parts if held else (polynomial.interpolated(each).terms for each in parts)
    )
    return path, functions, drive


def motion_told(
    now: Moment, drive: Polynomial, sensed: Sensed, strength: Callable[[PerAxis], PerAxis]
) -> tuple[Drives, ...]:
    """y, ẏ, …, y^(r) that vehicles tell from now on, by the power series of `y^(r) = s (z - P(y +
    n))`.

    `strength` multiplies by s. In the series, time is counted in ticks.
    """
    gain, order, interval = now.lane.gain, now.order, now.lane.interval
    powers = [interval**k for k in range(order + 1)]
    series = [scaled(jet, powers[k]) for k, jet in enumerate(now.own)]
    first = [scaled(jet, powers[k]) for k, jet in enumerate(sensed.of(now.own))]
    gain = jnp.stack([each * powers[order - k] for k, each in enumerate(gain)])
    for n in range(DEGREES):
        own = tuple(series[n : n + order]) if n else tuple(first)
        series.append(strength(scaled(drive.terms[n], powers[order]) - control.feedback(gain, own)))
    told = [scaled(jnp.stack(series[k : k + DEGREES]), 1 / powers[k]) for k in range(order + 1)]
    begin = (*sensed.of(tuple(each[0] for each in told[:order])), told[order][0])
    return tuple(each.at[0].set(start) for each, start in zip(told, begin, strict=True))


def push(queue: Shaped[Array, "d *some"], last: Shaped[Array, "*some"]) -> Shaped[Array, "d *some"]:
    """A queue without its first entry, and with a last one."""
    return jnp.concatenate([queue[1:], last[None]])
