"""Motion of one vehicle's errors: `η̇ = A_c η`, by the gains of the law."""

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm

PlaneGains = Float[np.ndarray, "*lanes r 2 2"] | Float[np.ndarray, "*lanes r"]


def companion(gain: PlaneGains) -> Float[np.ndarray, "*lanes n n"]:
    """Companion matrix `A_c` of one vehicle of order r and one axis, n = r.

    PlaneGains that are 2 × 2 matrices couple the axes: n = 2r, jets in the paper's order of η.
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


def backward_reach(gain: PlaneGains, interval: float) -> Float[np.ndarray, "lanes r"]:
    """Bounds on the entries of the last row of `A_c expm(-A_c s)` for s from 0 to an interval [s].

    The last row gives the r-th derivative of E at earlier times from E and its lower derivatives
    now. Over a piece d of the interval, a row x grows to `|x| expm(|A_c| d)` at most, entry by
    entry. PlaneGains that are matrices have two last rows; the bounds are then the Frobenius norms
    of the rows' blocks.
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
