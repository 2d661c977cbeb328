"""Stability of the law by exchanges with neighbours, the jerk held between ticks (SCIENCE O12).

With T = A^r for r rounds, a tick of length h and E = y - y_0,

    q ← T q + (1 - T) L⁻¹b,      (E, Ė, Ë) ← Φ (E, Ė, Ë) + Γ q,      Γ = [h³/6, h²/2, h]',

and L⁻¹b = -P(E) but for navigator and attacks, which are inputs. T has the eigenvectors of A, so along each
of them the loop is a matrix of four by four, of μ = λ^r alone.
"""

from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from jaxnet.model.graph import Weights
from jaxnet.theory.response import Gain

LEAST_TICK, MOST_TICK = 1e-6, 10.0  # [s]
RATIO = 1.05  # from a tick to the next that is looked at
HALVINGS = 40
ANGLES = np.exp(1j * np.pi * np.linspace(0, 1, 65))  # of a circle's upper half


def eigenvalues(weights: Weights) -> Complex[np.ndarray, " some"]:
    """Those of A for a graph `[a0 | A]`, each once, of a conjugate pair the upper one."""
    found = np.linalg.eigvals(weights[:, 1:]).round(12)
    return np.unique(np.real(found) + 1j * np.abs(np.imag(found)))


def growth(left: Any, gain: Gain, tick: float) -> float:
    """By what the slowest motion is multiplied at each tick, the greatest over these μ: stable below 1.

    From the eigenvalues s of `(M - 1)/h`, M that matrix, as `|1 + h s|`, which loses nothing for short ticks.
    """
    mu, h = np.atleast_1d(np.asarray(left, complex)), tick
    asked = -(1 - mu)[:, None] * gain
    entry = np.array([h * h / 6, h / 2, 1.0])
    rates = np.zeros((len(mu), 4, 4), complex)
    rates[:, :3, :3] = np.array([[0, 1, h / 2], [0, 0, 1], [0, 0, 0]]) + entry[:, None] * asked[:, None]
    rates[:, :3, 3] = entry * mu[:, None]
    rates[:, 3, :3], rates[:, 3, 3] = asked / h, (mu - 1) / h
    return float(np.abs(1 + h * np.linalg.eigvals(rates)).max())


def spectral_radius(weights: Weights, gain: Gain, tick: float, rounds: int) -> float:
    """The same of a graph, with so many rounds at each tick."""
    return growth(eigenvalues(weights) ** rounds, gain, tick)


def least_rounds(weights: Weights, gain: Gain, tick: float) -> tuple[int, int] | None:
    """The least number of rounds that is stable, and one from which on every number is.

    None where a law solved exactly at ticks is not stable, or somebody is cut off. The growth is subharmonic
    in μ, for M is affine in it: so a disc is stable just if its edge is, and all numbers of rounds are that
    bring every μ inside.
    """
    found, low, high = eigenvalues(weights), 0.0, 1.0  # of the edge of the greatest such disc
    most, slow = np.abs(found).max(), found[np.real(found).argmax()]
    if growth(0.0, gain, tick) >= 1 or most >= 1:
        return None
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if growth(middle * ANGLES, gain, tick) < 1 else (low, middle)
    surely = 1 if most <= low else int(np.ceil(np.log(low) / np.log(most)))
    for few in range(1, surely):
        if growth(slow**few, gain, tick) < 1 and growth(found**few, gain, tick) < 1:
            return few, surely
    return surely, surely


def greatest_tick(weights: Weights, gain: Gain, rounds: int) -> float:
    """The tick [s] up to which all are stable with so many rounds; infinite if those up to MOST_TICK are."""
    left = eigenvalues(weights) ** rounds
    low = LEAST_TICK
    while growth(left, gain, low * RATIO) < 1:
        low *= RATIO
        if low > MOST_TICK:
            return np.inf
    high = low * RATIO
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if growth(left, gain, middle) < 1 else (low, middle)
    return low


def lateness(weights: Weights, tick: float, number: int) -> Float[np.ndarray, " m"]:
    """By how much [s] what vehicles hold is late for the navigator's jerk, `h (1/2 + (1 - T)⁻¹T 1)`.

    Behind a slow navigator E comes to that times `-d⁴y_0/dt⁴ / k0`.
    """
    left, one = np.linalg.matrix_power(weights[:, 1:], number), np.ones(len(weights))
    return tick * (0.5 + np.linalg.solve(np.eye(len(weights)) - left, left @ one))


def least_rate(eigenvalue: float, gain: Gain) -> float:
    """Exchanges a second [1/s] above which a real eigenvalue λ of A, 0 < λ < 1, is stable for short ticks.

    There `q̇ = -c (q + P(E))` with c = (1 - λ^r)/h, near r (1 - λ)/h; by Routh's criterion it must be over
    `k1² / (k1 k2 - k0)`.
    """
    k0, k1, k2 = gain
    return float(k1**2 / (k1 * k2 - k0) / (1 - eigenvalue))
