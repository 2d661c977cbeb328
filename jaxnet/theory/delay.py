"""Late messages: how far a fleet lags, and up to which delay it is stable (theorems.md O16)."""

import math
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxnet.model import graph
from jaxnet.model.graph import Weights
from jaxnet.theory import rounds
from jaxnet.theory.response import LawGain
from jaxnet.theory.theorem import Case, Theorem

MOST_DELAY = 1e3  # [s] up to which a margin is sought


def lags(weights: Weights, delay: float) -> Float[np.ndarray, " m"]:
    """Time [s] by which each vehicle ends behind a navigator on a line, `τ L⁻¹ 1`.

    Words are late by `delay` [s] and are taken as they are.
    """
    return delay * np.linalg.solve(graph.laplacian(weights), np.ones(len(weights)))


def word_factors(
    gain: LawGain, delay: float, extrapolate: str, local: bool
) -> Float[np.ndarray, " factors"]:
    """Factors of y, ẏ, …, y^(r) in a word that is late by `delay` [s].

    They are those of R, or of R after the delay by Taylor. Under a `local` law y^(r) is not told.
    """
    order = len(gain)
    powers = [
        delay**n / math.factorial(n) * (extrapolate != "none" or n == 0) for n in range(order + 1)
    ]
    factors = [sum(gain[n - j] * powers[j] for j in range(n + 1)) for n in range(order)]
    jerk = sum(gain[k] * powers[order - k] for k in range(order)) if extrapolate == "jerk" else 0.0
    return np.array([*factors, 0.0 if local else 1.0 + jerk])


def jerk_margin(weights: Weights, gain: LawGain) -> float:
    """Delay [s] above which a fleet is unstable that extrapolates the highest derivative too.

    There `ρ(A) (1 + k_{r-1} τ + … + k0 τ^r / r!)` is 1, the gain of fast motions from word to word.
    The margin is infinite on a graph without a cycle.
    """
    radius, order = np.abs(np.linalg.eigvals(weights[:, 1:])).max(), len(gain)

    def excess(delay: float) -> float:
        factor = 1 + sum(
            gain[k] * delay ** (order - k) / math.factorial(order - k) for k in range(order)
        )
        return radius * factor - 1

    if excess(MOST_DELAY) <= 0:
        return math.inf
    from scipy.optimize import brentq  # takes 0.15 s to import

    margin: Any = brentq(excess, 0.0, MOST_DELAY, xtol=1e-12)
    return float(margin)


def lag_behind(case: Case) -> Float[np.ndarray, " m"] | None:
    channel = case.scenario.channel
    plain = channel.late and channel.extrapolate == "none"
    return lags(case.weights, channel.delay) if plain else None


def follows_lines(case: Case) -> bool | None:
    """Whether a navigator on a line is followed without error."""
    channel = case.scenario.channel
    return True if channel.late and channel.extrapolate == "jets" else None


def greatest_delay(case: Case) -> float | None:
    """Delay [s] below which a necessary condition of stability holds; None without such a bound."""
    channel = case.scenario.channel
    if not channel.late or channel.extrapolate != "jerk":
        return None
    margin = jerk_margin(case.weights, case.gain)
    return margin if np.isfinite(margin) else None


def growth_when_late(case: Case) -> float | None:
    """Growth of deviations per tick under a law that holds a derivative and hears late messages."""
    scenario, law, channel = case.scenario, case.scenario.law, case.scenario.channel
    rows, leads = case.situation.graph.weights.T[None], scenario.navigator.present
    known = channel.late and law.needs_ticks() and (law.gives_demand() or law.iterates())
    if not known or scenario.attack.replaces():
        return None
    if not law.couples() and scenario.topology.strength(rows, leads) is not None:
        return None
    message = word_factors(case.gain, channel.delay, channel.extrapolate, not law.couples())
    along, late = rounds.deviating(case, case.weights), round(channel.delay / scenario.tick)
    return rounds.late_growth(along, case.gain, message, scenario.tick, late)


OF_DELAY = ("flat", "one network", "every message", "no decisions", "steady delay", "small")
LATE_FLEETS = (
    Theorem("O16", "lag", "s", (*OF_DELAY, "solved"), lag_behind),
    Theorem("O16", "follows lines", "", (*OF_DELAY, "solved"), follows_lines),
    Theorem("O16", "greatest delay", "s", (*OF_DELAY, "solved", "one gain"), greatest_delay),
    Theorem("O16", "growth when late", "", (*OF_DELAY, "one gain"), growth_when_late),
)
