"""Stability of the law by exchanges, with the jerk held between ticks (theorems.md O12).

With T = A^n for n rounds, a tick of length h, vehicles of order three and E = y - y_0,

    q ← T q + (1 - T) L⁻¹b,      (E, Ė, Ë) ← Φ (E, Ė, Ë) + Γ q,      Γ = [h³/6, h²/2, h]'.

L⁻¹b equals -P(E) plus inputs from the navigator and the attacks. T has the eigenvectors of A. Along
each eigenvector the loop is a matrix of four by four that depends on μ = λ^n alone. Vehicles of
order r have a matrix of r + 1 by r + 1.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from jaxnet.config.keys import Scenario
from jaxnet.model.graph import Digraph, Weights, dense
from jaxnet.theory.case import Case
from jaxnet.theory.response import LawGain

HALVINGS = 40
ANGLES = np.exp(1j * np.pi * np.linspace(0, 1, 65))  # points of the upper unit circle

Loops = Complex[np.ndarray, "loops s s"] | Float[np.ndarray, "loops s s"]
LoopFactor = np.ndarray | complex | float  # of one eigenvector, or of several


def eigenvalues(weights: Weights) -> Complex[np.ndarray, " some"]:
    """Distinct eigenvalues of A for a graph `[a0 | A]`, the upper one of each conjugate pair."""
    found = np.linalg.eigvals(weights[:, 1:]).round(12)
    return np.unique(np.real(found) + 1j * np.abs(np.imag(found)))


def growth(
    mu: LoopFactor,
    gain: LawGain,
    tick: float,
    pull: LoopFactor | None = None,
    damping: LawGain | float = 0.0,
) -> float:
    """Factor of the slowest motion at each tick, the greatest over all μ: stable below 1.

    With s the eigenvalues of `(M - 1)/h`, the factor is `|1 + h s|`. This form keeps its precision
    for short ticks.
    """
    rates = loop_rates(mu, gain, tick, pull, damping)
    return float(np.abs(1 + tick * np.linalg.eigvals(rates)).max())


def loop_rates(
    mu: LoopFactor,
    gain: LawGain,
    tick: float,
    pull: LoopFactor | None = None,
    damping: LawGain | float = 0.0,
) -> Loops:
    """`(M - 1)/h` for each μ, with M the matrix of (E, Ė, …, q) from one tick to the next.

    The tick's new q is `μ q - pull P(E) - D(E)`. The default pull is 1 - μ. D has the gains
    `damping`.
    """
    mu, r = np.atleast_1d(np.asarray(mu, complex)), len(gain)
    integrators, entry = held_rates(r, tick)
    wanted = -np.multiply.outer(1 - mu if pull is None else pull, gain) - damping
    rates = np.zeros((len(wanted), r + 1, r + 1), complex)
    rates[:, :r, :r] = integrators + entry[:, None] * wanted[:, None]
    rates[:, :r, r] = entry * mu[:, None]
    rates[:, r, :r] = wanted / tick
    rates[:, r, r] = (mu - 1) / tick
    return rates


def held_rates(order: int, tick: float) -> tuple[np.ndarray, np.ndarray]:
    """`(Φ - 1)/h` and `Γ/h` of as many integrators whose input is held for a tick h [s]."""
    factors = [tick ** (n - 1) / math.factorial(n) for n in range(1, order + 1)]
    integrators = sum(np.eye(order, k=n) * factors[n - 1] for n in range(1, order))
    return integrators + np.zeros((order, order)), np.array(factors[::-1])


def mean_square_growth(mu: np.ndarray, gain: LawGain, tick: float, lost: float) -> float:
    """Root-mean-square growth at each tick where all messages of a tick are lost together.

    A tick is lost with the probability `lost`, independently. Vehicles then hold their q, which is
    the loop N of μ = 1. The second moments grow by the greatest eigenvalue of `(1 - p) M⊗M̄ + p
    N⊗N̄` over all μ.
    """
    size = (len(gain) + 1) ** 2
    loops = np.eye(len(gain) + 1) + tick * loop_rates(np.append(mu, 1.0), gain, tick)
    squares = np.einsum("nij,nkl->nikjl", loops, loops.conj()).reshape(-1, size, size)
    moments = (1 - lost) * squares[:-1] + lost * squares[-1]
    return float(np.sqrt(np.abs(np.linalg.eigvals(moments)).max()))


def critical_loss(mu: np.ndarray, gain: LawGain, tick: float) -> float:
    """Probability of loss above which second moments grow; 0 if they grow without any loss."""
    if mean_square_growth(mu, gain, tick, 0.0) >= 1:
        return 0.0
    return bisected(lambda lost: mean_square_growth(mu, gain, tick, lost) < 1)


def bisected(holds: Callable[[float], bool]) -> float:
    """Number between 0 and 1 up to which a condition holds, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def local_rate(eigenvalues: np.ndarray, gain: LawGain, damping: LawGain | float = 0.0) -> float:
    """Rate of the slowest motion under the local law at every instant [1/s]: stable below 0.

    Along an eigenvector of A with eigenvalue λ the rates are the roots of `s^r + (1 - λ) P(s) +
    D(s)`. D has the gains `damping`.
    """
    pulls = np.multiply.outer(1 - eigenvalues, gain) + damping
    return max(float(np.roots([1.0, *each[::-1]]).real.max()) for each in pulls)


