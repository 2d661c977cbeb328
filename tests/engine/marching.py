"""A slow, plain program for the closed loop under any rule: NumPy and scipy, nothing of the package.

Weights and attacks are chosen anew at every tick and held between; what an attacked link carries may be the
navigator's word instead of its source's. As in `tests.reference`, sources 0..m index columns.
"""

import numpy as np
from scipy.linalg import expm


def march(choose, carried, gain, start, interval, ticks):
    """E with two derivatives at every tick: (ticks + 1, 3, m, 2), from `start` (3, m, 2).

    `choose(n, error)` gives the weights (2, m, m+1) by axis in force from tick n on and `added`, a function
    of time [s] with the jets (3, m, m+1, 2) that attacks add to each link. `carried` (m, m+1) are the links
    that carry what their source says.
    """
    k0, k1, k2 = gain
    flow = expm(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-k0, -k1, -k2]]) * interval)
    path = [np.asarray(start, float)]
    for n in range(ticks):
        weights, added = choose(n, path[-1])
        now, then = (displaced(weights, carried, added(t * interval)) for t in (n, n + 1))
        path.append(then + np.einsum("kl,lmx->kmx", flow, path[-1] - now))
    return np.stack(path)


def displaced(weights, carried, added):
    """`(I - A_H)⁻¹ d` of each axis with its derivatives, (3, m, 2)."""
    found = np.empty((3, *weights.shape[1:2], 2))
    for axis in (0, 1):
        rows = weights[axis] / weights[axis].sum(axis=1, keepdims=True)
        believed = np.where(carried, rows, 0.0)[:, 1:]
        d = np.einsum("ij,kij->ki", rows, added[..., axis])
        found[..., axis] = np.linalg.solve(np.eye(len(rows)) - believed, d.T).T
    return found


def received(error, carried, added):
    """Jets relative to the navigator's that each vehicle receives of each source: (3, m, m+1, 2)."""
    sources = np.concatenate([np.zeros((3, 1, 2)), error], axis=1)
    return np.where(carried[None, :, :, None], sources[:, None], 0.0) + added
