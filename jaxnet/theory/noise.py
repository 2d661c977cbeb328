"""Steady covariance of the tracking error under noise, for fixed weights (theorems.md O13).

Noise drives vehicle i by a number d_i on each axis that is held for a tick h. With x = (E, Ė, …) of order r,

    x ← F x + Γ d_i,      F = expm(A_c h),      Γ = ∫₀^h expm(A_c u) B du.

The variance of d_i is `g_i s²`, with s² = Σ_k k_k² σ_k² and σ_k the standard deviation of the noise of order
k. The factor g_i is 1 for what a vehicle senses of itself; `link_gains` and `transmitter_gains` give it for
noise of the channel.
"""

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm, solve_discrete_lyapunov

from jaxnet.model.graph import Weights
from jaxnet.theory import exact
from jaxnet.theory.response import LawGain

PerVehicle = Float[np.ndarray, " m"]


def steady_covariance(gain: LawGain, tick: float, correlation: float = 0.0) -> Float[np.ndarray, "r r"]:
    """Return the steady covariance of (E, Ė, …) at ticks, per unit variance of the drive d.

    White noise has the correlation time 0; otherwise `d ← φ d + √(1 - φ²) w` at each tick, with w white and
    φ = exp(-tick / correlation).

    Parameters
    ----------
    gain
        k_0, …, k_{r-1} of a stable law.
    tick, correlation
        Times [s].
    """
    order = len(gain)
    rates = np.zeros((order + 1, order + 1))
    rates[:order, :order], rates[order - 1, order] = exact.companion(gain), 1.0
    step = expm(rates * tick)  # of (x, d), with d held
    kept = np.exp(-tick / correlation) if correlation > 0 else 0.0
    step[order, order] = kept
    drawn = np.zeros_like(step)
    drawn[order, order] = 1 - kept**2
    return solve_discrete_lyapunov(step, drawn)[:order, :order]


def link_gains(weights: Weights) -> PerVehicle:
    """Return g_i where each link of a graph `[a0 | A]` has noise of its own: `Σ_l (L⁻¹)²_il Σ_j w²_lj`."""
    inverse = np.linalg.inv(np.eye(len(weights)) - weights[:, 1:])
    return inverse**2 @ (weights**2).sum(axis=1)


def transmitter_gains(weights: Weights) -> PerVehicle:
    """Return g_i where all listeners of a vehicle receive the same noise: `Σ_j (L⁻¹A)²_ij`.

    The navigator's words have no noise.
    """
    inverse = np.linalg.inv(np.eye(len(weights)) - weights[:, 1:])
    return ((inverse @ weights[:, 1:]) ** 2).sum(axis=1)
