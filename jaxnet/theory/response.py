"""Response of one axis to a bounded disturbance: ‖H‖₁, exactly, and the star norm above it.

The axis is `ẋ = A_c x + B ρ` with B = [0, …, 0, 1]' and the position error as output. Its impulse
response is h, with the transfer function `1 / (s^r + … + k1 s + k0)` for a vehicle of order r.
"""

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm, solve_continuous_lyapunov

from jaxnet.model.axis import companion

LawGain = Float[np.ndarray, "r"]
OfGain = TypeVar("OfGain")
StatesInTime = Float[np.ndarray, "states times"]

DECAYED = 40.0  # exponent of a decayed mode: what is left of it is below rounding
STEP_TURN = 0.25  # [rad] by which the fastest mode turns from one time to the next
TIMES = 2**16  # most times that are computed together
BISECTIONS = 26  # between two times; ∫|h| errs by the square of what is left
MOST_GAINS = 64  # whose values are kept: cells that differ by network or attack share their gains


def kept_by_gain(function: Callable[..., OfGain]) -> Callable[..., OfGain]:
    """Keep the last values of a function of gains and numbers; callers must not write into them."""

    @functools.lru_cache(MOST_GAINS)
    def value(shape: tuple[int, ...], gain: bytes, *numbers: float) -> OfGain:
        return function(np.frombuffer(gain).reshape(shape), *numbers)

    @functools.wraps(function)
    def kept(gain: Any, *numbers: float) -> OfGain:
        gain = np.asarray(gain, float)
        return value(gain.shape, gain.tobytes(), *numbers)

    return kept


@kept_by_gain
def impulse_norm(gain: LawGain) -> float:
    """`‖H‖₁ = ∫|h| dt` [s^r], h the impulse response: the greatest output for a ρ of size 1.

    Where all poles are real, h is positive, and the norm is ∫h = 1/k0. Otherwise the state (x, ∫h)
    goes from time to time by the matrix exponential. Where h changes its sign, bisection finds the
    zero. So every integral between two zeros is exact to rounding, whatever the order and the
    poles. Steps grow when the fast modes have decayed.
    """
    poles = np.roots([1.0, *gain[::-1]])
    if np.isreal(poles).all():
        return float(1 / gain[0])
    order = len(gain)
    matrix = np.zeros((order + 1, order + 1))
    matrix[:order, :order], matrix[order, 0] = companion(gain), 1.0
    lives = DECAYED / -poles.real
    state, begin, total = np.eye(order + 1)[:, order - 1 : order], 0.0, 0.0
    for life in np.unique(lives):
        step = STEP_TURN / np.abs(poles[lives >= life]).max()
        left = int(np.ceil((life - begin) / step))
        begin += left * step
        while left > 0:
            states, flow = state, expm(matrix * step)
            while states.shape[1] <= min(left, TIMES):  # each pass doubles the times
                states, flow = np.hstack([states, flow @ states]), flow @ flow
            states = states[:, : min(left, TIMES) + 1]
            total += variation(states, matrix, step)
            left, state = left - (states.shape[1] - 1), states[:, -1:]
    return total


def variation(
    states: StatesInTime, matrix: Float[np.ndarray, "states states"], step: float
) -> float:
    """∫|h| over some steps: h is the first of the states, ḣ the second, ∫h the last.

    Within a step h turns once at most, so it crosses zero once at most before and after that.
    """
    flows = [expm(matrix * step / 2**halving) for halving in range(1, BISECTIONS + 1)]

    def as_long_as(start: StatesInTime, *signs: int) -> StatesInTime:
        """Last states within a step in which these states have not changed their sign."""
        found = start
        for flow in flows:
            later = flow @ found
            same = (later[signs, :] * start[signs, :] > 0).all(axis=0)
            found = np.where(same, later, found)
        return found

    begin, end = states[:, :-1], states[:, 1:]
    turning, turns = end.copy(), begin[1] * end[1] < 0
    turning[:, turns] = as_long_as(begin[:, turns], 1)
    total = 0.0
    for start, stop, signs in ((begin, turning, (0, 1)), (turning, end, (0,))):
        zero, crosses = start.copy(), start[0] * stop[0] < 0
        zero[:, crosses] = as_long_as(start[:, crosses], *signs)
        total += np.abs(np.diff([start[-1], zero[-1], stop[-1]], axis=0)).sum()
    return total


def harmonic_norm(gain: LawGain) -> float:
    """Greatest ‖R(a)‖ of attacks of one frequency that are within 1 with their derivatives.

    At amplitude 1 / max(1, ω^r) the norm is `|R(iω)| / max(1, ω^r)`. `|R(iω)|² = R(iω) R(-iω)` is a
    polynomial in ω² of degree r. Divided by ω^2r it is the reversed polynomial in 1/ω². So both
    maxima are searched between 0 and 1.
    """
    R = np.array([1.0, *gain[::-1]])
    signs = (-1.0) ** np.arange(len(gain), -1, -1)
    square = np.polymul(R, R * signs)[::2] * signs
    return float(np.sqrt(max(greatest_value(square), greatest_value(square[::-1]))))


def greatest_value(polynomial: Float[np.ndarray, " coefficients"]) -> float:
    """Greatest value of a polynomial on [0, 1]."""
    turns = np.roots(np.polyder(polynomial)).real
    return float(np.polyval(polynomial, np.clip([0.0, 1.0, *turns], 0, 1)).max())


def axis_star_norm(gain: LawGain) -> float:
    """Least peak-to-peak gain to the position that an invariant ellipsoid proves.

    The gain is `inf over α of √(Q_α)_00` with `A Q + Q A' + α Q + B B'/α = 0` and
    0 < α < -2 max Re λ(A). Every such α gives a bound, so the result is a bound even if the
    minimiser is inexact. Source: Abedor, Nagpal and Poolla, A linear matrix inequality approach to
    peak-to-peak gain minimization, 1996.
    """
    from scipy.optimize import minimize_scalar  # takes 0.15 s to import

    matrix, identity = companion(gain), np.eye(len(gain))
    most, entry = -2 * np.linalg.eigvals(matrix).real.max(), np.diag(identity[-1])

    def size(share: float) -> float:
        alpha = share * most
        ellipsoid = solve_continuous_lyapunov(matrix + alpha / 2 * identity, -entry / alpha)
        return float(np.abs(ellipsoid[0, 0]))

    found = minimize_scalar(size, bounds=(1e-6, 1 - 1e-6), method="bounded")
    return float(np.sqrt(found.fun))
