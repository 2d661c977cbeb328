"""Motion of one vehicle's errors: `η̇ = A_c η`, by the gains of the law."""

import numpy as np
from jaxtyping import Float

PlaneGains = Float[np.ndarray, "*lanes r 2 2"] | Float[np.ndarray, "*lanes r"]


def companion(gain: PlaneGains) -> Float[np.ndarray, "*lanes n n"]:
    """Companion matrix `A_c` of one vehicle of order r and one axis, n = r.

    Gains that are 2 × 2 matrices couple the axes: n = 2r, jets in the paper's order of η.
    """
    if gain.ndim > 2:
        order = gain.shape[-3]
        last = -np.moveaxis(gain, -3, -2).reshape(*gain.shape[:-3], 2, -1)
        shift = np.kron(np.eye(order, k=1), np.eye(2))[:-2]
        above = np.broadcast_to(shift, (*gain.shape[:-3], *shift.shape))
        return np.concatenate([above, last], axis=-2)
    order = gain.shape[-1]
    matrix = np.broadcast_to(np.eye(order, k=1), (*gain.shape, order)).copy()
    matrix[..., -1, :] = -gain
    return matrix
