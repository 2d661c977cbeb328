"""Late words: what each link carried d ticks ago, as a polynomial of time (theorems.md O16).

A word is X_j = R(y_j) plus R of the attack. A late word is known before the tick in which a vehicle follows
it, and so is the drive `z_i = Σ_j w_ij X_j` of the vehicle, which is the vehicle's own next word. So no
system of equations is left to solve.

Over a tick, a word is the polynomial through its values at `POINTS` of the tick. Words that are polynomials
stay the same to rounding; navigator and attack are interpolated. A listener may extrapolate a word: vehicles
then tell their motion, a power series over a tick.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxnet.engine.plan import Plan
from jaxnet.kinds.shapes import LaneTimes
from jaxnet.model import control, plane, signal
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Vectors

# Coefficients of a polynomial. A harmonic of ω [rad/s] errs by under (ωh/4)⁸ / 20,160 of its size.
DEGREES = 8
POINTS = (1 - np.cos(np.pi * (np.arange(DEGREES) + 0.5) / DEGREES)) / 2  # Chebyshev's, on a tick of length 1
TO_COEFFICIENTS = np.linalg.inv(
    POINTS[:, None] ** np.arange(DEGREES) / [math.factorial(k) for k in range(DEGREES)]
)

Polynomials = Float[Array, "2 degrees m lanes"]  # coefficients of s^k / k!
CarriedJets = tuple[Float[Array, "2 slots m lanes"], ...]


class History(NamedTuple):
    """What each link carried in the last d ticks, the oldest tick first. A word leaves after d ticks."""

    words: Float[Array, "d 2 degrees slots m lanes"]  # coefficients of s^k / k!, s the time since the tick
    jets: tuple[Float[Array, "d 2 slots m lanes"], ...] | None  # of y at the ticks; None where nobody judges


def first_history(lane: Lane, late: int, judged: bool) -> History:
    """Return the history before the first tick, for a delay of `late` ticks."""
    nothing = jnp.zeros((late, 2, *lane.weights.shape))
    words = jnp.zeros((late, 2, DEGREES, *lane.weights.shape))
    return History(words, (nothing,) * len(lane.gain) if judged else None)


def has_come(lane: Lane, time: LaneTimes) -> Bool[Array, " lanes"]:
    """Return whether the first words have arrived at a tick."""
    assert lane.delay is not None
    return time > lane.delay - lane.interval / 2


def arriving(history: History, navigator: Float[Array, "derivatives 2 lanes"]) -> CarriedJets:
    """Return the late jets that arrive at a tick, relative to the navigator's jets now."""
    assert history.jets is not None
    return tuple(jet[0] - now[:, None, None] for jet, now in zip(history.jets, navigator, strict=False))


def remember(
    history: History,
    lane: Lane,
    network: Network,
    plan: Plan,
    vectors: Vectors,
    drive: Polynomials,
    own: Jets,
    noise: Jets | None,
    jets: CarriedJets | None,
    time: LaneTimes,
) -> History:
    """Return the history after a tick.

    Vehicles follow `drive` from now on, and `own` are their jets now, sensed with the errors `noise`. Links
    carry the jets `jets` now.
    """
    assert lane.delay is not None
    gains = word_gains(lane.gain, lane.delay, plan.extrapolate)
    instants = time[None] + jnp.asarray(POINTS)[:, None] * lane.interval[None]
    told = jax.vmap(
        lambda now: tuple(control.feedback(gains, each) for each in (lane.path(now), lane.basis(now)))
    )
    path, functions = (coefficients(each, lane.interval) for each in told(instants))
    if plan.extrapolate != "none":
        drive = control.feedback(gains, motion_of(lane.gain, drive, own, noise))

    def carried(
        path: Float[Array, "2 lanes"], functions: Float[Array, "B lanes"], drive: plane.Plane
    ) -> Float[Array, "2 slots m lanes"]:
        sources = jnp.concatenate([path[:, None], drive], axis=1)
        return network.hearing.received(sources, signal.combined(vectors, functions))

    words = jax.vmap(carried, (0, 0, 1), 1)(path, functions, drive)
    last = None if history.jets is None or jets is None else tuple(map(push, history.jets, jets))
    return History(push(history.words, words), last)


def word_gains(
    gain: Float[Array, "r lanes"], delay: LaneTimes, extrapolate: str
) -> Float[Array, "derivatives lanes"]:
    """Return the factors of y, ẏ, …, y^(r) in a word: those of R, or of R after the delay by Taylor.

    `jets` continues the derivatives below r, `jerk` also the r-th.
    """
    order, powers = len(gain), [jnp.ones_like(delay)]
    if extrapolate == "none":
        return jnp.concatenate([gain, powers[0][None]])
    for n in range(1, order + 1):
        powers.append(powers[-1] * delay / n)
    factors = [sum(gain[n - j] * powers[j] for j in range(n + 1)) for n in range(order)]
    jerk = sum(gain[k] * powers[order - k] for k in range(order))
    return jnp.stack([*factors, powers[0] + jerk if extrapolate == "jerk" else powers[0]])


def motion_of(
    gain: Float[Array, "r lanes"], drive: Polynomials, own: Jets, noise: Jets | None
) -> tuple[Polynomials, ...]:
    """Return y, ẏ, …, y^(r) that vehicles tell from now on, by the power series of `y^(r) = z - P(y + n)`."""
    series, order = [*own], len(gain)
    for n in range(DEGREES):
        sensed = series[n : n + order]
        if n == 0 and noise is not None:
            sensed = plane.plus(sensed, noise)
        series.append(drive[:, n] - control.feedback(gain, sensed))
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


def push(queue: Float[Array, "d *some"], last: Float[Array, "*some"]) -> Float[Array, "d *some"]:
    """Return a queue without its first entry, and with a last one."""
    return jnp.concatenate([queue[1:], last[None]])
