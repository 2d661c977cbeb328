"""A slow, plain reference for the closed loop: NumPy and scipy.linalg.expm, nothing else.

It shares no code with the package and exists to be compared with it. The law cancels the robots'
dynamics exactly, so with E = y - y_0 and the weights held over an interval of length h,

    E(t + h) = G(t + h) + expm(A_c h) (E(t) - G(t)),    G^(k) = L_res^{-1} d^(k),
    d_i^(k) = sum_j w_ij a_ij^(k),                      L_res = I - A_res,

for the stacked jets (E, E', E''). There is no integrator and hence no step size to worry about.

Conventions: sources are numbered 0..m (0 is the navigator) and index the columns of `weights`;
vehicles are numbered 1..m and row i - 1 of any array over vehicles belongs to vehicle i. Jets come
first: index k of axis 0 is the k-th time derivative. The last axis is x, y.
"""

import functools
import math

import numpy as np
from scipy.linalg import expm


def propagate(
    weights,
    navigator,
    attack,
    gain,
    initial,
    tick,
    ticks,
    trusted=None,
    theta=None,
    tolerance=1e-9,
):
    """Exact tick-by-tick propagation of the closed loop (theorems.md O2).

    Decisions are taken at ticks 0..ticks inclusive and held in between. `navigator(t)` gives
    (4, 2) and `attack(t)` (4, m, m+1, 2), of which derivatives 0..2 are used; `initial` is
    (3, m, 2). `trusted` is None (no trimming) or a list of m sets of source numbers, `theta` a
    list of m ints. Returns a dict of `positions`, `velocities`, `accelerations` (ticks+1, m, 2),
    `kept` (ticks+1, m, m+1), the weights in force after each decision, and `margin` (ticks+1,),
    the gap between the lowest dropped and the highest kept untrusted score (inf: nothing to
    compare). A kept set that cuts a vehicle off raises numpy.linalg.LinAlgError.
    """
    weights = np.asarray(weights, dtype=float)
    m = weights.shape[0]
    flow = expm(_companion(gain) * tick)

    states = np.empty((ticks + 1, 3, m, 2))
    kept = np.empty((ticks + 1, m, m + 1))
    margin = np.full(ticks + 1, math.inf)

    dropped = [set() for _ in range(m)]  # nothing was dropped before tick 0
    error = np.asarray(initial, dtype=float) - np.asarray(navigator(0.0))[:3, None, :]
    lies = np.asarray(attack(0.0))
    for n in range(ticks + 1):
        reference = np.asarray(navigator(n * tick))[:3]
        states[n] = error + reference[:, None, :]

        # Decide.
        kept[n] = weights
        if trusted is not None:
            sources = np.vstack([reference[0], states[n, 0]])  # true positions of 0..m
            for i in range(1, m + 1):
                row, dropped[i - 1], gap = _trim(
                    weights[i - 1],
                    sources + lies[0, i - 1],
                    trusted[i - 1],
                    theta[i - 1],
                    dropped[i - 1],
                    tolerance,
                )
                kept[n, i - 1] = row
                margin[n] = min(margin[n], gap)

        # Move on to the next tick, with the weights just decided at both ends of the interval.
        if n < ticks:
            before, lies = _displacement(kept[n], lies), np.asarray(attack((n + 1) * tick))
            error = _displacement(kept[n], lies) + _apply(flow, error - before)

    return {
        "positions": states[:, 0],
        "velocities": states[:, 1],
        "accelerations": states[:, 2],
        "kept": kept,
        "margin": margin,
    }


def _trim(row, received, trusted, theta, dropped_before, tolerance):
    """One vehicle's decision: (weights in force, set of dropped sources, margin).

    `row` (m+1,) are its weights, `received` (m+1, 2) the positions that it hears.
    """
    heard = [j for j in range(len(row)) if row[j] > 0]
    heard_trusted = [j for j in heard if j in trusted]
    untrusted = [j for j in heard if j not in trusted]
    protected = len(heard) >= 2 * theta + 1 and len(heard_trusted) >= theta
    if theta == 0 or not protected:
        return row.copy(), set(), math.inf

    score = {}
    for k in untrusted:
        total = 0.0
        for j in heard_trusted:
            total += math.hypot(*(received[j] - received[k]))
        score[k] = total / len(heard_trusted)
        if k in dropped_before:
            score[k] += tolerance

    # Largest score first; among equal scores the lower number first. A slice never takes more
    # than the untrusted neighbours that there are.
    order = sorted(untrusted, key=lambda k: (-score[k], k))
    drop, keep = order[:theta], order[theta:]
    gap = score[drop[-1]] - score[keep[0]] if drop and keep else math.inf

    result = row.copy()
    for k in drop:
        result[k] = 0.0
    return result / result.sum(), set(drop), gap


def _displacement(weights, attack):
    """G and its first two derivatives, (3, m, 2), for weights (m, m+1) and one time's attack."""
    d = np.einsum("ij,kijx->kix", weights, attack[:3])
    return np.linalg.solve(np.eye(len(weights)) - weights[:, 1:], d)


def _companion(gain):
    """Companion matrix of s^3 + k2 s^2 + k1 s + k0, acting on (E, E', E'')."""
    k0, k1, k2 = gain
    return np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-k0, -k1, -k2]])


@functools.cache
def _flows(k0, k1, k2, *times):
    """Flows of (E, E', E'') over these times, which lanes of the same gain share: (times, 3, 3)."""
    return expm(_companion((k0, k1, k2)) * np.asarray(times)[:, None, None])


def _apply(flow, jets):
    """A (3, 3) flow applied to the jets (3, m, 2) of every vehicle and axis alike."""
    return np.einsum("kl,lmx->kmx", flow, jets)


def nominal(navigator, gain, initial, times):
    """O1: positions (len(times), m, 2) without attack, by expm; `initial` is at t = 0."""
    error = np.asarray(initial, dtype=float) - np.asarray(navigator(0.0))[:3, None, :]
    flows = _flows(*map(float, gain), *map(float, times))
    paths = np.asarray(navigator(np.asarray(times)))[0].T
    return paths[:, None] + np.einsum("tl,lmx->tmx", flows[:, 0], error)


def flat_jets(state):
    """(m, 6) robot states [x, y, θ, v, ω, F] -> (3, m, 2) jets y, ẏ, ÿ."""
    jets = np.empty((3, len(state), 2))
    for i, (x, y, heading, speed, turn_rate, force) in enumerate(state):
        along = np.array([math.cos(heading), math.sin(heading)])
        across = np.array([-math.sin(heading), math.cos(heading)])
        jets[0, i] = x, y
        jets[1, i] = speed * along
        jets[2, i] = force * along + speed * turn_rate * across
    return jets
