"""Late words: what each link carried some ticks ago, as a polynomial of time (theorems.md O16).

Under the exact law a word is X_j = R(y_j) plus R of the attack. A late word is known before the tick in which
a vehicle follows it, and so is the drive `z_i = Σ_j w_ij X_j` of the vehicle, which is the vehicle's own next
word. So no system of equations is left to solve. Under a local law, a word is P(y_j). Under a law by
exchanges, a word is the derivative that the vehicle holds until now, plus P(y_j).

Over a tick, a word is the polynomial through its values at `POINTS` of the tick. Words that are polynomials
stay the same to rounding; navigator and attack are interpolated. Vehicles that extrapolate, or that follow a
local law, tell their motion, a power series over a tick. Where a law holds a derivative from tick to tick, a
word is the one number that its listener hears at a tick.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from jaxnet.engine.plan import Plan
from jaxnet.kinds.shapes import LaneTimes
from jaxnet.model import chance, control, plane, signal, xla
from jaxnet.model.hearing import AxisWeights, Hearing, plus_slots
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Jets
from jaxnet.model.shapes import LoopIndex
from jaxnet.model.signal import Vectors

# Coefficients of a polynomial. A harmonic of ω [rad/s] errs by under (ωh/4)⁸ / 20,160 of its size.
DEGREES = 8
POINTS = (
    1 - np.cos(np.pi * (np.arange(DEGREES) + 0.5) / DEGREES)
) / 2  # Chebyshev's, on a tick of length 1
TO_COEFFICIENTS = np.linalg.inv(
    POINTS[:, None] ** np.arange(DEGREES) / [math.factorial(k) for k in range(DEGREES)]
)  # of σ^k / k!, with σ the share of a tick
NOT_ARRIVING = 2**30  # ticks by which a message is late that is lost

Polynomials = Float[Array, "2 degrees m lanes"]  # coefficients of σ^k / k!
LinkPolynomials = Float[Array, "2 degrees slots m lanes"]
CarriedJets = tuple[Float[Array, "2 slots m lanes"], ...]
LinkFlags = Bool[Array, "#slots #m lanes"]
LinkNumbers = Int[Array, "slots m lanes"]


class SentJets(NamedTuple):
    """Jets of y at a tick, which listeners judge by."""

    told: tuple[
        Float[Array, "*d 2 sources lanes"], ...
    ]  # relative to the navigator, which comes first
    navigator: Float[Array, "*d r 2 lanes"]
    functions: Float[Array, "*d r B lanes"]  # of the attacks


class History(NamedTuple):
    """What vehicles, navigator and attackers sent in the last d ticks, the oldest tick first.

    d is the greatest delay in ticks. Of one tick, the arrays have no axis d. A word is the sum of its orders:
    of one, or of those of y, ẏ, …, y^(r).
    """

    told: tuple[Float[Array, "*d 2 degrees sources lanes"], ...]
    functions: Float[Array, "*d orders degrees B lanes"]  # of the attacks
    vectors: (
        Float[Array, "*d 2 signals B lanes"] | None
    )  # of the attacks; None: at all times the lane's
    rounding: (
        tuple[Float[Array, "*d 2 slots m lanes"], ...] | None
    )  # errors of jets; None: none are rounded
    jets: SentJets | None  # None where nobody judges
    ticks: (
        Int[Array, "*d slots m lanes"] | None
    )  # by which messages are late, where each has its own delay
    leading: Float[Array, "degrees 2 lanes"] | None  # R(y_0) from the last tick on


class Arrival(NamedTuple):
    """The messages that arrive at a tick: the newest one on each link that is newer than all before."""

    came: LinkFlags
    entry: Int[Array, "*links lanes"] | None  # its place in the history; None for the first

    def entries(self, history: Any) -> Any:
        """Return the tick of a history that all messages are of, or where links differ, all ticks."""
        return history if self.entry is not None else jax.tree.map(lambda leaf: leaf[0], history)

    def carried(self, entries: Any, links: Callable[[Any], Any]) -> Any:
        """Return what the messages carry, where `links` gives what all links carry of one tick."""
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

    def draw(self, time: LaneTimes, links: tuple[int, ...]) -> None:
        """Return that messages have no delays of their own."""

    def seconds(
        self, ages: Int[Array, "*_ lanes"] | None, interval: LaneTimes
    ) -> Float[Array, "*links lanes"]:
        """Return the delay [s] of messages, which arrive so many ticks late."""
        return self.time

    def on(self, links: Callable[[Array], Array]) -> "SteadyDelay":
        """Return the delay on some links."""
        return self if self.time.ndim == 1 else SteadyDelay(links(self.time))

    def arrival(self, history: History, time: LaneTimes, interval: LaneTimes) -> Arrival:
        """Return the messages that arrive at a tick."""
        lift = (None,) * (self.time.ndim - 1)
        came = time[lift] > self.time - interval[lift] / 2
        if not lift:
            return Arrival(came[None, None], None)
        return Arrival(came, depth(history) - jnp.round(self.time / interval[lift]).astype(int))


class DrawnDelay(NamedTuple):
    """A delay that each message draws. A message that a newer one overtakes is not heard."""

    key: Float[Array, " lanes"]  # of the random numbers
    chances: Float[Array, "d lanes"]  # that a message is late by at most 1, 2, …, d ticks

    def draw(self, time: LaneTimes, links: tuple[int, ...]) -> LinkNumbers:
        """Return the ticks by which the messages of a tick are late."""
        drawn = chance.drawn(self.key, time, "delay", "uniform", links)
        return 1 + (drawn[None] >= self.chances[:-1, None, None]).sum(axis=0)

    def seconds(
        self, ages: Int[Array, "*links lanes"], interval: LaneTimes
    ) -> Float[Array, "*links lanes"]:
        """Return the delay [s] of messages, which arrive so many ticks late."""
        return ages.astype(float) * interval.reshape(*[1] * (ages.ndim - 1), -1)

    def on(self, links: Callable[[Array], Array]) -> "DrawnDelay":
        """Return the delay on some links, which each message has on its own."""
        return self

    def arrival(self, history: History, time: LaneTimes, interval: LaneTimes) -> Arrival:
        """Return the messages that arrive at a tick."""
        assert history.ticks is not None
        age = ages(history)
        there = history.ticks <= age
        last = len(age) - 1 - there[::-1].argmax(axis=0)
        due = (history.ticks == age) & (jnp.arange(len(age))[:, None, None, None] == last[None])
        return Arrival(due.any(axis=0), last)


def depth(history: History) -> int:
    """Return the number of ticks in a history."""
    return len(history.functions)


def ages(history: History) -> Int[Array, "d 1 1 1"]:
    """Return the ticks that have passed since each entry of a history."""
    return jnp.arange(depth(history), 0, -1)[:, None, None, None]


def word_degrees(lane: Lane) -> int:
    """Return the number of coefficients of a word: one where a law holds a derivative between ticks."""
    return 1 if lane.law.needs_ticks() else DEGREES


def common_gains(lane: Lane, plan: Plan) -> Float[Array, "derivatives lanes"] | None:
    """Return the factors of derivatives in words if all links of a lane have the same, else None.

    Sources then tell one sum.
    """
    if not lane.law.couples():
        return None
    if plan.extrapolate == "none":
        return word_gains(lane.gain, None, plan.extrapolate)
    if isinstance(lane.delay, SteadyDelay) and lane.delay.time.ndim == 1:
        return word_gains(lane.gain, lane.delay.time, plan.extrapolate)
    return None


def first_history(lane: Lane, plan: Plan) -> History:
    """Return the history before the first tick, in which all is 0."""
    d, r, (slots, m, lanes) = plan.late, len(lane.gain), lane.weights.shape
    orders, degrees = r + 1 if common_gains(lane, plan) is None else 1, word_degrees(lane)
    functions, changing = lane.vectors.shape[2], plan.strategic or lane.periods is not None

    def nothing(*shape: int) -> Float[Array, "*shape"]:
        return jnp.zeros((d, *shape, lanes))

    jets = None
    if plan.decides:
        jets = SentJets((nothing(2, 1 + m),) * r, nothing(r, 2), nothing(r, functions))
    drawn = lane.delay.draw(jnp.zeros(lanes), (slots, m))
    return History(
        told=(nothing(2, degrees, 1 + m),) * orders,
        functions=nothing(orders, degrees, functions),
        vectors=nothing(*lane.vectors.shape[:3]) if changing else None,
        rounding=(nothing(2, slots, m),) * max(3, r) if lane.steps is not None else None,
        jets=jets,
        ticks=None if drawn is None else jnp.full((d, slots, m, lanes), NOT_ARRIVING, int),
        leading=jnp.zeros((degrees, 2, lanes)),
    )


def arrival(history: History, lane: Lane, time: LaneTimes) -> Arrival:
    """Return the messages that arrive at a tick."""
    return lane.delay.arrival(history, time, lane.interval)


def without_lost(history: History, lost: Bool[Array, "slots m lanes"]) -> History:
    """Return the history without the messages that are lost at the tick of their arrival."""
    if history.ticks is None:
        return history
    lost = lost[None] & (history.ticks == ages(history))
    return history._replace(ticks=jnp.where(lost, NOT_ARRIVING, history.ticks))


def arriving_jets(
    history: History,
    arrival: Arrival,
    lane: Lane,
    hearing: Hearing,
    navigator: Float[Array, "derivatives 2 lanes"],
) -> CarriedJets:
    """Return the late jets that arrive at a tick, relative to the navigator's jets now."""

    def on_links(sent: History) -> CarriedJets:
        assert sent.jets is not None
        signals = signal.jets(vectors_of(sent, lane), sent.jets.functions)
        found = (
            hearing.received(*both) + then[:, None, None]
            for *both, then in zip(sent.jets.told, signals, sent.jets.navigator, strict=True)
        )
        return tuple(found) if sent.rounding is None else plane.plus(tuple(found), sent.rounding)

    there = arrival.carried(arrival.entries(history._replace(leading=None)), on_links)
    return tuple(jet - now[:, None, None] for jet, now in zip(there, navigator, strict=False))


