"""The effect of an attack on announced trimming, by theorem 3 (docs/guarantees.md)."""

from typing import NamedTuple

import numpy as np

from jaxnet.theory import response
from jaxnet.theory.case import Case
from jaxnet.theory.response import LawGain
from jaxnet.theory.safe import safe_vehicles
from jaxnet.theory.spread import AttackGain, Gains, scenario_gain


def between_ticks(
    reach: AttackGain, gain: LawGain, fastest: float, tick: float, one_frequency: bool
) -> Gains:
    """`‖H‖₁ γ_i Λ h` of theorem 3 (docs/guarantees.md), per ā, for each vehicle.

    Λ is the greatest rate of R(a) within a tick. `fastest` is the highest angular frequency Ω of
    the signal [rad/s] and `tick` is h [s]. With k3 = 1, `Λ ≤ Σ_k k_k ‖a^(k+1)‖` over the falsified
    orders k. Bernstein's inequality gives ‖a^(k+1)‖ ≤ Ωā. If order k + 1 is falsified too,
    ‖a^(k+1)‖ ≤ ā, unless each order has its magnitude. A signal of one frequency also has `Λ ≤ Ω η
    ā`.
    """
    rates = np.full(len(reach.orders), fastest)
    if reach.shares is None:
        derived = [order + 1 in reach.orders for order in reach.orders]
        rates[derived] = min(fastest, 1.0)
    most = float(reach.factors(gain) @ rates)
    if one_frequency:
        most = min(most, fastest * response.harmonic_norm(gain))
    return response.impulse_norm(gain) * reach.gains * most * tick


class Ultimate(NamedTuple):
    """Ultimate error of the vehicles that are safe by majority: slope ā + rounding [m]."""

    slope: float  # not-a-number if Λ is not known
    rounding: float


def ultimate(case: Case) -> Ultimate | None:
    """Ultimate error that theorem 3 and corollary 1 allow; None if nobody is safe by majority."""
    scenario, attack = case.scenario, case.scenario.attack
    if not scenario.defence.announcing() or not attack.present or case.draws is None:
        return None
    found = safe_vehicles(case)
    majority = found.by_majority()
    if not majority.any():
        return None
    reach, fastest = scenario_gain(scenario), attack.fastest()
    if reach is None or not np.isfinite(fastest):
        return Ultimate(np.nan, np.nan)
    slopes = between_ticks(reach, case.gain, fastest, scenario.tick, attack.harmonic())
    left = max(each.left for each in found.reasons)  # 2M + δ on links (corollary 1)
    most = float(reach.gains[majority].max())
    rounding = response.impulse_norm(case.gain) * most * left if left else 0.0
    return Ultimate(float(slopes[majority].max()), rounding)
