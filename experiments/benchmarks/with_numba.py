"""The same lanes by numba: compiled Dormand–Prince 5(4), eight lanes a vector, a thread a core.

Each lane has its own steps, which end at the output times. Cosine and sine are polynomials, because
the compiler calls a library for its own, one number at a time. The law is solved as `L⁻¹ (received
- L P)`. The import of this module raises NotInstalledError where numba is missing.
"""

import importlib
import math
from typing import Any

import numpy as np
from peers import ATOL, RTOL, NotInstalledError, Positions, output_times, side_by_side

from jaxnet.engine.batch import Job

try:
    nb: Any = importlib.import_module("numba")
except ImportError:
    raise NotInstalledError("numba") from None

WIDTH = 8  # lanes side by side
STAGES = np.array(
    [
        [1 / 5, 0, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
        [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
NODES = np.array([1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
ERROR = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
FAST = {"fastmath": True, "error_model": "numpy", "cache": False}


def with_numba(job: Job, tolerance: float = RTOL) -> Positions:
    """All lanes, `WIDTH` to a block, blocks in parallel."""
    filled = np.minimum(np.arange(-(-job.size // WIDTH) * WIDTH), job.size - 1)

    def block(each: np.ndarray) -> np.ndarray:
        each = each[filled]
        return np.ascontiguousarray(np.moveaxis(each.reshape(-1, WIDTH, *each.shape[1:]), 1, -1))

    atol = ATOL * tolerance / RTOL
    found = simulated(*map(block, side_by_side(job)), output_times(job), tolerance, atol)
    return (
        np.moveaxis(found, -1, 1)
        .reshape(len(filled), *found.shape[1:-1])[: job.size]
        .swapaxes(2, 3)
    )


@nb.njit(inline="always", **FAST)
def circle(angle):
    """Cosine and sine by the polynomials of fdlibm."""
    turns = math.floor(angle * 0.6366197723675814 + 0.5)
    rest = (
        angle - turns * 1.570796251296997 - turns * 7.549789415861596e-08
    ) - turns * 5.390302858158119e-15
    z = rest * rest
    c = -1.13596475577881948265e-11
    c = 2.08757232129817482790e-09 + z * c
    c = -2.75573143513906633035e-07 + z * c
    c = 2.48015872894767294178e-05 + z * c
    c = -1.38888888888741095749e-03 + z * c
    c = 4.16666666666666019037e-02 + z * c
    s = 1.58969099521155010221e-10
    s = -2.50507602534068634195e-08 + z * s
    s = 2.75573137070700676789e-06 + z * s
    s = -1.98412698298579493134e-04 + z * s
    s = 8.33333333332248946124e-03 + z * s
    s = -1.66666666666666324348e-01 + z * s
    cosine, sine = 1.0 - 0.5 * z + z * z * c, rest + rest * z * s
    quarter = turns - 4.0 * math.floor(turns * 0.25)
    odd = (quarter == 1.0) | (quarter == 3.0)
    across, up = (sine, cosine) if odd else (cosine, sine)
    across = -across if (quarter == 1.0) | (quarter == 2.0) else across
    return across, -up if quarter >= 2.0 else up


@nb.njit(**FAST)
def slopes(time, state, laplacian, inverse, gain, frequency, cosine, sine, waves, work, out):
    """`ẋ = f(t, x)` of a block of lanes; memory: `waves` (2, 3, WIDTH) and `work` (8, m, WIDTH)."""
    m = state.shape[1]
    c, s, ox, oy, dx, dy, along, left = work
    for n in range(3):
        for w in range(WIDTH):
            waves[0, n, w], waves[1, n, w] = circle(frequency[n, w] * time[w])
    for i in range(m):
        for w in range(WIDTH):
            c[i, w], s[i, w] = circle(state[2, i, w])
            v, o, f = state[3, i, w], state[4, i, w], state[5, i, w]
            forward = gain[1, w] * v + gain[2, w] * f
            sideways = gain[2, w] * v * o
            ox[i, w] = gain[0, w] * state[0, i, w] + forward * c[i, w] - sideways * s[i, w]
            oy[i, w] = gain[0, w] * state[1, i, w] + forward * s[i, w] + sideways * c[i, w]
            along[i, w], left[i, w] = -v * o * o, 2.0 * f * o
    for i in range(m):
        for w in range(WIDTH):
            dx[i, w] = dy[i, w] = 0.0
        for n in range(3):
            for w in range(WIDTH):
                dx[i, w] += cosine[n, 0, i, w] * waves[0, n, w] + sine[n, 0, i, w] * waves[1, n, w]
                dy[i, w] += cosine[n, 1, i, w] * waves[0, n, w] + sine[n, 1, i, w] * waves[1, n, w]
        for j in range(m):
            for w in range(WIDTH):
                dx[i, w] -= laplacian[i, j, w] * ox[j, w]
                dy[i, w] -= laplacian[i, j, w] * oy[j, w]
    for i in range(m):
        for w in range(WIDTH):
            ox[i, w] = oy[i, w] = 0.0
        for j in range(m):
            for w in range(WIDTH):
                ox[i, w] += inverse[i, j, w] * dx[j, w]
                oy[i, w] += inverse[i, j, w] * dy[j, w]
        for w in range(WIDTH):
            v, across, up = state[3, i, w], ox[i, w], oy[i, w]
            out[0, i, w], out[1, i, w] = v * c[i, w], v * s[i, w]
            out[2, i, w], out[3, i, w] = state[4, i, w], state[5, i, w]
            out[4, i, w] = (c[i, w] * up - s[i, w] * across - left[i, w]) / v
            out[5, i, w] = c[i, w] * across + s[i, w] * up - along[i, w]


@nb.njit(parallel=True, **FAST)
def simulated(initial, laplacian, inverse, gain, frequency, cosine, sine, times, rtol, atol):
    """Positions (blocks, times, 2, m, WIDTH)."""
    blocks, _, m, _ = initial.shape
    found = np.empty((blocks, len(times), 2, m, WIDTH))
    for block in nb.prange(blocks):
        known = (
            laplacian[block],
            inverse[block],
            gain[block],
            frequency[block],
            cosine[block],
            sine[block],
        )
        state, trial = initial[block].copy(), np.empty((6, m, WIDTH))
        k, work, waves = (
            np.empty((7, 6, m, WIDTH)),
            np.empty((8, m, WIDTH)),
            np.empty((2, 3, WIDTH)),
        )
        time, now, step = np.zeros(WIDTH), np.empty(WIDTH), np.full(WIDTH, 1e-3)
        used, error, missed = np.empty(WIDTH), np.empty(WIDTH), np.empty(WIDTH)
        slopes(time, state, *known, waves, work, k[0])
        found[block, 0] = state[:2]
        for number in range(1, len(times)):
            goal = times[number]
            while time.min() < goal:
                for w in range(WIDTH):
                    used[w] = min(step[w], goal - time[w])
                for stage in range(6):
                    for a in range(6):
                        for i in range(m):
                            for w in range(WIDTH):
                                trial[a, i, w] = STAGES[stage, 0] * k[0, a, i, w]
                            for before in range(1, stage + 1):
                                for w in range(WIDTH):
                                    trial[a, i, w] += STAGES[stage, before] * k[before, a, i, w]
                            for w in range(WIDTH):
                                trial[a, i, w] = state[a, i, w] + used[w] * trial[a, i, w]
                    for w in range(WIDTH):
                        now[w] = time[w] + NODES[stage] * used[w]
                    slopes(now, trial, *known, waves, work, k[stage + 1])
                for w in range(WIDTH):
                    error[w] = 0.0
                for a in range(6):
                    for i in range(m):
                        for w in range(WIDTH):
                            missed[w] = ERROR[0] * k[0, a, i, w]
                        for stage in range(2, 7):
                            for w in range(WIDTH):
                                missed[w] += ERROR[stage] * k[stage, a, i, w]
                        for w in range(WIDTH):
                            size = max(abs(state[a, i, w]), abs(trial[a, i, w]))
                            error[w] += (used[w] * missed[w] / (atol + rtol * size)) ** 2
                for w in range(WIDTH):
                    norm = math.sqrt(error[w] / (6 * m))
                    factor = min(10.0, max(0.2, 0.9 * (norm + 1e-30) ** -0.2))
                    kept = norm < 1.0
                    arrived = time[w] + used[w] >= goal
                    if kept and used[w] > 0.0:
                        time[w] = goal if arrived else time[w] + used[w]
                        for a in range(6):
                            for i in range(m):
                                state[a, i, w], k[0, a, i, w] = trial[a, i, w], k[6, a, i, w]
                    if not kept or (used[w] > 0.0 and (not arrived or factor * used[w] > step[w])):
                        step[w] = used[w] * factor
            found[block, number] = state[:2]
    return found