def arriving_words(
    history: History, arrival: Arrival, lane: Lane, hearing: Hearing, plan: Plan
) -> LinkPolynomials:
    """Return the late words that arrive at a tick."""
    told, rounding = map(arrival.entries, (history.told, history.rounding))
    words = sent_words(told, rounding, arrival, lane, hearing, plan, depth(history))

    def plus_lie(slot: LoopIndex, listener: LoopIndex, words: LinkPolynomials) -> LinkPolynomials:
        lie = false_word(history, arrival, lane, hearing, plan, slot, listener)
        return xla.add_slice(words, (0, 0, slot, listener), lie[:, :, None, None])

    return hearing.over_attacked_links(plus_lie, words)


def mean_words(
    history: History,
    arrival: Arrival,
    lane: Lane,
    hearing: Hearing,
    plan: Plan,
    weights: AxisWeights,
    start: Polynomials,
) -> Polynomials:
    """Return `start` plus the late words that arrive at a tick, by weight."""
    told, rounding = map(arrival.entries, (history.told, history.rounding))

    def word(slot: LoopIndex) -> Polynomials:
        def one(leaf: Array, axis: int) -> Array:
            return jax.lax.dynamic_index_in_dim(leaf, slot, axis)

        entry = None if arrival.entry is None else one(arrival.entry, 0)
        errors = None if rounding is None else tuple(one(each, -3) for each in rounding)
        there = lane._replace(delay=lane.delay.on(lambda links: one(links, 0)))
        given = (
            told,
            errors,
            Arrival(arrival.came, entry),
            there,
            hearing.at(slot),
            plan,
            depth(history),
        )
        return sent_words(*given)[:, :, 0]

    def plus_lie(slot: LoopIndex, listener: LoopIndex, total: Polynomials) -> Polynomials:
        lie = false_word(history, arrival, lane, hearing, plan, slot, listener)
        return xla.add_slice(
            total, (0, 0, listener), (weights[:, slot, listener][:, None] * lie)[:, :, None]
        )

    return hearing.over_attacked_links(plus_lie, plus_slots(start, weights, word))


