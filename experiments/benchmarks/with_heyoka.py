"""The same lanes by heyoka.py: Taylor's method, compiled for the equations.

A vector holds as many lanes as the processor is wide, and each core has a thread. Every number that
is the same in all lanes is compiled into the equations. Output comes from the Taylor polynomials.
Laplacian and inverse are used as in `peers.py`: the law is solved as `L⁻¹ (received - L P)`.
"""

import copy
import importlib
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from jaxtyping import Float
from peers import RTOL, Fleet, NotInstalledError, Positions, output_times, side_by_side

from jaxnet.engine.batch import Job


def heyoka() -> Any:
    """The package; raises NotInstalledError where it is missing."""
    try:
        return importlib.import_module("heyoka")
    except ImportError:
        raise NotInstalledError("heyoka") from None


def with_heyoka(job: Job, tolerance: float = RTOL) -> Positions:
    """`propagate_grid` of lanes side by side, a thread for each core."""
    lanes, times = side_by_side(job), output_times(job)
    integrators, differs = compiled(lanes, tolerance)
    numbers = own_numbers(lanes, differs)
    width = integrators[0].state.shape[1]
    initial = lanes.initial.swapaxes(1, 2).reshape(job.size, -1)
    positions = np.empty((job.size, len(times), lanes.initial.shape[2], 2))
    grid = np.repeat(times[:, None], width, axis=1)

    def work(integrator: Any, starts: Sequence[int]) -> None:
        for start in starts:
            some = np.minimum(np.arange(start, start + width), job.size - 1)
            integrator.set_time(0.0)
            integrator.state[:] = initial[some].T
            integrator.pars[:] = numbers[some].T
            found = np.asarray(integrator.propagate_grid(grid)[1])  # (times, states, width)
            states = found.reshape(len(times), -1, 6, width)[:, :, :2]
            positions[some] = states.transpose(3, 0, 1, 2)

    every, threads = range(0, job.size, width), len(integrators)
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, integrators, [every[n::threads] for n in range(threads)]))
    return positions


KNOWN = dict[Any, tuple[list[Any], dict[str, np.ndarray]]]()


def compiled(lanes: Fleet, tolerance: float) -> tuple[list[Any], dict[str, np.ndarray]]:
    """An integrator for each core, compiled once, and which numbers it takes as parameters."""
    names = ("laplacian", "inverse", "gain", "frequency", "cosine", "sine")
    differs = {name: np.ptp(getattr(lanes, name), axis=0) > 0 for name in names}
    same = [getattr(lanes, name)[0, ~which].tobytes() for name, which in differs.items()]
    key = tolerance, *same, *(which.tobytes() for which in differs.values())
    if key not in KNOWN:
        hy = heyoka()
        state = np.ones((6 * lanes.initial.shape[2], hy.recommended_simd_size()))
        pars = np.zeros((sum(int(which.sum()) for which in differs.values()), state.shape[1]))
        equations = closed_loop(hy, Fleet(*(leaf[0] for leaf in lanes)), differs)
        one = hy.taylor_adaptive_batch(
            equations, state, tol=tolerance, pars=pars, compact_mode=True
        )
        KNOWN[key] = [copy.deepcopy(one) for _ in os.sched_getaffinity(0)], differs
    return KNOWN[key]


def own_numbers(lanes: Fleet, differs: dict[str, np.ndarray]) -> Float[np.ndarray, "lanes numbers"]:
    """The numbers of each lane that are not the same in all lanes."""
    return np.concatenate(
        [getattr(lanes, name)[:, which] for name, which in differs.items()], axis=1
    )


def closed_loop(hy: Any, lane: Fleet, differs: dict[str, np.ndarray]) -> list[tuple[Any, Any]]:
    """The equations of all vehicles, vehicle by vehicle."""
    known: dict[str, Any] = {}
    count = 0
    for name, which in differs.items():
        values = np.asarray(getattr(lane, name), object)
        for place in zip(*np.nonzero(which), strict=True):
            values[place] = hy.par[count]
            count += 1
        known[name] = values
    m, gain = lane.initial.shape[1], known["gain"]
    variables = hy.make_vars(
        *(f"{name}{i}" for i in range(m) for name in ("x", "y", "h", "v", "w", "f"))
    )
    vehicles = [variables[6 * i : 6 * i + 6] for i in range(m)]
    waves = [(hy.cos(rate * hy.time), hy.sin(rate * hy.time)) for rate in known["frequency"]]
    own, frames = [], []
    for x, y, heading, speed, turn, force in vehicles:
        c, s = hy.cos(heading), hy.sin(heading)
        velocity = speed * c, speed * s
        acceleration = force * c - speed * turn * s, force * s + speed * turn * c
        drift = (
            -2.0 * force * turn * s - speed * turn * turn * c,
            2.0 * force * turn * c - speed * turn * turn * s,
        )
        place = x, y
        own.append(
            [gain[0] * place[k] + gain[1] * velocity[k] + gain[2] * acceleration[k] for k in (0, 1)]
        )
        frames.append((c, s, drift))

    def total(terms: list[tuple[Any, Any]]) -> Any:
        return hy.sum(
            [factor * term for factor, term in terms if not is_zero(factor)] or [hy.expression(0.0)]
        )

    demand = [
        [
            total(
                [(known["cosine"][n, k, i], wave[0]) for n, wave in enumerate(waves)]
                + [(known["sine"][n, k, i], wave[1]) for n, wave in enumerate(waves)]
                + [(-known["laplacian"][i, j], own[j][k]) for j in range(m)]
            )
            for k in (0, 1)
        ]
        for i in range(m)
    ]
    equations = []
    for i, (x, y, heading, speed, turn, force) in enumerate(vehicles):
        c, s, drift = frames[i]
        across, up = (
            total([(known["inverse"][i, j], demand[j][k]) for j in range(m)]) - drift[k]
            for k in (0, 1)
        )
        equations += [
            (x, speed * c),
            (y, speed * s),
            (heading, turn),
            (speed, force),
            (turn, (c * up - s * across) / speed),
            (force, c * across + s * up),
        ]
    return equations


def is_zero(number: Any) -> bool:
    """Whether a factor is the number 0."""
    return isinstance(number, float) and number == 0.0
