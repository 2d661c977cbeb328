"""Exact solution of the closed loop for known kept sets (theorems.md O1 and O2).

`E_i = y_i - y_0` obeys `E‴ + k2 Ë + k1 Ė + k0 E = 0` around `G = L⁻¹ d`, so from t to t + h

    E(t + h) = G(t + h) + expm(A_c h) (E(t) - G(t)).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm, solve_continuous_lyapunov

from jaxnet.model import graph, safety
from jaxnet.model.axis import PlaneGains, companion
from jaxnet.theory import response
from jaxnet.theory.case import Case

Weight = Float[np.ndarray, "r r"]
ErrorJets = Float[np.ndarray, "r m 2"]


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


def tracking_errors(
    start: ErrorJets,
    corruption: Callable[[float, Float[np.ndarray, "m sources"]], ErrorJets],
    weights: Float[np.ndarray, "times m sources"],
    gain: Float[np.ndarray, "r"],
    interval: float,
) -> Float[np.ndarray, "times m 2"]:
    """Errors `E` [m] at times 0, interval, 2 interval …

    `weights[n]` is in force from the n-th time to the next. `start` contains E and its derivatives
    below the order r at time 0. `corruption(t, weights)` returns the jets of d.
    """
    step = expm(companion(gain) * interval)
    error, path = start, [start[0]]
    for n, in_force in enumerate(weights[:-1]):
        inverse = np.linalg.inv(graph.laplacian(in_force))
        now, then = (inverse @ corruption(t * interval, in_force)[: len(gain)] for t in (n, n + 1))
        error = then + np.einsum("kl,lmx->kmx", step, error - now)
        path.append(error[0])
    return np.stack(path)


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
