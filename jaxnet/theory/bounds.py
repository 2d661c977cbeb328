"""Bounds on the ultimate error, per ā: what ‖y_i - y_0‖ comes to at most under attacks of size ā (SCIENCE,
O5).

Each is a constant of one axis times how far attacks spread through the network (`spread`). With
β = 1 + k0 + k1 + k2, attacks whose value and first three derivatives are within ā disturb an axis by ρ with
`‖ρ_i‖ ≤ β γ_i ā`, in E = y - y_0, whatever kept sets follow each other. Where only some of the received
derivatives are falsified, β has their terms alone.

                         holds for
    static               consistent derivatives, kept sets that cannot switch
    harmonic             attacks of one frequency each, consistent derivatives, switching too (not in tables)
    peak_gain            any ρ within its bound: inconsistent derivatives and switching too
    lyapunov_printed     nobody: it is false in general (see `lyapunov`)
    lyapunov_corrected,  as peak_gain
    lyapunov_best,
    star_norm

`static ≤ harmonic ≤ peak_gain ≤` the last three, always: ‖h‖₁ ≥ 1/k0, k0 ≤ η ≤ β, and a sound bound on an
axis covers the ρ that attains ‖h‖₁.
"""

from typing import NamedTuple

import numpy as np

from jaxnet.theory import lyapunov, response
from jaxnet.theory.response import Gain
from jaxnet.theory.spread import Gains, Spread


class Bound(NamedTuple):
    """Slopes per ā: of each vehicle's error, and of all vehicles' errors stacked."""

    vehicles: Gains
    fleet: float

    @property
    def worst(self) -> float:
        """Of the vehicle that may be farthest off."""
        return float(self.vehicles.max())


NAMES = ("static", "peak_gain", "lyapunov_printed", "lyapunov_corrected", "lyapunov_best", "star_norm")


def bounds(reach: Spread, gain: Gain) -> dict[str, Bound]:
    """All of them by name: not-a-number where one says nothing, infinite where a vehicle may be cut off."""
    return {
        "static": static(reach),
        "peak_gain": peak_gain(reach, gain),
        "lyapunov_printed": lyapunov_printed(reach, gain),
        "lyapunov_corrected": lyapunov_corrected(reach, gain),
        "lyapunov_best": lyapunov_best(reach, gain),
        "star_norm": star_norm(reach, gain),
    }


def blank(vehicles: int) -> dict[str, Bound]:
    """Nothing is known."""
    return dict.fromkeys(NAMES, Bound(np.full(vehicles, np.nan), np.nan))


def static(reach: Spread) -> Bound:
    """`s_i = Σ_l (L⁻¹)_il Σ_j w_lj` over attacked (l, j), in the fleet ‖s‖₂.

    Holds, by the exact solution (O2), for every smooth attack whose derivatives are consistent, of any
    frequency, while the kept set is fixed; constant attacks in phase attain it. Blank where it may switch.
    """
    gains = np.full(reach.gains.shape, np.nan) if reach.fixed is None else reach.gains
    return Bound(gains, float(np.linalg.norm(gains)))


def peak_gain(reach: Spread, gain: Gain) -> Bound:
    """`β ‖h‖₁ γ_i`, in the fleet their 2-norm.

    Holds for any ρ within its bound. Source: ‖h * ρ‖_∞ ≤ ‖h‖₁ ‖ρ‖_∞ (Desoer and Vidyasagar, 1975).
    """
    return per_vehicle(response.impulse_norm(gain), reach, gain)


def harmonic(reach: Spread, gain: Gain) -> Bound:
    """`η ‖h‖₁ γ_i`, η the greatest ‖R(a)‖ of any attack of one frequency (`response.harmonic_norm`).

    As `peak_gain`, of which η takes β's place: at every instant `‖R(E_i)‖ ≤ γ_i max ‖R(a)‖`, whoever is
    retained (O2b).
    """
    slopes = response.impulse_norm(gain) * response.harmonic_norm(gain) * reach.gains
    return Bound(slopes, float(np.linalg.norm(slopes)))


def lyapunov_printed(reach: Spread, gain: Gain) -> Bound:
    """`c β s_i` and `c β ‖L⁻¹‖₂ ‖W_a 1‖₂` with c = 2‖PB‖ / λ_min(Q), Q = I, as in the paper.

    False in general, for the constant lacks √κ(P); blank where kept sets may switch, for ε jumps there.
    """
    return stacked(lyapunov.printed(gain), reach, gain, np.nan)


def lyapunov_corrected(reach: Spread, gain: Gain) -> Bound:
    """The printed bound times √κ(P), which makes it one; `c β γ_i`, in E, where kept sets may switch.

    Holds for any ρ within its bound. Source: Khalil, theorem 4.18.
    """
    return stacked(lyapunov.corrected(gain), reach, gain, 1.0)


def lyapunov_best(reach: Spread, gain: Gain) -> Bound:
    """The corrected bound with the Q ≻ 0 that makes it least, of those that a search finds."""
    return stacked(lyapunov.best(gain), reach, gain, 1.0)


def star_norm(reach: Spread, gain: Gain) -> Bound:
    """As corrected, with the star norm for c: what an ellipsoid proves of the position."""
    return stacked(response.star_norm(gain), reach, gain, 1.0)


def per_vehicle(constant: float, reach: Spread, gain: Gain) -> Bound:
    """`c β γ_i`, and their 2-norm."""
    slopes = constant * reach.disturbance(gain) * reach.gains
    return Bound(slopes, float(np.linalg.norm(slopes)))


def stacked(constant: float, reach: Spread, gain: Gain, switching: float) -> Bound:
    """`c β γ_i`, of a fleet that is settled `c β ‖L⁻¹‖₂ ‖W_a 1‖₂`; times `switching` where it is not."""
    one = per_vehicle(constant, reach, gain)
    if reach.fixed is None:
        return Bound(one.vehicles * switching, one.fleet * switching)
    return one._replace(fleet=float(constant * reach.disturbance(gain) * reach.norms))
