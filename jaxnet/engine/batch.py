"""Many lanes at once: one compiled program per shape and choice of types, run chunk by chunk.

A chunk has a fixed width and is padded, so that a lane's result is the same to the last bit whatever lanes
stand beside it and however many there are. Chunks run beside each other, one to a core.
"""

import functools
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import numpy as np

from jaxnet.engine import chassis
from jaxnet.engine.stepper import Tolerances
from jaxnet.model.lane import Batch

CHUNK = 16


def simulate(
    lanes: Batch,
    clock: chassis.Clock,
    tolerances: Tolerances,
    plan: chassis.Plan,
    chunk_done: Callable[[int], None] = lambda lanes: None,
) -> chassis.Outcome:
    """Outcomes of lanes (leading axis on every leaf of the first three arguments), as NumPy arrays.

    `chunk_done` is told how many lanes each chunk brought to their end.
    """
    count, outcomes = len(lanes.initial), []
    with ThreadPoolExecutor(os.cpu_count()) as cores:
        chunks = _chunks((lanes, clock, tolerances))
        for outcome in cores.map(functools.partial(_advance, plan), chunks):
            outcomes.append(outcome)
            chunk_done(min(CHUNK, count - CHUNK * (len(outcomes) - 1)))
    return jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *outcomes)


def _advance(plan: chassis.Plan, chunk: Any) -> chassis.Outcome:
    """Outcome of one chunk, in double precision whatever the process's default is."""
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, _chunk(plan, *chunk))


@functools.partial(jax.jit, static_argnums=0)
def _chunk(plan: chassis.Plan, lanes: Batch, clock: Any, tolerances: Any) -> chassis.Outcome:
    return jax.vmap(lambda *lane: chassis.simulate(*lane, plan))(lanes, clock, tolerances)


def _chunks(inputs: Any) -> Iterator[Any]:
    """The inputs in pieces of CHUNK lanes, the last filled up with copies of its first lane."""
    count = len(jax.tree.leaves(inputs)[0])
    for start in range(0, count, CHUNK):
        index = np.arange(start, start + CHUNK)
        index[index >= count] = start
        yield jax.tree.map(lambda leaf, index=index: np.asarray(leaf)[index], inputs)