def sent_words(
    told: tuple[Float[Array, "*d 2 degrees sources lanes"], ...],
    rounding: tuple[Float[Array, "*d 2 slots m lanes"], ...] | None,
    arrival: Arrival,
    lane: Lane,
    hearing: Hearing,
    plan: Plan,
    depth: int,
) -> LinkPolynomials:
    """Return the late words that arrive at a tick, without what attacks add to them.

    `told` and `rounding` are `Arrival.entries` of a history of this depth. Under a local law only the
    navigator tells its r-th derivative.
    """
    ticks = None if arrival.entry is None else depth - arrival.entry
    gains = word_gains(lane.gain, lane.delay.seconds(ticks, lane.interval), plan.extrapolate)

    def on_links(sources: Float[Array, "2 degrees sources lanes"]) -> LinkPolynomials:
        return sources.at[:, :, hearing.carried_sources].get(mode="promise_in_bounds")

    each = [arrival.carried(order, on_links) for order in told]
    if len(each) > 1:
        each = [weighed(*both) for both in zip(each, gains, strict=True)]
    if not lane.law.couples():
        each[-1] = jnp.where((hearing.sources == 0)[None, None, ..., None], each[-1], 0.0)
    words = sum(each[1:], each[0])
    if rounding is None:
        return words
    errors = arrival.carried(rounding, lambda jets: jets)
    return words.at[:, 0].add(sum(map(weighed, errors, gains)))


