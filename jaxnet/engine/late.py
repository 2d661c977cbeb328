"""Late words: what each link carried d ticks ago, as a polynomial of time (theorems.md O16).

A word is X_j = R(y_j) plus R of the attack. A late word is known before the tick in which a vehicle follows
it, and so is the drive `z_i = Σ_j w_ij X_j` of the vehicle, which is the vehicle's own next word. So no
system of equations is left to solve.

Over a tick, a word is the polynomial through its values at `POINTS` of the tick. Words that are polynomials
stay the same to rounding; navigator and attack are interpolated.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxnet.model import control, plane, signal
from jaxnet.model.lane import Lane, Network
from jaxnet.model.signal import Vectors

DEGREES = (
    8  # coefficients of a polynomial; a harmonic of ω [rad/s] errs by under (ωh/4)⁸ / 20,160 of its size
)
POINTS = (1 - np.cos(np.pi * (np.arange(DEGREES) + 0.5) / DEGREES)) / 2  # Chebyshev's, on a tick of length 1
TO_COEFFICIENTS = np.linalg.inv(
    POINTS[:, None] ** np.arange(DEGREES) / [math.factorial(k) for k in range(DEGREES)]
)

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


def has_come(lane: Lane, time: Float[Array, " lanes"]) -> Bool[Array, " lanes"]:
    """Return whether the first words have arrived at a tick."""
    return time > lane.delay - lane.interval / 2


def heard(history: History, navigator: Float[Array, "derivatives 2 lanes"]) -> CarriedJets | None:
    """Return the late jets that arrive at a tick, relative to the navigator's jets now."""
    if history.jets is None:
        return None
    return tuple(jet[0] - now[:, None, None] for jet, now in zip(history.jets, navigator, strict=False))


def remember(
    history: History,
    lane: Lane,
    network: Network,
    vectors: Vectors,
    drive: Float[Array, "2 degrees m lanes"],
    jets: CarriedJets | None,
    time: Float[Array, " lanes"],
) -> History:
    """Return the history after a tick: `drive` is what vehicles follow from now on, `jets` what they tell."""
    degrees = drive.shape[1]
    drive = jnp.concatenate([drive, jnp.zeros((2, DEGREES - degrees, *drive.shape[2:]))], axis=1)
    instants = time[None] + jnp.asarray(POINTS)[:, None] * lane.interval[None]
    told = jax.vmap(
        lambda now: (control.driven(lane.gain, lane.path(now)), control.driven(lane.gain, lane.basis(now)))
    )(instants)
    path, functions = (coefficients(each, lane.interval) for each in told)

    def carried(path: Float[Array, "2 lanes"], functions: Float[Array, "B lanes"], drive: plane.Plane):
        sources = jnp.concatenate([path[:, None], drive], axis=1)
        return network.hearing.received(sources, signal.combined(vectors, functions))

    words = jax.vmap(carried, (0, 0, 1), 1)(path, functions, drive)
    last = None if history.jets is None or jets is None else tuple(map(push, history.jets, jets))
    return History(push(history.words, words), last)


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
