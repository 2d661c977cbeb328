"""The same lanes by heyoka.py: Taylor's method, compiled for the equations.

A vector holds as many lanes as the processor is wide, and each core has a thread. Every number that is the
same in all lanes is compiled into the equations. Output comes from the Taylor polynomials. Laplacian and
inverse are used as in `peers.py`: the law is solved as `L⁻¹ (received - L P)`.
"""

import copy
import functools
import importlib
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from peers import Fleet, NotInstalledError, Positions, fleets, output_times

from jaxnet.engine.batch import Job


def heyoka() -> Any:
    """The package; raises NotInstalledError where it is missing."""
    try:
        return importlib.import_module("heyoka")
    except ImportError:
        raise NotInstalledError("heyoka") from None


def with_heyoka(job: Job, tolerance: float = 1e-7) -> Positions:
    """`propagate_grid` of lanes side by side, a thread for each core."""
    hy, lanes, times = heyoka(), fleets(job), output_times(job)
    width = hy.recommended_simd_size()
    integrators, numbers_of = compiled(job, tolerance)
    starts = range(0, len(lanes), width)
    positions = np.empty((len(lanes), len(times), 2, lanes[0].initial.shape[1]))
    grid = np.repeat(times[:, None], width, axis=1)

    def work(integrator: Any, own: Sequence[int]) -> None:
        for start in own:
            some = [lanes[min(start + n, len(lanes) - 1)] for n in range(width)]
            integrator.set_time(0.0)
            integrator.state[:] = np.stack([lane.initial.T.ravel() for lane in some], axis=1)
            integrator.pars[:] = np.stack([numbers_of(lane) for lane in some], axis=1)
            found = np.asarray(integrator.propagate_grid(grid)[1])  # (times, states, width)
            states = found.reshape(len(times), -1, 6, width)[:, :, :2]
            many = min(width, len(lanes) - start)
            positions[start : start + many] = states.transpose(3, 0, 2, 1)[:many]

    with ThreadPoolExecutor(len(integrators)) as pool:
        list(pool.map(work, integrators, [starts[n :: len(integrators)] for n in range(len(integrators))]))
    return positions.swapaxes(2, 3)


KNOWN = dict[Any, tuple[list[Any], Callable[[Fleet], np.ndarray]]]()


def compiled(job: Job, tolerance: float) -> tuple[list[Any], Callable[[Fleet], np.ndarray]]:
    """An integrator for each core, compiled once, and the numbers of a lane that it takes as parameters."""
    hy, (first, *others) = heyoka(), fleets(job)
    differs = {
        name: np.any([getattr(lane, name) != getattr(first, name) for lane in others[:200]], axis=0)
        for name in ("laplacian", "inverse", "gain", "frequency", "cosine", "sine")
    }
    key = tolerance, *((name, which.tobytes()) for name, which in differs.items())
    if key not in KNOWN:
        equations = closed_loop(hy, first, differs)
        width = hy.recommended_simd_size()
        state = np.ones((6 * first.initial.shape[1], width))
        pars = np.zeros((sum(int(which.sum()) for which in differs.values()), width))
        one = hy.taylor_adaptive_batch(equations, state, tol=tolerance, pars=pars, compact_mode=True)
        threads = len(os.sched_getaffinity(0))
        KNOWN[key] = [copy.deepcopy(one) for _ in range(threads)], functools.partial(own_numbers, differs)
    return KNOWN[key]


def own_numbers(differs: dict[str, np.ndarray], lane: Fleet) -> np.ndarray:
    """The numbers of a lane that are not the same in all lanes."""
    return np.concatenate([getattr(lane, name)[which] for name, which in differs.items()])


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
    variables = hy.make_vars(*(f"{name}{i}" for i in range(m) for name in ("x", "y", "h", "v", "w", "f")))
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
        own.append([gain[0] * place[k] + gain[1] * velocity[k] + gain[2] * acceleration[k] for k in (0, 1)])
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
            total([(known["inverse"][i, j], demand[j][k]) for j in range(m)]) - drift[k] for k in (0, 1)
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