def false_word(
    history: History,
    arrival: Arrival,
    lane: Lane,
    hearing: Hearing,
    plan: Plan,
    slot: LoopIndex,
    listener: LoopIndex,
) -> Float[Array, "2 degrees lanes"]:
    """Return what an attack adds to the late word that arrives on a link."""
    number = jnp.asarray(hearing.signals)[slot, listener]
    entry = None if arrival.entry is None else arrival.entry[slot, listener]
    here = Arrival(arrival.came, entry)

    def signals(sent: History) -> Float[Array, "orders 2 degrees lanes"]:
        vectors = vectors_of(sent, lane)[:, number]  # (2, B, lanes)
        parts = (
            vectors[None, :, None, b] * sent.functions[:, None, :, b]
            for b in range(vectors.shape[1])
        )
        return sum(parts, jnp.zeros(()))

    each = here.carried(here.entries(history._replace(leading=None)), signals)
    if len(each) > 1:
        delay = lane.delay.on(lambda links: links[slot, listener])
        ticks = None if entry is None else depth(history) - entry
        gains = word_gains(lane.gain, delay.seconds(ticks, lane.interval), plan.extrapolate)
        each = each * gains[:, None, None]
    if not lane.law.couples():
        leads = jnp.asarray(hearing.sources)[slot, listener] == 0
        each = each.at[-1].multiply(jnp.where(leads, 1.0, 0.0))
    return each.sum(axis=0)


def vectors_of(sent: History, lane: Lane) -> Vectors:
    """Return the attacks' vectors when something was sent."""
    return lane.vectors if sent.vectors is None else sent.vectors


