"""Exact solution of the closed loop for known kept sets (theorems.md O1 and O2).

`E_i = y_i - y_0` obeys `E‴ + k2 Ë + k1 Ė + k0 E = 0` around `G = L⁻¹ d`, so from t to t + h

    E(t + h) = G(t + h) + expm(A_c h) (E(t) - G(t)).
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm

from jaxnet.model import graph

ErrorJets = Float[np.ndarray, "3 m 2"]


def companion(gain: Float[np.ndarray, "*lanes 3"]) -> Float[np.ndarray, "*lanes 3 3"]:
    """Return the companion matrix `A_c` of one vehicle and axis."""
    matrix = np.zeros((*gain.shape, 3))
    matrix[..., 0, 1] = matrix[..., 1, 2] = 1.0
    matrix[..., 2, :] = -gain
    return matrix


def backward_reach(gain: Float[np.ndarray, "lanes 3"], interval: float) -> Float[np.ndarray, "lanes 3"]:
    """Return bounds on the entries of the last row of `A_c expm(-A_c s)` for s from 0 to an interval [s].

    The last row gives E‴ at earlier times from E, Ė and Ë now. Over a piece d of the interval, a row r grows
    to `|r| expm(|A_c| d)` at most, entry by entry.
    """
    matrix = companion(gain)
    pieces = int(np.clip(4 * np.abs(matrix).sum(axis=2).max() * interval, 8, 1_000))
    step, growth = (expm(each * interval / pieces) for each in (-matrix, np.abs(matrix)))
    row, greatest = matrix[:, 2], np.zeros(gain.shape)
    for _ in range(pieces):
        greatest = np.maximum(greatest, np.einsum("nk,nkl->nl", np.abs(row), growth))
        row = np.einsum("nk,nkl->nl", row, step)
    return greatest


def tracking_errors(
    start: ErrorJets,
    corruption: Callable[[float, Float[np.ndarray, "m sources"]], ErrorJets],
    weights: Float[np.ndarray, "times m sources"],
    gain: Float[np.ndarray, "3"],
    interval: float,
) -> Float[np.ndarray, "times m 2"]:
    """Return `E` [m] at times 0, interval, 2 interval …

    `weights[n]` is in force from the n-th time to the next. `start` contains E, Ė and Ë at time 0.
    `corruption(t, weights)` returns the jets of d.
    """
    step = expm(companion(gain) * interval)
    error, path = start, [start[0]]
    for n, in_force in enumerate(weights[:-1]):
        inverse = np.linalg.inv(graph.laplacian(in_force))
        now, then = (inverse @ corruption(t * interval, in_force)[:3] for t in (n, n + 1))
        error = then + np.einsum("kl,lmx->kmx", step, error - now)
        path.append(error[0])
    return np.stack(path)
