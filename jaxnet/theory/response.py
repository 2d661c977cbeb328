"""Response of one axis to a bounded disturbance: ‖h‖₁, exactly, and the star norm above it.

The axis is `ẋ = A_c x + B ρ` with B = [0, …, 0, 1]' and the position error as output. Its impulse response is
h, with the transfer function `1 / (s^r + … + k1 s + k0)` for a vehicle of order r = 1, 2 or 3.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import minimize_scalar

from jaxnet.theory import exact

LawGain = Float[np.ndarray, "r"]
PerPeriod = Float[np.ndarray, " periods"]  # a number for each period of the impulse response

DECAYED = 80.0  # exponent of a decayed term; e^-40 is below rounding already
BISECTIONS = 60  # of an interval of length π


def impulse_norm(gain: LawGain) -> float:
    """Return `‖h‖₁ = ∫|h| dt` [s^r] of a stable gain: the greatest output for a ρ of size 1.

    Where all poles are real, h is positive, and the norm is ∫h = 1/k0. A pair of poles -σ ± jω alone has the
    norm `coth(πσ/2ω) / k0`, because each half-wave of h is e^{-πσ/ω} of the one before it.

    With three poles -p and -σ ± jω it is `h = (e^{-pt} - R e^{-σt} cos u) / D` with δ = p - σ, D = δ² + ω²,
    R = √D / ω and u = ωt + atan2(δ, ω). Because ∫h = 1/k0, the norm is 1/k0 plus twice the area of h
    below zero. There R cos u exceeds e^{-δt}. Where the cosine is positive, this excess is concave. So h is
    below zero in one interval of a period or in none; the integral over the interval has a closed form. When
    e^{-δt} has decayed, the intervals form a geometric series.
    """
    k0, poles = gain[0], np.roots([1.0, *gain[::-1]])
    if np.isreal(poles).all():
        return float(1 / k0)
    if len(gain) == 2:
        sigma, omega = -float(poles[0].real), abs(float(poles[0].imag))
        return float(1 / (k0 * np.tanh(np.pi * sigma / (2 * omega))))
    p = -float(poles[poles.imag == 0][0].real)
    sigma, omega = -float(poles.real[poles.imag > 0][0]), float(poles.imag.max())
    delta = p - sigma
    D, psi = delta**2 + omega**2, np.arctan2(delta, omega)
    R = np.sqrt(D) / omega
    periods = np.arange(1.0, np.floor(DECAYED * omega / (2 * np.pi * max(delta, sigma))) + 1)

    def area(v: PerPeriod, n: PerPeriod) -> PerPeriod:
        """Return the antiderivative of -h."""
        t = (2 * np.pi * n + v - psi) / omega
        swing = np.exp(-sigma * t) * (omega * np.sin(v) - sigma * np.cos(v)) / (sigma**2 + omega**2)
        return (R * swing + np.exp(-p * t) / p) / D

    n, start, end = negative_intervals(periods, delta, omega, R, psi)
    below = (area(end, n) - area(start, n)).sum()
    if delta > 0:
        ends = (2 * np.pi * (len(periods) + 1) + np.array([-np.pi, np.pi]) / 2 - psi) / omega
        first = R / D * omega / (sigma**2 + omega**2) * np.exp(-sigma * ends).sum()
        below += first / -np.expm1(-2 * np.pi * sigma / omega)
    return float(1 / k0 + 2 * below)


def negative_intervals(
    n: PerPeriod, delta: float, omega: float, R: float, psi: float
) -> tuple[Float[np.ndarray, " some"], Float[np.ndarray, " some"], Float[np.ndarray, " some"]]:
    """Return the periods in which `R cos u > e^{-δt}` somewhere, with its start and end as u - 2πn."""

    def decay(v: PerPeriod) -> PerPeriod:
        return np.exp(-delta * (2 * np.pi * n + v - psi) / omega)

    def excess(v: PerPeriod) -> PerPeriod:
        return R * np.cos(v) - decay(v)

    low, high = np.full(n.shape, -np.pi / 2), np.full(n.shape, np.pi / 2)
    top = find_falling_zero(lambda v: delta / omega * decay(v) - R * np.sin(v), low, high)
    start = find_falling_zero(lambda v: -excess(v), low, top)
    end = find_falling_zero(excess, top, high)
    some = excess(top) > 0
    return n[some], start[some], end[some]


def find_falling_zero(
    function: Callable[[PerPeriod], PerPeriod], low: PerPeriod, high: PerPeriod
) -> PerPeriod:
    """Return the points where a function falls through zero, by bisection.

    Where the function does not fall through zero, the result is an end of the interval.
    """
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        positive = function(middle) > 0
        low, high = np.where(positive, middle, low), np.where(positive, high, middle)
    return (low + high) / 2


def harmonic_norm(gain: LawGain) -> float:
    """Return the greatest ‖R(a)‖ of attacks of one frequency that are within 1 with their derivatives.

    At amplitude 1 / max(1, ω^r) the norm is `|R(iω)| / max(1, ω^r)`. `|R(iω)|² = R(iω) R(-iω)` is a
    polynomial in ω² of degree r. Divided by ω^2r it is the reversed polynomial in 1/ω². So both maxima are
    searched between 0 and 1.
    """
    R = np.array([1.0, *gain[::-1]])
    signs = (-1.0) ** np.arange(len(gain), -1, -1)
    square = np.polymul(R, R * signs)[::2] * signs
    return float(np.sqrt(max(greatest_value(square), greatest_value(square[::-1]))))


def greatest_value(polynomial: Float[np.ndarray, " coefficients"]) -> float:
    """Return the greatest value of a polynomial on [0, 1]."""
    turns = np.roots(np.polyder(polynomial)).real
    return float(np.polyval(polynomial, np.clip([0.0, 1.0, *turns], 0, 1)).max())


def axis_star_norm(gain: LawGain, output: Float[np.ndarray, "rows r"] | None = None) -> float:
    """Return the least peak-to-peak gain that an invariant ellipsoid proves; the default output is the
    position.

    The gain is `inf over α of √‖C Q_α C'‖₂` with
    `A Q + Q A' + α Q + B B'/α = 0` and 0 < α < -2 max Re λ(A). Every such α gives a bound, so the result is a
    bound even if the minimiser is inexact. Source: Abedor, Nagpal and Poolla, A linear matrix inequality
    approach to peak-to-peak gain minimization, 1996.
    """
    matrix, identity = exact.companion(gain), np.eye(len(gain))
    entry, output = np.diag(identity[-1]), identity[:1] if output is None else output
    most = -2 * np.linalg.eigvals(matrix).real.max()

    def size(alpha: float) -> float:
        ellipsoid = solve_continuous_lyapunov(matrix + alpha / 2 * identity, -entry / alpha)
        return float(np.linalg.norm(output @ ellipsoid @ output.T, 2))

    shares = minimize_scalar(lambda share: size(share * most), bounds=(1e-6, 1 - 1e-6), method="bounded")
    return float(np.sqrt(shares.fun))