def remember(
    history: History,
    lane: Lane,
    plan: Plan,
    told: tuple[Polynomials, ...],
    vectors: Vectors | None,
    rounding: CarriedJets | None,
    jets: SentJets | None,
    time: LaneTimes,
) -> History:
    """Return the history after a tick.

    `told` are y, ẏ, …, y^(r) as vehicles tell them from now on, or their words alone.
    """
    points = np.zeros(1) if lane.law.needs_ticks() else POINTS
    instants = time[None] + jnp.asarray(points)[:, None] * lane.interval[None]
    gains = common_gains(lane, plan)

    def functions_at(now: LaneTimes) -> tuple[Array, Array, Array]:
        """Return the navigator's and the attacks' part of each order of a word, and R(y_0)."""
        path, functions = (each[: len(lane.gain) + 1] for each in (lane.path(now), lane.basis(now)))
        drive = control.driven(lane.gain, path)
        if gains is None:
            return path, functions, drive
        return *(control.feedback(gains, each)[None] for each in (path, functions)), drive

    parts = xla.materialised(lambda: jax.vmap(functions_at)(instants))
    if not lane.law.needs_ticks():
        parts = map(coefficients, parts)
    path, functions, drive = parts
    functions = functions.swapaxes(0, 1)
    if gains is not None and len(told) > 1:
        told = (control.feedback(gains, told),)
    of_navigator = path.transpose(1, 2, 0, 3)[:, :, :, None]  # (orders, 2, degrees, 1, lanes)
    told = tuple(jnp.concatenate(both, axis=2) for both in zip(of_navigator, told, strict=True))
    ticks = lane.delay.draw(time, lane.weights.shape[:2])
    now = History(told, functions, vectors, rounding, jets, ticks, None)
    return jax.tree.map(push, history._replace(leading=None), now)._replace(leading=drive)


def weighed(term: Float[Array, "*some"], factor: Float[Array, "*fewer"]) -> Float[Array, "*some"]:
    """Return a term times the factor of its order, which lanes have, or links and lanes."""
    return term * factor.reshape(*[1] * (term.ndim - factor.ndim), *factor.shape)


def word_gains(
    gain: Float[Array, "r lanes"], delay: Float[Array, "*links lanes"] | None, extrapolate: str
) -> Float[Array, "derivatives *some lanes"]:
    """Return the factors of y, ẏ, …, y^(r) in a word: those of R, or of R after the delay by Taylor.

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


def motion_of(
    gain: Float[Array, "r lanes"],
    drive: Polynomials,
    own: Jets,
    noise: Jets | None,
    strength: Float[Array, "axes m lanes"] | None,
    interval: LaneTimes,
) -> tuple[Polynomials, ...]:
    """Return y, ẏ, …, y^(r) that vehicles tell from now on, by the power series of
    `y^(r) = s (z - P(y + n))`. The strength s is 1 where it is None. In the series, time is counted in ticks.
    """
    order, powers = len(gain), [interval**k for k in range(len(gain) + 1)]
    gain = jnp.stack([each * powers[order - k] for k, each in enumerate(gain)])
    series = [weighed(jet, powers[k]) for k, jet in enumerate(own)]
    for n in range(DEGREES):
        sensed = series[n : n + order]
        if n == 0 and noise is not None:
            sensed = plane.plus(
                sensed, [weighed(jet, powers[k]) for k, jet in enumerate(noise[:order])]
            )
        asked = weighed(drive[:, n], powers[order]) - control.feedback(gain, sensed)
        series.append(asked if strength is None else strength * asked)
    told = [
        weighed(jnp.stack(series[k : k + DEGREES], axis=1), 1 / powers[k]) for k in range(order + 1)
    ]
    if noise is not None:
        told[:order] = [each.at[:, 0].add(error) for each, error in zip(told, noise, strict=False)][
            :order
        ]
    return tuple(told)


def coefficients(
    values: Float[Array, "points *some lanes"],
) -> Float[Array, "degrees *some lanes"]:
    """Return the coefficients of the polynomials with these values at POINTS of a tick.

    They are those of the differences from one value, for rounding grows with what is interpolated.
    """
    matrix = jnp.asarray(TO_COEFFICIENTS).reshape(DEGREES, DEGREES, *[1] * (values.ndim - 1))
    found = (matrix[:, n] * (values[n] - values[0])[None] for n in range(1, DEGREES))
    return sum(found, jnp.zeros_like(values)).at[0].add(values[0])


def push(queue: Shaped[Array, "d *some"], last: Shaped[Array, "*some"]) -> Shaped[Array, "d *some"]:
    """Return a queue without its first entry, and with a last one."""
    return jnp.concatenate([queue[1:], last[None]])
