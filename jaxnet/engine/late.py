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
from jaxnet.model import chance, control, plane, signal
from jaxnet.model.hearing import Hearing
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Vectors

# Coefficients of a polynomial. A harmonic of ω [rad/s] errs by under (ωh/4)⁸ / 20,160 of its size.
DEGREES = 8
POINTS = (1 - np.cos(np.pi * (np.arange(DEGREES) + 0.5) / DEGREES)) / 2  # Chebyshev's, on a tick of length 1
TO_COEFFICIENTS = np.linalg.inv(
    POINTS[:, None] ** np.arange(DEGREES) / [math.factorial(k) for k in range(DEGREES)]
)
NOT_ARRIVING = 2**30  # ticks by which a message is late that is lost

Polynomials = Float[Array, "2 degrees m lanes"]  # coefficients of s^k / k!
LinkPolynomials = Float[Array, "2 degrees slots m lanes"]
CarriedJets = tuple[Float[Array, "2 slots m lanes"], ...]
LinkFlags = Bool[Array, "#slots #m lanes"]
LinkNumbers = Int[Array, "slots m lanes"]


class SentJets(NamedTuple):
    """Jets of y at a tick, which listeners judge by."""

    told: tuple[Float[Array, "*d 2 sources lanes"], ...]  # relative to the navigator, which comes first
    navigator: Float[Array, "*d r 2 lanes"]
    functions: Float[Array, "*d r B lanes"]  # of the attacks


class History(NamedTuple):
    """What vehicles, navigator and attackers sent in the last d ticks, the oldest tick first.

    d is the greatest delay in ticks. Of one tick, the arrays have no axis d. A word is the sum of its orders:
    of one, or of those of y, ẏ, …, y^(r).
    """

    told: tuple[Float[Array, "*d 2 degrees m lanes"], ...]  # coefficients of s^k / k!, s since the tick
    path: Float[Array, "*d orders degrees 2 lanes"]  # the navigator's
    functions: Float[Array, "*d orders degrees B lanes"]  # of the attacks
    vectors: Float[Array, "*d 2 signals B lanes"] | None  # of the attacks; None: at all times the lane's
    rounding: tuple[Float[Array, "*d 2 slots m lanes"], ...] | None  # errors of jets; None: none are rounded
    jets: SentJets | None  # None where nobody judges
    ticks: Int[Array, "*d slots m lanes"] | None  # by which messages are late, where each has its own delay


class Arrival(NamedTuple):
    """The messages that arrive at a tick: the newest one on each link that is newer than all before."""

    came: LinkFlags
    entry: LinkNumbers | None  # its place in the history; None for the first

    def of(self, history: History, carried: Callable[[History], Any]) -> Any:
        """Return what the messages carry, where `carried` gives what all links carry of one tick."""
        if self.entry is None:
            return carried(jax.tree.map(lambda leaf: leaf[0], history))
        entry = self.entry

        def of_entry(each: Float[Array, "d *some"]) -> Float[Array, "*some"]:
            place = entry.reshape(*[1] * (each.ndim - 3), *entry.shape)
            return jnp.take_along_axis(each, place, axis=0)[0]

        return jax.tree.map(of_entry, jax.vmap(carried)(history))


class SteadyDelay(NamedTuple):
    """A delay that all messages of a link have."""

    time: Float[Array, "*links lanes"]  # [s], (lanes,) for all links, or (slots, m, lanes)

    def draw(self, time: LaneTimes, links: tuple[int, ...]) -> None:
        """Return that messages have no delays of their own."""

    def seconds(self, ages: LinkNumbers | None, interval: LaneTimes) -> Float[Array, "*links lanes"]:
        """Return the delay [s] of messages, which arrive so many ticks late."""
        return self.time

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

    def seconds(self, ages: LinkNumbers, interval: LaneTimes) -> Float[Array, "slots m lanes"]:
        """Return the delay [s] of messages, which arrive so many ticks late."""
        return ages.astype(float) * interval[None, None]

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
    return len(history.path)


def ages(history: History) -> Int[Array, "d 1 1 1"]:
    """Return the ticks that have passed since each entry of a history."""
    return jnp.arange(depth(history), 0, -1)[:, None, None, None]


def word_degrees(lane: Lane) -> int:
    """Return the number of coefficients of a word: one where a law holds a derivative between ticks."""
    return 1 if lane.law.holds else DEGREES


