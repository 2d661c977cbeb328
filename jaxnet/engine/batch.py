"""Many lanes at once: one compiled program per shape and choice of types, run chunk by chunk.

A chunk has a fixed width and is padded, so that a lane's result is the same to the last bit whatever lanes
stand beside it and however many there are. Chunks run beside each other, one to a core.
"""

import functools
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxnet.engine import chassis
from jaxnet.engine.stepper import Tolerances
from jaxnet.model.lane import Lane

CHUNK = 16


class Inputs(NamedTuple):
    """Everything about lanes that is a number; as a batch, every leaf has a leading axis over lanes."""

    lane: Lane
    clock: chassis.Clock
    tolerances: Tolerances


class Job(NamedTuple):
    """Lanes that one compiled program can run."""

    inputs: Inputs
    plan: chassis.Plan

    @property
    def size(self) -> int:
        """Number of lanes."""
        return len(self.inputs.lane.initial)


def join(jobs: Sequence[Job]) -> Job:
    """Jobs that share a program as one."""
    inputs = jax.tree.map(lambda *leaves: np.concatenate(leaves), *(job.inputs for job in jobs))
    return Job(inputs, jobs[0].plan)


def simulate(job: Job, chunk_done: Callable[[int], None] = lambda lanes: None) -> chassis.Outcome:
    """Outcomes with a leading axis over lanes, as NumPy arrays.

    `chunk_done` is told how many lanes each chunk brought to their end.
    """
    count, outcomes = job.size, []
    with ThreadPoolExecutor(os.cpu_count()) as cores:
        for outcome in cores.map(functools.partial(_advance, job.plan), _chunks(job)):
            outcomes.append(outcome)
            chunk_done(min(CHUNK, count - CHUNK * (len(outcomes) - 1)))
    return jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *outcomes)


def _advance(plan: chassis.Plan, inputs: Inputs) -> chassis.Outcome:
    """Outcome of one chunk, in double precision whatever the process's default is."""
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, _chunk(plan, inputs))


@functools.partial(jax.jit, static_argnums=0)
def _chunk(plan: chassis.Plan, inputs: Inputs) -> chassis.Outcome:
    def one(lane: Inputs) -> chassis.Outcome:
        return chassis.simulate(lane.lane, lane.clock, lane.tolerances, plan)

    return jax.vmap(one)(inputs)


def _chunks(job: Job) -> Iterator[Any]:
    """The inputs in pieces of CHUNK lanes, the last filled up with copies of its first lane."""
    for start in range(0, job.size, CHUNK):
        index = np.arange(start, start + CHUNK)
        index[index >= job.size] = start
        yield jax.tree.map(lambda leaf, index=index: np.asarray(leaf)[index], job.inputs)
