"""The effect of an attack on announced trimming, by theorem 3 (docs/guarantees.md)."""

import numpy as np

from jaxnet.theory import response
from jaxnet.theory.response import LawGain
from jaxnet.theory.spread import AttackGain, Gains


def between_ticks(
    reach: AttackGain, gain: LawGain, fastest: float, tick: float, one_frequency: bool
) -> Gains:
    """Return `‖h‖₁ γ_i Λ h` of theorem 3 (docs/guarantees.md), per ā, for each vehicle.

    Λ is the greatest rate of R(a) within a tick. `fastest` is the highest angular frequency Ω of the signal
    [rad/s] and `tick` is h [s]. With k3 = 1, `Λ ≤ Σ_k k_k ‖a^(k+1)‖` over the falsified orders k.
    Bernstein's inequality gives ‖a^(k+1)‖ ≤ Ωā. If order k + 1 is falsified too, ‖a^(k+1)‖ ≤ ā, unless each
    order has its magnitude. A signal of one frequency also has `Λ ≤ Ω η ā`.
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
