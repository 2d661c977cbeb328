"""Late words: how far behind a fleet ends, and the delay up to which it is stable (theorems.md O16)."""

import math
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from jaxnet.model import graph
from jaxnet.model.graph import Weights
from jaxnet.theory.response import LawGain

MOST_DELAY = 1e3  # [s] up to which a margin is sought


def lags(weights: Weights, delay: float) -> Float[np.ndarray, " m"]:
    """Return the time [s] by which each vehicle ends behind a navigator on a line, `τ L⁻¹ 1`.

    Words are late by `delay` [s] and are taken as they are.
    """
    return delay * np.linalg.solve(graph.laplacian(weights), np.ones(len(weights)))


def word_factors(
    gain: LawGain, delay: float, extrapolate: str, local: bool
) -> Float[np.ndarray, " factors"]:
    """Return the factors of y, ẏ, …, y^(r) in a word that is late by `delay` [s].

    They are those of R, or of R after the delay by Taylor. Under a `local` law vehicles do not tell y^(r).
    """
    order = len(gain)
    powers = [
        delay**n / math.factorial(n) * (extrapolate != "none" or n == 0) for n in range(order + 1)
    ]
    factors = [sum(gain[n - j] * powers[j] for j in range(n + 1)) for n in range(order)]
    jerk = sum(gain[k] * powers[order - k] for k in range(order)) if extrapolate == "jerk" else 0.0
    return np.array([*factors, 0.0 if local else 1.0 + jerk])


def jerk_margin(weights: Weights, gain: LawGain) -> float:
    """Return the delay [s] above which a fleet is unstable that extrapolates the highest derivative too.

    There `ρ(A) (1 + k_{r-1} τ + … + k0 τ^r / r!)` is 1, the gain of fast motions from word to word. The
    margin is infinite on a graph without a cycle.
    """
    radius, order = np.abs(np.linalg.eigvals(weights[:, 1:])).max(), len(gain)

    def excess(delay: float) -> float:
        factor = 1 + sum(
            gain[k] * delay ** (order - k) / math.factorial(order - k) for k in range(order)
        )
        return radius * factor - 1

    if excess(MOST_DELAY) <= 0:
        return math.inf
    margin: Any = brentq(excess, 0.0, MOST_DELAY, xtol=1e-12)
    return float(margin)
