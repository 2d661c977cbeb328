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
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from jaxnet.engine.plan import Plan
from jaxnet.kinds.shapes import LaneTimes
from jaxnet.model import chance, control, plane, signal
from jaxnet.model.lane import Lane, Network
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


class History(NamedTuple):
    """What each link carried in the last d ticks, the oldest tick first. d is the greatest delay in ticks."""

    words: Float[Array, "d 2 degrees slots m lanes"]  # coefficients of s^k / k!, s the time since the tick
    jets: tuple[Float[Array, "d 2 slots m lanes"], ...] | None  # of y at the ticks; None where nobody judges
    ticks: Int[Array, "d slots m lanes"] | None  # by which messages are late, where each has its own delay


class Arrival(NamedTuple):
    """The messages that arrive at a tick: the newest one on each link that is newer than all before."""

    came: LinkFlags
    entry: LinkNumbers | None  # its place in the history; None for the first

    def of(self, queue: Float[Array, "d *some"]) -> Float[Array, "*some"]:
        """Return what the messages hold of a part of the history."""
        if self.entry is None:
            return queue[0]
        place = self.entry.reshape(*[1] * (queue.ndim - 3), *self.entry.shape)
        return jnp.take_along_axis(queue, place, axis=0)[0]


class SteadyDelay(NamedTuple):
    """A delay that all messages of a link have."""

    time: Float[Array, "*links lanes"]  # [s], (lanes,) for all links, or (slots, m, lanes)

    def draw(self, time: LaneTimes, links: tuple[int, ...]) -> None:
        """Return that messages have no delays of their own."""

    def seconds(self, ticks: None, interval: LaneTimes) -> Float[Array, "*links lanes"]:
        """Return the delay of the messages of a tick [s]."""
        return self.time

    def arrival(self, history: History, time: LaneTimes, interval: LaneTimes) -> Arrival:
        """Return the messages that arrive at a tick."""
        lift = (None,) * (self.time.ndim - 1)
        came = time[lift] > self.time - interval[lift] / 2
        if not lift:
            return Arrival(came[None, None], None)
        return Arrival(came, len(history.words) - jnp.round(self.time / interval[lift]).astype(int))


class DrawnDelay(NamedTuple):
    """A delay that each message draws. A message that a newer one overtakes is not heard."""

    key: Float[Array, " lanes"]  # of the random numbers
    chances: Float[Array, "d lanes"]  # that a message is late by at most 1, 2, …, d ticks

    def draw(self, time: LaneTimes, links: tuple[int, ...]) -> LinkNumbers:
        """Return the ticks by which the messages of a tick are late."""
        drawn = chance.drawn(self.key, time, "delay", "uniform", links)
        return 1 + (drawn[None] >= self.chances[:-1, None, None]).sum(axis=0)

    def seconds(self, ticks: LinkNumbers, interval: LaneTimes) -> Float[Array, "slots m lanes"]:
        """Return the delay of the messages of a tick [s]."""
        return ticks.astype(float) * interval[None, None]

    def arrival(self, history: History, time: LaneTimes, interval: LaneTimes) -> Arrival:
        """Return the messages that arrive at a tick."""
        assert history.ticks is not None
        age = ages(history)
        there = history.ticks <= age
        last = len(age) - 1 - there[::-1].argmax(axis=0)
        due = (history.ticks == age) & (jnp.arange(len(age))[:, None, None, None] == last[None])
        return Arrival(due.any(axis=0), last)


def ages(history: History) -> Int[Array, "d 1 1 1"]:
    """Return the ticks that have passed since each entry of a history."""
    return jnp.arange(len(history.words), 0, -1)[:, None, None, None]


def word_degrees(lane: Lane) -> int:
    """Return the number of coefficients of a word: one where a law holds a derivative between ticks."""
    return 1 if lane.law.holds else DEGREES


