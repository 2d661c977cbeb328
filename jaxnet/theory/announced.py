"""What announced trimming leaves of an attack, by theorem 3 (docs/guarantees.md)."""

import numpy as np

from jaxnet.theory import response
from jaxnet.theory.response import Gain
from jaxnet.theory.spread import Gains, Spread


def between_ticks(reach: Spread, gain: Gain, fastest: float, tick: float, one_frequency: bool) -> Gains:
    """`‖h‖₁ γ_i Λ h` of theorem 3 (docs/guarantees.md), Λ the greatest rate of R(a) within a tick, per ā.

    `fastest` is the highest angular frequency Ω of the signal [rad/s], `tick` h [s]. With k3 = 1,
    `Λ ≤ Σ_k k_k ‖a^(k+1)‖` over the falsified orders k. ‖a^(k+1)‖ is within Ωā (Bernstein's inequality), and
    within ā if order k + 1 is falsified too. A signal of one frequency has `Λ ≤ Ω η ā` besides.
    """
    rates = [1.0 if order + 1 in reach.orders else np.inf for order in reach.orders]
    most = float(np.append(gain, 1.0)[list(reach.orders)] @ np.minimum(rates, fastest))
    if one_frequency:
        most = min(most, fastest * response.harmonic_norm(gain))
    return response.impulse_norm(gain) * reach.gains * most * tick
