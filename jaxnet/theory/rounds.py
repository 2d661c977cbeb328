"""Stability of the law by exchanges, with the jerk held between ticks (theorems.md O12).

With T = A^n for n rounds, a tick of length h, vehicles of order three and E = y - y_0,

    q ← T q + (1 - T) L⁻¹b,      (E, Ė, Ë) ← Φ (E, Ė, Ë) + Γ q,      Γ = [h³/6, h²/2, h]'.

L⁻¹b equals -P(E) plus inputs from the navigator and the attacks. T has the eigenvectors of A. Along
each eigenvector the loop is a matrix of four by four that depends on μ = λ^n alone. Vehicles of
order r have a matrix of r + 1 by r + 1.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from jaxnet.model.graph import Digraph, Weights, dense
from jaxnet.theory.response import LawGain
from jaxnet.theory.theorem import Case, Theorem

HALVINGS = 40
LoopMatrices = Complex[np.ndarray, "loops s s"]
ANGLES = np.exp(1j * np.pi * np.linspace(0, 1, 65))  # points of the upper unit circle


def eigenvalues(weights: Weights) -> Complex[np.ndarray, " some"]:
    """Distinct eigenvalues of A for a graph `[a0 | A]`, the upper one of each conjugate pair."""
    found = np.linalg.eigvals(weights[:, 1:]).round(12)
    return np.unique(np.real(found) + 1j * np.abs(np.imag(found)))


def growth(mu: np.ndarray | complex | float, gain: LawGain, tick: float) -> float:
    """Factor of the slowest motion at each tick, the greatest over all μ: stable below 1.

    With s the eigenvalues of `(M - 1)/h`, the factor is `|1 + h s|`. This form keeps its precision
    for short ticks.
    """
    return float(np.abs(1 + tick * np.linalg.eigvals(loop_rates(mu, gain, tick))).max())


def loop_rates(mu: np.ndarray | complex | float, gain: LawGain, tick: float) -> LoopMatrices:
    """`(M - 1)/h` for each μ, with M the matrix of (E, Ė, …, q) from one tick to the next."""
    mu, h, r = np.atleast_1d(np.asarray(mu, complex)), tick, len(gain)
    integrators, entry = held_rates(r, h)
    wanted = -(1 - mu)[:, None] * gain
    rates = np.zeros((len(mu), r + 1, r + 1), complex)
    rates[:, :r, :r] = integrators + entry[:, None] * wanted[:, None]
    rates[:, :r, r] = entry * mu[:, None]
    rates[:, r, :r], rates[:, r, r] = wanted / h, (mu - 1) / h
    return rates


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
    low, high = 0.0, 1.0
    if mean_square_growth(mu, gain, tick, low) >= 1:
        return 0.0
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (
            (middle, high) if mean_square_growth(mu, gain, tick, middle) < 1 else (low, middle)
        )
    return low


def local_growth(eigenvalues: np.ndarray, gain: LawGain, tick: float) -> float:
    """Factor of the slowest motion at each tick under the local law: stable below 1.

    Along an eigenvector of A with eigenvalue λ the law is `q = -(1 - λ) P(E)`, held for a tick.
    """
    integrators, entry = held_rates(len(gain), tick)
    rates = integrators - entry[:, None] * ((1 - eigenvalues)[:, None] * gain)[:, None]
    return float(np.abs(1 + tick * np.linalg.eigvals(rates)).max())


def local_rate(eigenvalues: np.ndarray, gain: LawGain) -> float:
    """Rate of the slowest motion under the local law at every instant [1/s]: stable below 0.

    Along an eigenvector of A with eigenvalue λ the rates are the roots of `s^r + (1 - λ) P(s)`.
    """
    pulls = (1 - eigenvalues)[:, None] * gain[::-1]
    return max(float(np.roots([1.0, *each]).real.max()) for each in pulls)


def late_growth(
    eigenvalues: np.ndarray,
    gain: LawGain,
    word: Float[np.ndarray, " factors"],
    tick: float,
    late: int,
) -> float:
    """Factor of the slowest motion at each tick where words are late by a number of ticks >= 1.

    `word` are the factors of E, Ė, … and of the held q in a word. The factor of q is 0 under a
    local law. Along an eigenvector of A with eigenvalue λ, `q = λ w(t - d h) - P(E)`, where w is
    the word. One exchange has the characteristic polynomial of theorems.md, O16.
    """
    r, (integrators, entry) = len(gain), held_rates(len(gain), tick)
    size = r + 1 + late  # E and its derivatives, q, and the words on their way, the newest first
    loops = np.zeros((len(eigenvalues), size, size), complex)
    loops[:, r, :r], loops[:, r, -1] = -gain, eigenvalues
    loops[:, :r, :r] = np.eye(r) + tick * integrators
    loops[:, :r] += tick * entry[None, :, None] * loops[:, r : r + 1]
    loops[:, r + 1, : r + 1] = word
    loops[:, np.arange(r + 2, size), np.arange(r + 1, size - 1)] = 1.0
    return float(np.abs(np.linalg.eigvals(loops)).max())


def held_rates(order: int, tick: float) -> tuple[np.ndarray, np.ndarray]:
    """`(Φ - 1)/h` and `Γ/h` of as many integrators whose input is held for a tick h [s]."""
    steps = np.arange(order)[None] - np.arange(order)[:, None]
    factors = [tick ** (n - 1) / math.factorial(n) for n in range(1, order + 1)]
    integrators = np.array([[factors[n - 1] if n > 0 else 0.0 for n in row] for row in steps])
    return integrators, np.array(factors[::-1])


def spectral_radius(weights: Weights, gain: LawGain, tick: float, rounds: int) -> float:
    """Growth factor at each tick for a graph and a number of rounds."""
    return growth(eigenvalues(weights) ** rounds, gain, tick)


def least_rounds(weights: Weights, gain: LawGain, tick: float) -> tuple[int, int] | None:
    """Least stable number of rounds, and a number from which on every number is stable.

    None if the law solved exactly at ticks is unstable, or if a vehicle is cut off. The growth is
    subharmonic in μ, because M is affine in μ. So a disc is stable if and only if its edge is
    stable. Every number of rounds that moves all μ into the disc is then stable.
    """
    found = eigenvalues(weights)
    low, high = 0.0, 1.0  # radius of the greatest stable disc
    most, slow = np.abs(found).max(), found[np.real(found).argmax()]
    if growth(0.0, gain, tick) >= 1 or most >= 1:
        return None
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if growth(middle * ANGLES, gain, tick) < 1 else (low, middle)
    surely = 1 if most <= low else int(np.ceil(np.log(low) / np.log(most)))
    for few in range(1, surely):
        if growth(slow**few, gain, tick) < 1 and growth(found**few, gain, tick) < 1:
            return few, surely
    return surely, surely


def lateness(weights: Weights, tick: float, rounds: int) -> Float[np.ndarray, " m"]:
    """Delay [s] of each vehicle's held jerk behind the navigator's, `h (1/2 + (1 - T)⁻¹T 1)`.

    Behind a slow navigator E tends to this delay times `-d⁴y_0/dt⁴ / k0`.
    """
    left, one = np.linalg.matrix_power(weights[:, 1:], rounds), np.ones(len(weights))
    return tick * (0.5 + np.linalg.solve(np.eye(len(weights)) - left, left @ one))


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
    """Stability of the fleet's law, of which the strict rows are those of honest sources."""
    scenario, (graph, attacked, _, kept) = case.scenario, case.situation
    law, attack, tick = scenario.law, scenario.attack, scenario.tick
    if law.solves():
        return None
    fixed = None if kept is None else kept.fixed
    elsewhere = attack.replaces() and (bool(attack.periods()) or not attack.targets())
    honest = ~(attacked & (attack.replaces() and not elsewhere))
    weights = dense((graph if fixed is None else fixed).only(honest))
    if not law.couples():
        weights = followed_weights(case, fixed, weights)
    along = deviating(case, weights)
    left = law.left(along)
    if left is None and not law.gives_demand():
        return None
    least = least_rounds(weights, case.gain, tick) if law.iterates() else None
    if not law.needs_ticks():
        grown, tick = local_rate(along, case.gain), None
    elif left is None:
        grown = local_growth(along, case.gain, tick)
    else:
        grown = growth(left, case.gain, tick)
    return Stability(
        grown, tick, law.iterates(), least, elsewhere and law.needs_ticks(), fixed is None
    )


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
    own = np.concatenate([np.zeros_like(factor), np.eye(len(weights))], axis=1)
    return own - factor * (own - weights)


