"""Steady covariance of E under noise that is drawn at ticks and held (theorems.md O13, O15)."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm, solve_discrete_lyapunov

from jaxnet.kinds.ticks import ErrorsAtTicks
from jaxnet.model import graph
from jaxnet.model.axis import companion
from jaxnet.model.graph import Weights
from jaxnet.theory.case import Case


def held_variance(gain: Sequence[float], interval: float, correlation: float = 0.0) -> float:
    """Var E of a drive with variance 1 that is drawn at ticks, `interval` [s] apart, and held.

    The state is E with its derivatives and the drive: `Σ = F Σ F' + Q`. The correlation of drives
    falls to 1/e in the time `correlation` [s], 0 for independent drives.
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
    """Var E of each vehicle over that of one drive, for independent errors of messages.

    `weights` are `[a0 | A]` in force, (m, m + 1). Of a "link": `Σ_l (L⁻¹)²_il Σ_j w²_lj`; of a
    "transmitter": `Σ_j (L⁻¹ A)²_ij`, the navigator's message exact.
    """
    inverse = np.linalg.inv(graph.laplacian(weights))
    if of == "transmitter":
        return ((inverse @ weights[:, 1:]) ** 2).sum(axis=1)
    return inverse**2 @ (weights**2).sum(axis=1)


def held_rms(case: Case, errors: ErrorsAtTicks) -> float | None:
    """Root mean square of E [m] that errors of one drive leave at last."""
    scenario = case.scenario
    strength = None if errors.exact() else errors.strength(scenario.gain)
    if strength is None:
        return None
    variance, correlation = strength
    return float(np.sqrt(variance * held_variance(scenario.gain, scenario.tick, correlation)))


def of_sensors(case: Case) -> Float[np.ndarray, " m"] | None:
    """Root mean square of E [m], the same of each vehicle."""
    rms = held_rms(case, case.scenario.sensing)
    return None if rms is None else np.array([rms])


def of_messages(case: Case) -> Float[np.ndarray, " m"] | None:
    """Root mean square of E [m] of each vehicle."""
    errors = case.scenario.channel.noise
    rms = held_rms(case, errors)
    return None if rms is None else rms * np.sqrt(link_gains(case.weights, errors.of))
