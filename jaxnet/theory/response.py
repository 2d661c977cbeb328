"""What one axis of a vehicle makes of a bounded disturbance: ‖h‖₁, exactly, and the star norm above it.

The axis is `ẋ = A_c x + B ρ` with B = [0, 0, 1]', its output the position error; h is its impulse response,
of the transfer function `1 / (s³ + k2 s² + k1 s + k0)`.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import minimize_scalar

from jaxnet.theory import exact

Gain = Float[np.ndarray, "3"]
Points = Float[np.ndarray, " points"]

ENTRY = np.array([0.0, 0.0, 1.0])  # B
POSITION = np.array([[1.0, 0.0, 0.0]])
DECAYED = 80.0  # half of it is enough: e^-40 is under rounding
HALVINGS = 60  # of an interval of length π


def impulse_norm(gain: Gain) -> float:
    """`‖h‖₁ = ∫|h| dt` [s³] of a stable gain: the greatest that ρ of size 1 can make of the output.

    For poles -p and -σ ± jω it is `h = (e^{-pt} - R e^{-σt} cos u) / D` with δ = p - σ, D = δ² + ω²,
    R = √D / ω and u = ωt + atan2(δ, ω). As ∫h = 1/k0, it is enough to add twice what lies below zero, where
    R cos u exceeds e^{-δt}. Where the cosine is positive this excess is concave, so that h is below zero in
    one interval of a period or in none; there it is integrated in closed form. Once e^{-δt} is gone the
    intervals are a geometric series. With real poles h is positive throughout.
    """
    k0, k1, k2 = gain
    poles = np.roots([1.0, k2, k1, k0])
    if np.isreal(poles).all():
        return float(1 / k0)
    p = -float(poles[poles.imag == 0][0].real)
    sigma, omega = -float(poles.real[poles.imag > 0][0]), float(poles.imag.max())
    delta = p - sigma
    D, psi = delta**2 + omega**2, np.arctan2(delta, omega)
    R = np.sqrt(D) / omega
    periods = np.arange(1.0, np.floor(DECAYED * omega / (2 * np.pi * max(delta, sigma))) + 1)

    def area(v: Points, n: Points) -> Points:
        """Antiderivative of -h."""
        t = (2 * np.pi * n + v - psi) / omega
        swing = np.exp(-sigma * t) * (omega * np.sin(v) - sigma * np.cos(v)) / (sigma**2 + omega**2)
        return (R * swing + np.exp(-p * t) / p) / D

    n, start, end = below_zero(periods, delta, omega, R, psi)
    below = (area(end, n) - area(start, n)).sum()
    if delta > 0:
        ends = (2 * np.pi * (len(periods) + 1) + np.array([-np.pi, np.pi]) / 2 - psi) / omega
        first = R / D * omega / (sigma**2 + omega**2) * np.exp(-sigma * ends).sum()
        below += first / -np.expm1(-2 * np.pi * sigma / omega)
    return float(1 / k0 + 2 * below)


def below_zero(
    n: Points, delta: float, omega: float, R: float, psi: float
) -> tuple[Float[np.ndarray, " some"], Float[np.ndarray, " some"], Float[np.ndarray, " some"]]:
    """Periods in which `R cos u > e^{-δt}` somewhere, and where that begins and ends, as u - 2πn."""

    def decay(v: Points) -> Points:
        return np.exp(-delta * (2 * np.pi * n + v - psi) / omega)

    def excess(v: Points) -> Points:
        return R * np.cos(v) - decay(v)

    low, high = np.full(n.shape, -np.pi / 2), np.full(n.shape, np.pi / 2)
    top = last_positive(lambda v: delta / omega * decay(v) - R * np.sin(v), low, high)
    start = last_positive(lambda v: -excess(v), low, top)
    end = last_positive(excess, top, high)
    some = excess(top) > 0
    return n[some], start[some], end[some]


def last_positive(function: Callable[[Points], Points], low: Points, high: Points) -> Points:
    """Where a function, point by point, falls through zero, by bisection; an end where it does not."""
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        positive = function(middle) > 0
        low, high = np.where(positive, middle, low), np.where(positive, high, middle)
    return (low + high) / 2


def harmonic_norm(gain: Gain) -> float:
    """The greatest ‖R(a)‖ of an attack of one frequency, whichever, that is within 1 with its derivatives.

    Of amplitude 1 / max(1, ω³) it is `|R(iω)| / max(1, ω³)`. `|R(iω)|²` is a cubic of ω², and over ω⁶ the
    reversed cubic of 1/ω², so that both are looked for between 0 and 1.
    """
    k0, k1, k2 = gain
    cubic = np.array([1.0, k2**2 - 2 * k1, k1**2 - 2 * k0 * k2, k0**2])
    return float(np.sqrt(max(peak(cubic), peak(cubic[::-1]))))


def peak(polynomial: Float[np.ndarray, " coefficients"]) -> float:
    """Its greatest value from 0 to 1."""
    turns = np.roots(np.polyder(polynomial)).real
    return float(np.polyval(polynomial, np.clip([0.0, 1.0, *turns], 0, 1)).max())


def star_norm(gain: Gain, output: Float[np.ndarray, "rows 3"] = POSITION) -> float:
    """Least peak-to-peak gain that an invariant ellipsoid proves, `inf over α of √‖C Q_α C'‖₂`.

    `A Q + Q A' + α Q + B B'/α = 0` with 0 < α < -2 max Re λ(A). Every such α gives a bound, so it holds
    however well the least one is found. Source: Abedor, Nagpal and Poolla, A linear matrix inequality
    approach to peak-to-peak gain minimization, 1996.
    """
    matrix, entry = exact.companion(gain), np.outer(ENTRY, ENTRY)
    most = -2 * np.linalg.eigvals(matrix).real.max()

    def size(alpha: float) -> float:
        ellipsoid = solve_continuous_lyapunov(matrix + alpha / 2 * np.eye(3), -entry / alpha)
        return float(np.linalg.norm(output @ ellipsoid @ output.T, 2))

    shares = minimize_scalar(lambda share: size(share * most), bounds=(1e-6, 1 - 1e-6), method="bounded")
    return float(np.sqrt(shares.fun))
