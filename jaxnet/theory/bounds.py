"""Bounds on the ultimate error ‖y_i - y_0‖, per ā, under attacks of size ā (theorems.md O5).

Each bound is a constant of one axis times the attack gain of the network (`spread`). Let β = 1 + k0
+ k1 + k2. If the attacks and their first three derivatives are within ā, the disturbance ρ of an
axis in E = y - y_0 obeys `‖ρ_i‖ ≤ β γ_i ā` for every sequence of kept sets. If an attack falsifies
only some of the received derivatives, β has only their terms.

- static: consistent derivatives, kept sets that cannot switch.
- harmonic: attacks of one frequency each, consistent derivatives, switching too.
- peak_gain, lyapunov_corrected, lyapunov_best, star_norm: any ρ within its bound, so inconsistent
  derivatives and switching too.
- lyapunov_printed: no case in general, for it is false (see `lyapunov`).

`static ≤ harmonic ≤ peak_gain ≤` lyapunov_corrected, lyapunov_best and star_norm, always:
‖H‖₁ ≥ 1/k0, k0 ≤ η ≤ β, and a sound bound on an axis covers the ρ that attains ‖H‖₁.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxnet.theory import lyapunov, response
from jaxnet.theory.response import LawGain
from jaxnet.theory.spread import AttackGain, Gains


class Bound(NamedTuple):
    """Slopes per ā: one for each vehicle's error, one for the norm of all vehicles' errors."""

    vehicles: Gains
    fleet: float

    @property
    def worst(self) -> float:
        return float(self.vehicles.max())


def by_gains(reach: AttackGain, slope: float) -> Bound:
    """A bound on each vehicle by its gain, and on the fleet by the 2-norm of the gains."""
    return Bound(slope * reach.gains, slope * reach.fleet)


def static(reach: AttackGain) -> Bound:
    """`s_i = Σ_l (L⁻¹)_il Σ_j w_lj` over attacked links (l, j); the fleet's slope is ‖s‖₂.

    By the exact solution (O2) the bound holds for every smooth attack with consistent derivatives,
    at any frequency, while the kept set is fixed. Constant attacks in phase attain it. Slopes are
    not-a-number where the kept set may switch.
    """
    return by_gains(reach, np.nan if reach.fixed is None else 1.0)


def peak_gain(reach: AttackGain, gain: LawGain) -> Bound:
    """`β ‖H‖₁ γ_i`, for any ρ within its bound.

    Source: ‖Hρ‖_∞ ≤ ‖H‖₁ ‖ρ‖_∞ (Desoer and Vidyasagar, 1975).
    """
    return by_gains(reach, response.impulse_norm(gain) * reach.disturbance(gain))


def harmonic(reach: AttackGain, gain: LawGain) -> Bound:
    """`η ‖H‖₁ γ_i`: `peak_gain` for attacks of one frequency, with η in place of β.

    η is the greatest ‖R(a)‖ of such an attack (`response.harmonic_norm`). At every instant
    `‖R(E_i)‖ ≤ γ_i max ‖R(a)‖`, for every choice of retained neighbours (O2b).
    """
    return by_gains(reach, response.impulse_norm(gain) * response.harmonic_norm(gain))


# Constants of one axis, and whether something is said where kept sets may switch: ε jumps there.
CONSTANTS: dict[str, tuple[Callable[[LawGain], float], bool]] = {
    "lyapunov_printed": (lyapunov.printed_constant, False),
    "lyapunov_corrected": (lyapunov.corrected_constant, True),
    "lyapunov_best": (lyapunov.best_constant, True),
    "star_norm": (response.axis_star_norm, True),
}
BOUND_KEYS = ("static", "peak_gain", *CONSTANTS)


def ultimate_bounds(reach: AttackGain, gain: LawGain) -> dict[str, Bound]:
    """All bounds but `harmonic`.

    Those by a constant c of an axis are `c β γ_i`, and `c β ‖L⁻¹‖₂ ‖W_a 1‖₂` for a fleet whose kept
    sets are fixed. The paper's c is false, because it lacks √κ(P) (Khalil, theorem 4.18).
    """
    found = {"static": static(reach), "peak_gain": peak_gain(reach, gain)}
    for name, (constant, switching) in CONSTANTS.items():
        slope = constant(gain) * reach.disturbance(gain)
        if reach.fixed is not None:
            found[name] = Bound(slope * reach.gains, float(slope * reach.norms))
        else:
            found[name] = by_gains(reach, slope if switching else np.nan)
    return found
