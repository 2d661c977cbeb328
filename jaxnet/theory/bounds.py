"""Bounds on the ultimate error ‖y_i - y_0‖, per ā, under attacks of size ā (theorems.md O5).

Each bound is a constant of one axis times the attack gain of the network (`spread`). Let β = 1 + k0
+ k1 + k2. If the attacks and their first three derivatives are within ā, the disturbance ρ of an
axis in E = y - y_0 obeys `‖ρ_i‖ ≤ β γ_i ā` for every sequence of kept sets. If an attack falsifies
only some of the received derivatives, β has only their terms.

    bound                holds for
    static               consistent derivatives, kept sets that cannot switch
    harmonic             attacks of one frequency each, consistent derivatives, switching too (not
    in tables) peak_gain            any ρ within its bound: inconsistent derivatives and switching
    too lyapunov_printed     no case in general: it is false (see `lyapunov`) lyapunov_corrected,
    as peak_gain lyapunov_best, star_norm

`static ≤ harmonic ≤ peak_gain ≤` the last three, always: ‖h‖₁ ≥ 1/k0, k0 ≤ η ≤ β, and a sound bound
on an axis covers the ρ that attains ‖h‖₁.
"""

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


BOUND_KEYS = (
    "static",
    "peak_gain",
    "lyapunov_printed",
    "lyapunov_corrected",
    "lyapunov_best",
    "star_norm",
)


def ultimate_bounds(reach: AttackGain, gain: LawGain) -> dict[str, Bound]:
    return {
        "static": static(reach),
        "peak_gain": peak_gain(reach, gain),
        "lyapunov_printed": lyapunov_printed(reach, gain),
        "lyapunov_corrected": lyapunov_corrected(reach, gain),
        "lyapunov_best": lyapunov_best(reach, gain),
        "star_norm": star_norm(reach, gain),
    }


def static(reach: AttackGain) -> Bound:
    """`s_i = Σ_l (L⁻¹)_il Σ_j w_lj` over attacked links (l, j); the fleet's slope is ‖s‖₂.

    By the exact solution (O2) the bound holds for every smooth attack with consistent derivatives,
    at any frequency, while the kept set is fixed. Constant attacks in phase attain it. Slopes are
    not-a-number where the kept set may switch.
    """
    gains = np.full(reach.gains.shape, np.nan) if reach.fixed is None else reach.gains
    return Bound(gains, float(np.linalg.norm(gains)))


def peak_gain(reach: AttackGain, gain: LawGain) -> Bound:
    """`β ‖h‖₁ γ_i`; the fleet's slope is the 2-norm of these.

    The bound holds for any ρ within its bound. Source: ‖h * ρ‖_∞ ≤ ‖h‖₁ ‖ρ‖_∞ (Desoer and
    Vidyasagar, 1975).
    """
    return per_vehicle(response.impulse_norm(gain), reach, gain)


def harmonic(reach: AttackGain, gain: LawGain) -> Bound:
    """`η ‖h‖₁ γ_i` for attacks of one frequency.

    η is the greatest ‖R(a)‖ of such an attack (`response.harmonic_norm`). The bound is `peak_gain`
    with η in place of β. At every instant `‖R(E_i)‖ ≤ γ_i max ‖R(a)‖`, for every choice of retained
    neighbours (O2b).
    """
    slopes = response.impulse_norm(gain) * response.harmonic_norm(gain) * reach.gains
    return Bound(slopes, float(np.linalg.norm(slopes)))


def lyapunov_printed(reach: AttackGain, gain: LawGain) -> Bound:
    """Paper's `c β s_i` and `c β ‖L⁻¹‖₂ ‖W_a 1‖₂` with c = 2‖PB‖ / λ_min(Q) and Q = I.

    The bound is false in general, because the constant lacks √κ(P). Slopes are not-a-number where
    kept sets may switch, because ε jumps there.
    """
    return fleet_bound(lyapunov.printed_constant(gain), reach, gain, np.nan)


def lyapunov_corrected(reach: AttackGain, gain: LawGain) -> Bound:
    """Printed bound times √κ(P), and `c β γ_i`, in E, where kept sets may switch.

    The bound holds for any ρ within its bound. Source: Khalil, theorem 4.18.
    """
    return fleet_bound(lyapunov.corrected_constant(gain), reach, gain, 1.0)


def lyapunov_best(reach: AttackGain, gain: LawGain) -> Bound:
    """Corrected bound for the best Q ≻ 0 that a numerical search finds."""
    return fleet_bound(lyapunov.best_constant(gain), reach, gain, 1.0)


def star_norm(reach: AttackGain, gain: LawGain) -> Bound:
    """Corrected bound with the star norm as constant c.

    An invariant ellipsoid proves this bound on the position.
    """
    return fleet_bound(response.axis_star_norm(gain), reach, gain, 1.0)


def per_vehicle(constant: float, reach: AttackGain, gain: LawGain) -> Bound:
    """`c β γ_i`; the fleet's slope is the 2-norm of these."""
    slopes = constant * reach.disturbance(gain) * reach.gains
    return Bound(slopes, float(np.linalg.norm(slopes)))


def fleet_bound(constant: float, reach: AttackGain, gain: LawGain, switching: float) -> Bound:
    """`c β γ_i`, and `c β ‖L⁻¹‖₂ ‖W_a 1‖₂` for a fleet whose kept sets are fixed.

    Where kept sets may switch, the slopes are those of `per_vehicle` times `switching`.
    """
    one = per_vehicle(constant, reach, gain)
    if reach.fixed is None:
        return Bound(one.vehicles * switching, one.fleet * switching)
    return one._replace(fleet=float(constant * reach.disturbance(gain) * reach.norms))
