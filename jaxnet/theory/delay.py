"""Late messages: how far a fleet lags, and up to which delay it is stable (theorems.md O16)."""

import math

import numpy as np
from jaxtyping import Float

from jaxnet.model import graph
from jaxnet.model.graph import Weights
from jaxnet.theory.case import Case
from jaxnet.theory.response import LawGain
from jaxnet.theory.rounds import deviating, followed_weights, held_rates, local_rate

MOST_DELAY = 1e3  # [s] up to which a margin is sought


def lag_behind(case: Case) -> Float[np.ndarray, " m"] | None:
    """Time [s] by which each vehicle ends behind a navigator on a line, `τ L⁻¹ 1`.

    Messages are delayed by τ [s] and are taken as they are.
    """
    channel = case.scenario.channel
    if not channel.late or channel.extrapolate != "none":
        return None
    laplacian = graph.laplacian(case.weights)
    return channel.delay * np.linalg.solve(laplacian, np.ones(len(laplacian)))


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


def jerk_margin(weights: Weights, gain: LawGain) -> float:
    """Delay [s] above which a fleet is unstable that extrapolates the highest derivative too.

    There `ρ(A) (1 + k_{r-1} τ + … + k0 τ^r / r!)` is 1, the gain of fast motions from message to
    message. The margin is infinite on a graph without a cycle.
    """
    radius = np.abs(np.linalg.eigvals(weights[:, 1:])).max()

    def excess(delay: float) -> float:
        return radius * message_factors(gain, delay, "jerk", False)[-1] - 1

    if excess(MOST_DELAY) <= 0:
        return math.inf
    from scipy.optimize import brentq  # takes 0.15 s to import

    return float(brentq(excess, 0.0, MOST_DELAY, xtol=1e-12))  # pyright: ignore[reportArgumentType]


def message_factors(
    gain: LawGain, delay: float, extrapolate: str, local: bool
) -> Float[np.ndarray, " factors"]:
    """Factors of y, ẏ, …, y^(r) in a message that is delayed by `delay` [s].

    They are those of R, or of R after the delay by Taylor. A `local` law transmits no y^(r).
    """
    order = len(gain)
    after = [delay**n / math.factorial(n) for n in range(order + 1)]
    factors = np.convolve([*gain, 1.0], [1.0] if extrapolate == "none" else after)[: order + 1]
    if extrapolate != "jerk":
        factors[order] = 1.0
    if local:
        factors[order] = 0.0
    return factors


def growth_when_late(case: Case) -> float | None:
    """Growth of deviations per tick under a law that holds a derivative and hears late messages."""
    scenario = case.scenario
    law, channel = scenario.law, scenario.channel
    rows, leads = case.situation.graph.weights.T[None], scenario.navigator.present
    known = channel.late and law.needs_ticks() and (law.gives_demand() or law.iterates())
    if not known or scenario.attack.replaces() or scenario.attack.misuses():
        return None
    (told, felt), weights = case.parts, case.weights
    if channel.own_delay:
        weights = followed_weights(case, None, weights)
    elif not law.couples() and scenario.topology.strength(rows, leads) is not None:
        return None
    else:
        felt = case.gain
    along, tick = deviating(case, weights), scenario.tick
    message = message_factors(told, channel.delay, channel.extrapolate, not law.couples())
    ticks = round(channel.delay / tick)
    if not len(along):
        return None
    return late_growth(along - channel.own_delay, felt, message, tick, ticks)


def common_margin(case: Case) -> float | None:
    """Delay [s] below which a fleet is stable whose vehicles delay their own motion alike.

    None where messages are extrapolated, or own motion is that of now.
    """
    channel, attack = case.scenario.channel, case.scenario.attack
    if not (channel.late and channel.own_delay) or channel.extrapolate != "none":
        return None
    along = deviating(case, followed_weights(case, None, case.weights))
    if attack.replaces() or attack.misuses() or not len(along):
        return None
    if local_rate(along, *case.parts) >= 0:
        return 0.0
    pulls = np.concatenate([1 - along, np.conj(1 - along)])
    return min(first_crossing(pull, *case.parts) for pull in pulls)


def first_crossing(pull: complex | float, gain: LawGain, damping: LawGain) -> float:
    """Least delay τ [s] at which `s^r + D(s) + pull P(s) e^(-sτ)` has a root iω, ω > 0.

    P and D have the gains `gain` and `damping`. Order 1: `(π/2 + arg pull) / (k0 |pull|)` (Olfati-
    Saber and Murray, Consensus problems in networks of agents with switching topology and
    time-delays, 2004).
    """
    along_axis = 1j ** np.arange(len(gain), -1, -1)  # of ω in place of s
    own, others = np.array([1.0, *damping[::-1]]) * along_axis, pull * gain[::-1] * along_axis[1:]
    sizes = np.polymul(own, own.conj()), np.polymul(others, others.conj())
    roots = np.roots(np.polysub(*sizes).real)
    rates = roots[(abs(roots.imag) < 1e-9 * abs(roots)) & (roots.real > 0)].real
    turns = -np.angle(-np.polyval(own, rates) / np.polyval(others, rates)) % (2 * np.pi)
    return float((turns / rates).min(initial=np.inf))


def late_growth(
    eigenvalues: np.ndarray,
    gain: LawGain,
    message: Float[np.ndarray, " factors"],
    tick: float,
    late: int,
) -> float:
    """Factor of the slowest motion at each tick where messages are `late` ticks late, at least 1.

    `gain` has the factors of P, and `message` those of E, Ė, … and of the held q in a message.
    Along an eigenvector of A with eigenvalue λ, `q = λ w(t - d h) - P(E)`, where w is the message.
    Where own motion is late too, P is the damping alone, and λ - 1 stands for λ. One exchange has
    the characteristic polynomial of theorems.md, O16.
    """
    r = len(gain)
    integrators, entry = held_rates(r, tick)
    size = r + 1 + late  # E and its derivatives, q, and the messages on their way, newest first
    loops = np.zeros((len(eigenvalues), size, size), complex)
    loops[:, r, :r] = -gain
    loops[:, r, -1] = eigenvalues
    loops[:, :r, :r] = np.eye(r) + tick * integrators
    loops[:, :r] += tick * entry[None, :, None] * loops[:, r : r + 1]
    loops[:, r + 1, : r + 1] = message
    loops[:, np.arange(r + 2, size), np.arange(r + 1, size - 1)] = 1.0
    return float(np.abs(np.linalg.eigvals(loops)).max())
