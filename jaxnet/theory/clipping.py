"""What is known of vehicles whose inputs are clipped at limits.

Without attack `x = (E, Ė, …)` of a vehicle on an axis obeys ẋ = A_c x while no input saturates
(theorems.md O1), and the law asks for the input `y_0^(r) - K x`. With `A_c'P + P A_c = -1`, x'Px
falls, and `|K x|² ≤ (K P⁻¹ K') x'Px`. So no input is ever clipped if on both axes, at the start of
every vehicle, `x'Px ≤ (q - max ‖y_0^(r)‖)² / (K P⁻¹ K')`, with the limit q.
"""

from typing import NamedTuple

import numpy as np

from jaxnet.kinds.fields import value_range
from jaxnet.kinds.navigators import sizes_up_to
from jaxnet.model.axis import companion
from jaxnet.theory.case import Case
from jaxnet.theory.response import LawGain
from jaxnet.theory.solution import lyapunov_matrix
from jaxnet.theory.start import start_sizes

CERTIFIED = 1e-6  # of A_c'P + P A_c = -1, and of the least eigenvalue of P over the greatest


class Unclipped(NamedTuple):
    """The set x'Px ≤ level of an axis in which no input saturates."""

    level: float
    ratio: float  # K P⁻¹ K'
    left: float  # of the limit, beside what the navigator needs; in the unit of the limit
    every_start: bool  # whether every start that may be drawn is in it


def unclipped(case: Case) -> Unclipped | None:
    """The set, for integrators; None for other vehicles, attacks and drawn gains."""
    scenario, limits = case.scenario, case.scenario.vehicle.limits
    unknown = scenario.attack.present or scenario.draws_gain or scenario.formation.moves
    if unknown or "input" not in limits or not scenario.vehicle.flat:
        return None
    order, gain = scenario.vehicle.order, case.gain
    ratio = clipping_ratio(gain)
    needed = sizes_up_to(order, scenario.navigator, 0.0, scenario.horizon)[order]
    left = float(value_range(limits["input"])[0] - needed)
    if ratio is None or left <= 0:
        return None
    level, sizes = left**2 / ratio, start_sizes(scenario)
    most = float(sizes @ np.abs(lyapunov_matrix(gain)) @ sizes)
    return Unclipped(level, ratio, left, most <= level)


def clipping_ratio(gain: LawGain) -> float | None:
    """`K P⁻¹ K'`; None unless P is found to be positive and to solve its equation."""
    P, matrix = lyapunov_matrix(gain), companion(gain)
    residual = np.abs(matrix.T @ P + P @ matrix + np.eye(len(P))).max()
    axes = np.linalg.eigvalsh(P)
    if not (residual < CERTIFIED and axes[0] > CERTIFIED * axes[-1]):
        return None
    return float(gain @ np.linalg.solve(P, gain))


def never_global(case: Case) -> bool | None:
    """Whether far starts may stay away whatever the gains: limits, and an order of 3 or more.

    Sussmann and Yang, On the stabilizability of multiple integrators by means of bounded feedback
    controls, CDC 1991: no saturated linear feedback stabilises three integrators globally.
    """
    vehicle = case.scenario.vehicle
    return True if vehicle.limits and vehicle.order >= 3 else None
