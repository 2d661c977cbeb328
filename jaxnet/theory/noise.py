"""Steady covariance of E under noise that is drawn at ticks and held (theorems.md O13, O15)."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm, solve_discrete_lyapunov

from jaxnet.kinds.ticks import ErrorsAtTicks
from jaxnet.model import graph
from jaxnet.model.axis import companion
from jaxnet.model.graph import Weights
from jaxnet.theory.theorem import Case, Theorem


def held_variance(gain: Sequence[float], interval: float, correlation: float = 0.0) -> float:
    """Var E of a drive with variance 1 that is drawn at ticks, `interval` [s] apart, and held.

    The state is E with its derivatives and the drive: `Σ = F Σ F' + Q`. The correlation of drives
    falls to 1/e in the time `correlation` [s], 0 for independent drives.

    Examples
    --------
    >>> round(held_variance([1.0, 3.0, 3.0], 0.05), 8)
    0.00937435
    >>> round(held_variance([1.0, 3.0, 3.0], 0.05, correlation=1.0), 6)
    0.312565
    """
    order = len(gain)
    kept = np.exp(-interval / correlation) if correlation else 0.0
    motion = np.zeros((order + 1, order + 1))
    motion[:order, :order] = companion(np.asarray(gain, float)[None])[0]
    motion[order - 1, order] = 1.0
    flow = expm(motion * interval)
    flow[order, order] = kept
    drawn = np.zeros_like(flow)
    drawn[order, order] = 1.0 - kept**2
    return float(solve_discrete_lyapunov(flow, drawn)[0, 0])


def link_gains(weights: Weights, of: str) -> Float[np.ndarray, " m"]:
    """Var E of each vehicle over that of one drive, for independent errors of words.

    `weights` are `[a0 | A]` in force, (m, m + 1). Of a "link": `Σ_l (L⁻¹)²_il Σ_j w²_lj`; of a
    "transmitter": `Σ_j (L⁻¹ A)²_ij`, the navigator's message exact.
    """
    inverse = np.linalg.inv(graph.laplacian(weights))
    if of == "transmitter":
        return ((inverse @ weights[:, 1:]) ** 2).sum(axis=1)
    return inverse**2 @ (weights**2).sum(axis=1)


def steady_rms(
    case: Case, errors: ErrorsAtTicks, gains: Callable[[], Float[np.ndarray, " m"]]
) -> Float[np.ndarray, " m"] | None:
    """Root mean square of E [m] that errors leave at last; `gains()` as `link_gains`."""
    scenario = case.scenario
    strength = None if errors.exact() else errors.strength(scenario.gain)
    if strength is None:
        return None
    variance, correlation = strength
    return np.sqrt(variance * held_variance(scenario.gain, scenario.tick, correlation) * gains())


def of_sensors(case: Case) -> Float[np.ndarray, " m"] | None:
    return steady_rms(case, case.scenario.sensing, lambda: np.ones(1))


def of_messages(case: Case) -> Float[np.ndarray, " m"] | None:
    errors = case.scenario.channel.noise
    return steady_rms(case, errors, lambda: link_gains(case.weights, errors.of))


OF_ERRORS = ("solved", "flat", "one gain", "one network", "alike", "every message", "on time")
OF_ERRORS += ("unrounded messages", "ticks")
STEADY_ERRORS = (
    Theorem("O13", "sensors leave", "m", OF_ERRORS, of_sensors),
    Theorem("O15", "messages leave", "m", (*OF_ERRORS, "no decisions", "small"), of_messages),
)
