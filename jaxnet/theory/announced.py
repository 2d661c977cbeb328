"""The effect of an attack on announced trimming, by theorem 3 (docs/guarantees.md)."""

from typing import NamedTuple

import numpy as np

from jaxnet.config.scenario import MOTION
from jaxnet.theory import response
from jaxnet.theory.response import LawGain
from jaxnet.theory.safe import safe_vehicles
from jaxnet.theory.spread import AttackGain, Gains, scenario_gain
from jaxnet.theory.theorem import Case, Theorem


def between_ticks(
    reach: AttackGain, gain: LawGain, fastest: float, tick: float, one_frequency: bool
) -> Gains:
    """`‖h‖₁ γ_i Λ h` of theorem 3 (docs/guarantees.md), per ā, for each vehicle.

    Λ is the greatest rate of R(a) within a tick. `fastest` is the highest angular frequency Ω of
    the signal [rad/s] and `tick` is h [s]. With k3 = 1, `Λ ≤ Σ_k k_k ‖a^(k+1)‖` over the falsified
    orders k. Bernstein's inequality gives ‖a^(k+1)‖ ≤ Ωā. If order k + 1 is falsified too,
    ‖a^(k+1)‖ ≤ ā, unless each order has its magnitude. A signal of one frequency also has `Λ ≤ Ω η
    ā`.
    """
    rates = [1.0 if order + 1 in reach.orders else np.inf for order in reach.orders]
    if reach.shares is not None:
        rates = np.inf
    most = float(
        reach.factors(gain) @ np.broadcast_to(np.minimum(rates, fastest), len(reach.orders))
    )
    if one_frequency:
        most = min(most, fastest * response.harmonic_norm(gain))
    return response.impulse_norm(gain) * reach.gains * most * tick


class Ultimate(NamedTuple):
    """Ultimate error of the vehicles that are safe by majority: slope ā + rounding [m]."""

    slope: float  # not-a-number if Λ is not known
    rounding: float


def ultimate(case: Case) -> Ultimate | None:
    """Ultimate error that theorem 3 and corollary 1 allow; None if nobody is safe by majority."""
    scenario = case.scenario
    if not scenario.defence.announcing() or not scenario.attack.present or case.draws is None:
        return None
    found = safe_vehicles(case)
    majority, left = found.by_majority(), found.left()
    if not majority.any():
        return None
    reach, fastest = scenario_gain(scenario), scenario.attack.fastest()
    if reach is None or not np.isfinite(fastest):
        return Ultimate(np.nan, np.nan)
    one_frequency = scenario.attack.harmonic()
    slopes = between_ticks(reach, case.gain, fastest, scenario.tick, one_frequency)
    most = float(reach.gains[majority].max())
    rounding = response.impulse_norm(case.gain) * most * left if left else 0.0
    return Ultimate(float(slopes[majority].max()), rounding)


THEOREM_3 = Theorem("theorem 3", "ultimate error", "m", ("leader", *MOTION, "consistent"), ultimate)