class MeanSquare(NamedTuple):
    """Growth of root-mean-square deviations at each tick, and the loss up to which they fall."""

    growth: float
    critical: float  # probability; 0 if none


def in_mean_square(case: Case) -> MeanSquare | None:
    """Stability of a law by exchanges if whole ticks are lost."""
    law, loss = case.scenario.law, case.scenario.channel.loss
    lost = None if loss.perfect() else loss.of_whole_ticks()
    if lost is None or not law.needs_ticks() or case.scenario.attack.replaces():
        return None
    left = law.left(eigenvalues(case.weights))
    if left is None:
        return None
    tick = case.scenario.tick
    grown = mean_square_growth(left, case.gain, tick, lost)
    return MeanSquare(grown, critical_loss(left, case.gain, tick))


def reached_at_ticks(case: Case) -> bool | None:
    """Whether O1 holds while the navigator reaches every vehicle at each tick."""
    return None if case.scenario.channel.loss.perfect() else True


OF_LAWS = ("one gain", "flat", "one network", "every message", "on time", "small")
IN_MEAN_SQUARE = ("one gain", "flat", "one network", "on time", "drops", "no decisions", "small")
WHILE_REACHED = ("leader", "solved", "flat", "one network", "on time", "drops")
STABILITIES = (
    Theorem("O12", "stability", "", OF_LAWS, stability),
    Theorem("O12", "in mean square", "", IN_MEAN_SQUARE, in_mean_square),
    Theorem("O1", "while reached", "", WHILE_REACHED, reached_at_ticks),
)
