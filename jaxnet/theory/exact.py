"""Exact solution of the closed loop for known kept sets (theorems.md O1 and O2).

`E_i = y_i - y_0` obeys `E‴ + k2 Ë + k1 Ė + k0 E = 0` around `G = L⁻¹ d`, so from t to t + h

    E(t + h) = G(t + h) + expm(A_c h) (E(t) - G(t)).
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm, solve_continuous_lyapunov

from jaxnet.model import graph

Weight = Float[np.ndarray, "r r"]
ErrorJets = Float[np.ndarray, "r m 2"]


PlaneGains = Float[np.ndarray, "*lanes r 2 2"] | Float[np.ndarray, "*lanes r"]


def companion(gain: PlaneGains) -> Float[np.ndarray, "*lanes n n"]:
    """Return the companion matrix `A_c` of one vehicle of order r and one axis, n = r.

    PlaneGains that are 2 × 2 matrices couple the axes: n = 2r, with the jets in the order of the paper's η.
    """
    if gain.ndim > 2:
        order = gain.shape[-3]
        last = -np.moveaxis(gain, -3, -2).reshape(*gain.shape[:-3], 2, -1)
        shift = np.kron(np.eye(order, k=1), np.eye(2))[:-2]
        return np.concatenate(
            [np.broadcast_to(shift, (*gain.shape[:-3], *shift.shape)), last], axis=-2
        )
    order = gain.shape[-1]
    matrix = np.broadcast_to(np.eye(order, k=1), (*gain.shape, order)).copy()
    matrix[..., -1, :] = -gain
    return matrix


def lyapunov_matrix(gain: PlaneGains, Q: Weight | None = None) -> Weight:
    """Return the solution `P` of `A_c'P + P A_c = -Q`; the default Q is the identity."""
    matrix = companion(gain)
    Q = np.eye(len(matrix)) if Q is None else Q
    return solve_continuous_lyapunov(matrix.T, -Q)


def decay_constants(gain: PlaneGains) -> tuple[float, float]:
    """Return c₁ and c₂ [1/s] of the paper's Lemma 1, `‖η(t)‖ ≤ c₁ e^(-c₂ t) ‖η(0)‖` without attack.

    `V = η'Pη` with Q = 1 falls at the rate 1/λ_max(P) at least, and `λ_min ‖η‖² ≤ V ≤ λ_max ‖η‖²`.
    """
    axes = np.linalg.eigvalsh(lyapunov_matrix(gain))
    return float(np.sqrt(axes[-1] / axes[0])), float(0.5 / axes[-1])


def backward_reach(gain: PlaneGains, interval: float) -> Float[np.ndarray, "lanes r"]:
    """Return bounds on the entries of the last row of `A_c expm(-A_c s)` for s from 0 to an interval [s].

    The last row gives the r-th derivative of E at earlier times from E and its lower derivatives now. Over a
    piece d of the interval, a row x grows to `|x| expm(|A_c| d)` at most, entry by entry. PlaneGains that are
    matrices have two last rows; the bounds are then the Frobenius norms of the rows' blocks.
    """
    matrix = companion(gain)
    pieces = int(np.clip(4 * np.abs(matrix).sum(axis=2).max() * interval, 8, 1_000))
    step, growth = (expm(each * interval / pieces) for each in (-matrix, np.abs(matrix)))
    lanes, order = gain.shape[:2]
    axes = matrix.shape[-1] // order
    rows = matrix[:, -axes:]
    greatest = np.zeros(rows.shape)
    for _ in range(pieces):
        greatest = np.maximum(greatest, np.einsum("nak,nkl->nal", np.abs(rows), growth))
        rows = np.einsum("nak,nkl->nal", rows, step)
    return np.linalg.norm(greatest.reshape(lanes, axes, order, axes), axis=(1, 3))


def tracking_errors(
    start: ErrorJets,
    corruption: Callable[[float, Float[np.ndarray, "m sources"]], ErrorJets],
    weights: Float[np.ndarray, "times m sources"],
    gain: Float[np.ndarray, "r"],
    interval: float,
) -> Float[np.ndarray, "times m 2"]:
    """Return `E` [m] at times 0, interval, 2 interval …

    `weights[n]` is in force from the n-th time to the next. `start` contains E and its derivatives below the
    order r at time 0.
    `corruption(t, weights)` returns the jets of d.
    """
    step = expm(companion(gain) * interval)
    error, path = start, [start[0]]
    for n, in_force in enumerate(weights[:-1]):
        inverse = np.linalg.inv(graph.laplacian(in_force))
        now, then = (inverse @ corruption(t * interval, in_force)[: len(gain)] for t in (n, n + 1))
        error = then + np.einsum("kl,lmx->kmx", step, error - now)
        path.append(error[0])
    return np.stack(path)
