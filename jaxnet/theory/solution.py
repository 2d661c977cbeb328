"""How fast errors decay without attack: the constants of the paper's Lemma 1."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_continuous_lyapunov

from jaxnet.model import safety
from jaxnet.model.axis import PlaneGains, companion
from jaxnet.theory import response
from jaxnet.theory.case import Case

Weight = Float[np.ndarray, "r r"]


def lyapunov_matrix(gain: PlaneGains, Q: Weight | None = None) -> Weight:
    """Solution `P` of `A_c'P + P A_c = -Q`; the default Q is the identity."""
    matrix = companion(gain)
    Q = np.eye(len(matrix)) if Q is None else Q
    return solve_continuous_lyapunov(matrix.T, -Q)


def decay_constants(gain: PlaneGains) -> tuple[float, float]:
    """Constants c₁ and c₂ [1/s] of the paper's Lemma 1, `‖η(t)‖ ≤ c₁ e^(-c₂ t) ‖η(0)‖` unattacked.

    `V = η'Pη` with Q = 1 falls at the rate 1/λ_max(P) at least, and `λ_min ‖η‖² ≤ V ≤ λ_max ‖η‖²`.
    """
    axes = np.linalg.eigvalsh(lyapunov_matrix(gain))
    return float(np.sqrt(axes[-1] / axes[0])), float(0.5 / axes[-1])


class Decay(NamedTuple):
    """`‖η(t)‖ ≤ factor e^(-rate t) ‖η(0)‖` without attack."""

    factor: float
    rate: float  # [1/s]
    norms: list[float]  # ‖H_i‖₁ of the vehicles that have gains of their own
    joined: bool  # whether dropped links cut nobody off


def decay(case: Case) -> Decay | None:
    """The paper's Lemma 1 with its constants.

    With one gain η is E with its derivatives, which does not jump where weights do, as local errors
    do. With gains of each vehicle η are local errors, and nothing is told where weights may switch.
    """
    scenario, own = case.scenario, case.scenario.own_gains
    graph, _, trusted, kept = case.situation
    if scenario.draws_gain or (own is not None and (kept is None or kept.fixed is None)):
        return None
    matrices = scenario.gain_matrices
    gains = [case.gain if matrices is None else matrices] if own is None else [*own]
    factors, rates = zip(*map(decay_constants, gains), strict=True)
    drops = scenario.defence.may_drop(graph, trusted)
    joined = safety.stay_joined(drops, np.ones(graph.vehicles, bool)).all()
    norms = [] if own is None else [response.impulse_norm(each) for each in own]
    return Decay(max(factors), min(rates), norms, bool(joined))
