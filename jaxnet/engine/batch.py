"""Many lanes at once: one compiled program per shape and choice of types, run chunk by chunk.

A chunk has a fixed width and is padded, so that a lane's result is the same to the last bit whatever lanes
stand beside it and however many there are. Chunks run beside each other, one to a core. Here lanes are the
first axis of every array; within the engines they are the last.
"""

import functools
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxnet.engine import chassis, flat
from jaxnet.engine.plan import Clock, Outcome, Plan
from jaxnet.model.lane import Lane, Network

CHUNKS = {"chassis": 16, "flat": 256}  # lanes, with fleets of ROOM vehicles; fewer of larger ones
SLOW_CHUNK = 8  # lanes that decide inside the vector field
ROOM = 12
ENGINES: dict[str, Any] = {"chassis": chassis.simulate, "flat": flat.simulate}


class Inputs(NamedTuple):
    """Everything about lanes that is a number; as a batch, every leaf has a leading axis over lanes."""

    lane: Lane
    clock: Clock
    numbers: Any  # of the engine: its tolerances, or its flow


class Job(NamedTuple):
    """Lanes of one network that one compiled program can run."""

    inputs: Inputs
    network: Network
    plan: Plan

    @property
    def size(self) -> int:
        """Number of lanes."""
        return len(self.inputs.lane.initial)

    @property
    def chunk(self) -> int:
        """Lanes advanced together."""
        vehicles = self.inputs.lane.initial.shape[2]
        if self.plan.in_field:
            return SLOW_CHUNK
        return max(4, CHUNKS[self.plan.engine] * ROOM // max(ROOM, vehicles))


def join(jobs: Sequence[Job]) -> Job:
    """Jobs that share a program and a network as one."""
    inputs = jax.tree.map(lambda *leaves: np.concatenate(leaves), *(job.inputs for job in jobs))
    return jobs[0]._replace(inputs=inputs)


def simulate(job: Job, chunk_done: Callable[[int], None] = lambda lanes: None) -> Outcome:
    """Outcomes with a leading axis over lanes, as NumPy arrays.

    `chunk_done` is told how many lanes each chunk brought to their end.
    """
    count, chunk, outcomes = job.size, job.chunk, []
    with ThreadPoolExecutor(os.cpu_count()) as cores:
        for outcome in cores.map(functools.partial(_advance, job.plan, job.network), _chunks(job)):
            outcomes.append(outcome)
            chunk_done(min(chunk, count - chunk * (len(outcomes) - 1)))
    return jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *outcomes)


def _advance(plan: Plan, network: Network, inputs: Inputs) -> Outcome:
    """Outcome of one chunk, in double precision whatever the process's default is."""
    with jax.enable_x64(True):
        return jax.tree.map(lambda leaf: np.moveaxis(np.asarray(leaf), -1, 0), _chunk(plan, network, inputs))


@functools.partial(jax.jit, static_argnums=0)
def _chunk(plan: Plan, network: Network, inputs: Inputs) -> Outcome:
    return ENGINES[plan.engine](inputs.lane, network, inputs.clock, inputs.numbers, plan)


def _chunks(job: Job) -> Iterator[Inputs]:
    """The inputs in chunks, lanes last, the last one filled up with copies of its first lane."""
    for start in range(0, job.size, job.chunk):
        index = np.arange(start, start + job.chunk)
        index[index >= job.size] = start
        yield jax.tree.map(lambda leaf, i=index: np.moveaxis(np.asarray(leaf)[i], 0, -1), job.inputs)