def first_history(lane: Lane, late: int, judged: bool) -> History:
    """Return the history before the first tick, for a delay of at most `late` ticks."""
    links = lane.weights.shape
    nothing, words = jnp.zeros((late, 2, *links)), jnp.zeros((late, 2, word_degrees(lane), *links))
    drawn = lane.delay.draw(jnp.zeros(links[-1]), links[:-1])
    ticks = None if drawn is None else jnp.full((late, *links), NOT_ARRIVING, int)
    return History(words, (nothing,) * len(lane.gain) if judged else None, ticks)


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
    history: History, arrival: Arrival, navigator: Float[Array, "derivatives 2 lanes"]
) -> CarriedJets:
    """Return the late jets that arrive at a tick, relative to the navigator's jets now."""
    assert history.jets is not None
    return tuple(
        arrival.of(jet) - now[:, None, None] for jet, now in zip(history.jets, navigator, strict=False)
    )


def remember(
    history: History,
    lane: Lane,
    network: Network,
    plan: Plan,
    vectors: Vectors,
    told: tuple[Polynomials, ...],
    jets: CarriedJets | None,
    rounding: CarriedJets | None,
    time: LaneTimes,
) -> History:
    """Return the history after a tick.

    `told` are y, ẏ, …, y^(r) as vehicles tell them from now on, or their words alone. Links carry the jets
    `jets` now, with the errors `rounding`. Under a local law only the navigator tells its r-th derivative.
    """
    links = lane.weights.shape[:2]
    ticks = lane.delay.draw(time, links)
    gains = word_gains(lane.gain, lane.delay.seconds(ticks, lane.interval), plan.extrapolate)
    alike = gains.ndim == 2 and not lane.law.local
    points = np.zeros(1) if lane.law.holds else POINTS
    instants = time[None] + jnp.asarray(points)[:, None] * lane.interval[None]

    def sources(now: LaneTimes) -> tuple[Array, Array]:
        """Return the navigator's and the attacks' part of a word, or of each derivative in a word."""
        known = lane.path(now), lane.basis(now)
        told = (control.feedback(gains, each)[None] if alike else each[: len(gains)] for each in known)
        return tuple(told)  # pyright: ignore[reportReturnType]

    path, functions = jax.vmap(sources)(instants)
    if not lane.law.holds:
        path, functions = (coefficients(each, lane.interval) for each in (path, functions))
    if alike and len(told) > 1:
        told = (control.feedback(gains, told),)

    def carried(
        path: Float[Array, "2 lanes"], functions: Float[Array, "B lanes"], told: plane.Plane
    ) -> Float[Array, "2 slots m lanes"]:
        sources = jnp.concatenate([path[:, None], told], axis=1)
        return network.hearing.received(sources, signal.combined(vectors, functions))

    each = [jax.vmap(carried, (0, 0, 1), 1)(path[:, n], functions[:, n], told[n]) for n in range(len(told))]
    if not alike:
        each = [weighed(*both) for both in zip(each, gains, strict=True)]
    if lane.law.local:
        each[-1] = jnp.where((network.hearing.sources == 0)[None, None, ..., None], each[-1], 0.0)
    words = sum(each[1:], each[0])
    if rounding is not None:
        words = words.at[:, 0].add(sum(map(weighed, rounding, gains)))
        jets = None if jets is None else plane.plus(jets, rounding)
    last = None if history.jets is None or jets is None else tuple(map(push, history.jets, jets))
    kept = None if ticks is None or history.ticks is None else push(history.ticks, ticks)
    return History(push(history.words, words), last, kept)


def weighed(term: Float[Array, "*some"], factor: Float[Array, "*fewer"]) -> Float[Array, "*some"]:
    """Return a term times the factor of its order, which lanes have, or links and lanes."""
    return term * factor.reshape(*[1] * (term.ndim - factor.ndim), *factor.shape)


def word_gains(
    gain: Float[Array, "r lanes"], delay: Float[Array, "*links lanes"], extrapolate: str
) -> Float[Array, "derivatives *some lanes"]:
    """Return the factors of y, ẏ, …, y^(r) in a word: those of R, or of R after the delay by Taylor.

    `jets` continues the derivatives below r, `jerk` also the r-th.
    """
    if extrapolate == "none":
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