def least_rounds(weights: Weights, gain: LawGain, tick: float) -> tuple[int, int] | None:
    """Least stable number of rounds, and a number from which on every number is stable.

    None if the law solved exactly at ticks is unstable, or if a vehicle is cut off. The growth is
    subharmonic in μ, because M is affine in μ. So a disc is stable if and only if its edge is
    stable. Every number of rounds that moves all μ into the disc is then stable.
    """
    found = eigenvalues(weights)
    most, slow = np.abs(found).max(), found[np.real(found).argmax()]
    if growth(0.0, gain, tick) >= 1 or most >= 1:
        return None
    radius = bisected(lambda radius: growth(radius * ANGLES, gain, tick) < 1)
    surely = 1 if most <= radius else int(np.ceil(np.log(radius) / np.log(most)))
    for few in range(1, surely):
        if growth(slow**few, gain, tick) < 1 and growth(found**few, gain, tick) < 1:
            return few, surely
    return surely, surely


class Stability(NamedTuple):
    """Growth of deviations under a law that is not solved at every instant."""

    growth: float  # factor at each tick: stable below 1; or the exponent [1/s]: stable below 0
    tick: float | None  # [s]; None if the growth is an exponent
    jacobi: bool  # whether the least stable number of rounds is known
    least: tuple[int, int] | None  # that number, and the one from which on all are stable
    without_attack: bool  # whether the attack, which replaces messages, is left out
    while_retained: bool  # whether it holds while every source is retained

    @property
    def stable(self) -> bool:
        return self.growth < (0 if self.tick is None else 1)


def deviating(case: Case, weights: Weights) -> Complex[np.ndarray, " some"]:
    """Eigenvalues of A without that of agreement, which is 1 if there is no navigator."""
    along = eigenvalues(weights)
    return along if case.scenario.navigator.present else along[np.abs(along - 1) > 1e-9]


def stability(case: Case) -> Stability | None:
    """Stability of the fleet's law, of which the strict rows are those of honest sources.

    A law that is solved at every instant is stable. If vehicles hold their inputs for a tick, the
    solved law has the loop of μ = 0, whatever they retain.
    """
    scenario, (graph, attacked, _, kept) = case.scenario, case.situation
    law, attack = scenario.law, scenario.attack
    (gain, damping), tick = case.parts, scenario.tick
    sampled = scenario.engine.samples
    if attack.misuses() or (not keeps_drive(scenario) if sampled else law.solves()):
        return None
    if law.solves():
        return Stability(growth(0.0, gain, tick), tick, False, None, False, False)
    fixed = None if kept is None else kept.fixed
    elsewhere = attack.replaces() and (bool(attack.periods()) or not attack.targets())
    honest = ~(attacked & (attack.replaces() and not elsewhere))
    weights = dense((graph if fixed is None else fixed).only(honest))
    if not law.couples():
        weights = followed_weights(case, fixed, weights)
    along = deviating(case, weights)
    left = law.left(along)
    if not len(along) or (left is None and not law.gives_demand()):
        return None
    iterates, while_retained = law.iterates(), fixed is None
    least = least_rounds(weights, gain, tick) if iterates else None
    if not law.needs_ticks() and not sampled:
        rate = local_rate(along, gain, damping)
        return Stability(rate, None, iterates, least, False, while_retained)
    if left is None:
        grown = growth(0 * along, gain, tick, 1 - along, damping)
    else:
        grown = growth(left, gain, tick)
    return Stability(grown, tick, iterates, least, elsewhere, while_retained)


def keeps_drive(scenario: Scenario) -> bool:
    """Whether held inputs move vehicles by `held_rates`: Euler's step does so for order 1 alone."""
    vehicle = scenario.vehicle
    return vehicle.holds_drive and (vehicle.order == 1 or "euler" not in scenario.engine.options())


def followed_weights(case: Case, fixed: Digraph | None, weights: Weights) -> Weights:
    """`I - S (I - A)` of a local law, where S holds the strengths of the rows.

    `weights` is [a0 | A] of the sources retained for good, which are those of `fixed`, or all.
    """
    graph, leads = case.situation.graph, case.scenario.navigator.present
    strength = case.scenario.topology.strength(graph.weights.T[None], leads)
    if strength is None:
        return weights
    kept = graph if fixed is None else graph.only(fixed.heard)
    factor = strength.of(kept.weights.sum(axis=1)[None, None])[0, 0][:, None]
    own = np.eye(*weights.shape, k=1)
    return own - factor * (own - weights)


class MeanSquare(NamedTuple):
    """Growth of root-mean-square deviations at each tick, and the loss up to which they fall."""

    growth: float
    critical: float  # probability; 0 if none


def in_mean_square(case: Case) -> MeanSquare | None:
    """Stability of a law by exchanges if whole ticks are lost."""
    scenario = case.scenario
    law, loss = scenario.law, scenario.channel.loss
    lost = None if loss.perfect() else loss.of_whole_ticks()
    if lost is None or not law.needs_ticks() or scenario.attack.replaces():
        return None
    left = law.left(eigenvalues(case.weights))
    if left is None:
        return None
    grown = mean_square_growth(left, case.gain, scenario.tick, lost)
    return MeanSquare(grown, critical_loss(left, case.gain, scenario.tick))


def reached_at_ticks(case: Case) -> bool | None:
    """Whether O1 holds while the navigator reaches every vehicle at each tick."""
    return None if case.scenario.channel.loss.perfect() else True