def common_gains(lane: Lane, plan: Plan) -> Float[Array, "derivatives lanes"] | None:
    """Return the factors of derivatives in words if all links of a lane have the same, else None.

    Sources then tell one sum.
    """
    if lane.law.local:
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
        told=(nothing(2, degrees, m),) * orders,
        path=nothing(orders, degrees, 2),
        functions=nothing(orders, degrees, functions),
        vectors=nothing(*lane.vectors.shape[:3]) if changing else None,
        rounding=(nothing(2, slots, m),) * max(3, r) if lane.steps is not None else None,
        jets=jets,
        ticks=None if drawn is None else jnp.full((d, slots, m, lanes), NOT_ARRIVING, int),
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

    def carried(sent: History) -> CarriedJets:
        assert sent.jets is not None
        signals = signal.jets(vectors_of(sent, lane), sent.jets.functions)
        found = (
            hearing.received(*both) + then[:, None, None]
            for *both, then in zip(sent.jets.told, signals, sent.jets.navigator, strict=True)
        )
        return tuple(found) if sent.rounding is None else plane.plus(tuple(found), sent.rounding)

    there = arrival.of(history, carried)
    return tuple(jet - now[:, None, None] for jet, now in zip(there, navigator, strict=False))


def arriving_words(
    history: History, arrival: Arrival, lane: Lane, hearing: Hearing, plan: Plan
) -> LinkPolynomials:
    """Return the late words that arrive at a tick.

    Under a local law only the navigator tells its r-th derivative.
    """
    ticks = None if arrival.entry is None else depth(history) - arrival.entry
    gains = word_gains(lane.gain, lane.delay.seconds(ticks, lane.interval), plan.extrapolate)

    def carried(sent: History) -> tuple[LinkPolynomials, ...]:
        vectors = vectors_of(sent, lane)

        def on_links(
            path: Float[Array, "2 lanes"], functions: Float[Array, "B lanes"], told: plane.Plane
        ) -> Float[Array, "2 slots m lanes"]:
            sources = jnp.concatenate([path[:, None], told], axis=1)
            return hearing.received(sources, signal.combined(vectors, functions))

        orders = zip(sent.path, sent.functions, sent.told, strict=True)
        return tuple(jax.vmap(on_links, (0, 0, 1), 1)(*each) for each in orders)

    each = list(arrival.of(history, carried))
    if len(each) > 1:
        each = [weighed(*both) for both in zip(each, gains, strict=True)]
    if lane.law.local:
        each[-1] = jnp.where((hearing.sources == 0)[None, None, ..., None], each[-1], 0.0)
    words = sum(each[1:], each[0])
    if history.rounding is None:
        return words
    rounding = arrival.of(history, lambda sent: sent.rounding)
    return words.at[:, 0].add(sum(map(weighed, rounding, gains)))


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
    points = np.zeros(1) if lane.law.holds else POINTS
    instants = time[None] + jnp.asarray(points)[:, None] * lane.interval[None]
    gains = common_gains(lane, plan)

    def sources(now: LaneTimes) -> tuple[Array, Array]:
        """Return the navigator's and the attacks' part of each order of a word."""
        known = lane.path(now), lane.basis(now)
        parts = (
            each[: len(lane.gain) + 1] if gains is None else control.feedback(gains, each)[None]
            for each in known
        )
        return tuple(parts)  # pyright: ignore[reportReturnType]

    path, functions = jax.vmap(sources)(instants)
    if not lane.law.holds:
        path, functions = (coefficients(each, lane.interval) for each in (path, functions))
    path, functions = path.swapaxes(0, 1), functions.swapaxes(0, 1)
    if gains is not None and len(told) > 1:
        told = (control.feedback(gains, told),)
    ticks = lane.delay.draw(time, lane.weights.shape[:2])
    return jax.tree.map(push, history, History(told, path, functions, vectors, rounding, jets, ticks))


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
) -> tuple[Polynomials, ...]:
    """Return y, ẏ, …, y^(r) that vehicles tell from now on, by the power series of
    `y^(r) = s (z - P(y + n))`. The strength s is 1 where it is None.
    """
    series, order = [*own], len(gain)
    for n in range(DEGREES):
        sensed = series[n : n + order]
        if n == 0 and noise is not None:
            sensed = plane.plus(sensed, noise)
        asked = drive[:, n] - control.feedback(gain, sensed)
        series.append(asked if strength is None else strength * asked)
    told = [jnp.stack(series[k : k + DEGREES], axis=1) for k in range(order + 1)]
    if noise is not None:
        told[:order] = [each.at[:, 0].add(error) for each, error in zip(told, noise, strict=False)][:order]
    return tuple(told)


def coefficients(
    values: Float[Array, "points *some lanes"], interval: Float[Array, " lanes"]
) -> Float[Array, "degrees *some lanes"]:
    """Return the coefficients of s^k / k! of the polynomials with these values at POINTS of a tick."""
    scale = interval[None] ** -jnp.arange(float(DEGREES))[:, None]
    scale = scale.reshape(DEGREES, *[1] * (values.ndim - 2), -1)
    return jnp.tensordot(jnp.asarray(TO_COEFFICIENTS), values, 1) * scale


def push(queue: Shaped[Array, "d *some"], last: Shaped[Array, "*some"]) -> Shaped[Array, "d *some"]:
    """Return a queue without its first entry, and with a last one."""
    return jnp.concatenate([queue[1:], last[None]])
