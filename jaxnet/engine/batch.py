"""Simulation of many lanes: one compiled program per array shape and plan, fed load by load.

A program takes a load, a fixed number of lanes, and advances a chunk, a fixed number of lanes, side
by side. So a lane's result does not depend, to the last bit, on the other lanes or on their number.
Loads run in parallel, one per core or accelerator. Here the lanes are the first axis of every
array; within the engines the lanes are the last axis.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from queue import SimpleQueue
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np

from jaxnet.engine import programs
from jaxnet.engine.cores import cores
from jaxnet.engine.plan import Clock, Inputs, Outcome, Plan
from jaxnet.model.lane import Network

Lanes = TypeVar("Lanes")  # of arrays whose first axis is lanes

TYPICAL_FLEET = 12  # vehicles in the fleet for which an engine states its chunk
CHOOSING = 8_000  # most vehicles side by side in a plan that chooses at ticks, for the cache
LEAST_CHUNK = 2
MOST_LANES = 2**32
SLOW_CHUNK = 8  # lanes side by side where vehicles decide inside the vector field
REMEMBERING_CHUNK = 64  # most lanes side by side where each link has a history or an estimate
# On accelerators: as many lanes side by side as have work for all its units, where memory allows.
ACCELERATOR_CHUNK = 2**17
VEHICLE_BYTES = 4_096  # at most, of a vehicle in a lane: 240 to 1,500 are measured
SAVED_BYTES = 64  # of a vehicle in a row of a saved series: at most eight numbers
LEAST_MEMORY = 2**33  # bytes of an accelerator that does not tell its own


class Job(NamedTuple):
    """Lanes of one network and clock for one compiled program; in `inputs` lanes come first."""

    inputs: Inputs
    network: Network
    clock: Clock
    plan: Plan

    @property
    def size(self) -> int:
        return size(self.inputs)


class Machine(NamedTuple):
    """Devices and chunk size that a simulation uses."""

    devices: int | None = None  # accelerators, or cores where the machine has none; None: all
    chunk: int | None = None  # lanes side by side; None: the engine's own number

    def each(self) -> list[Any]:
        """One device per concurrent load: each accelerator, or the CPU once for each core."""
        there = jax.local_devices()
        if there[0].platform == "cpu":
            there = there[:1] * cores()
        return there[: self.devices]

    def width(self, plan: Plan, vehicles: int, lanes: int = MOST_LANES) -> int:
        """The number of lanes side by side: `chunk` if given, else a power of two.

        Above twelve vehicles the power falls as one over the root of the fleet size. The engine's
        `cached` bounds the number of vehicles side by side. A given chunk is cut to the power, or
        to one that holds all lanes: more would be padding. An accelerator has all lanes side by
        side that half of its memory holds.
        """
        device = self.each()[0]
        if device.platform != "cpu":
            saved = SAVED_BYTES * plan.rows * len(plan.save)
            memory = (device.memory_stats() or {}).get("bytes_limit", LEAST_MEMORY) / 2
            held = max(LEAST_CHUNK, memory / (vehicles * (VEHICLE_BYTES + saved)))
            most = min(self.chunk or ACCELERATOR_CHUNK, 2 ** math.floor(math.log2(held)))
            return min(most, 2 ** math.ceil(math.log2(max(LEAST_CHUNK, lanes))))
        chunk = SLOW_CHUNK if plan.in_field else plan.engine.chunk
        chunk = min(chunk, REMEMBERING_CHUNK) if plan.late or plan.estimates else chunk
        cached = min(plan.engine.cached, CHOOSING if plan.choosing else math.inf)
        few = min(
            chunk * math.sqrt(TYPICAL_FLEET / max(TYPICAL_FLEET, vehicles)), cached / vehicles
        )
        own = max(LEAST_CHUNK, 2 ** math.ceil(math.log2(few)))
        return min(self.chunk, max(own, 2 ** math.ceil(math.log2(lanes)))) if self.chunk else own

    def load_of(self, plan: Plan, network: Network, lanes: int) -> tuple[Plan, int]:
        """The plan with its width, and the number of lanes of a load."""
        plan = plan._replace(chunk=self.width(plan, network.hearing.sources.shape[1], lanes))
        return plan, plan.chunk * (1 if plan.save else plan.engine.queue)


EVERYTHING = Machine()


def simulate(job: Job, machine: Machine = EVERYTHING) -> Outcome:
    """Simulate the lanes of a job. Return NumPy arrays with a leading axis over lanes."""
    return next(simulate_each([job.inputs], job.size, job.network, job.clock, job.plan, machine))


def simulate_each(
    batches: Iterable[Inputs],
    lanes: int,
    network: Network,
    clock: Clock,
    plan: Plan,
    machine: Machine = EVERYTHING,
    load_done: Callable[[int], None] = lambda lanes: None,
) -> Iterator[Outcome]:
    """Yield the outcome of each batch, in order; `lanes` is the number of lanes of all batches.

    The iterable is read as devices become free, so few batches are in memory at a time. `load_done`
    is called after each load with the number of lanes in that load.
    """
    devices, free, sizes = machine.each(), SimpleQueue[Any](), deque[int]()
    plan, capacity = machine.load_of(plan, network, lanes)
    most = min(capacity, max(plan.chunk, -(-lanes // len(devices))))
    for device in devices:
        free.put(device)

    def measured() -> Iterator[Inputs]:
        for batch in batches:
            sizes.append(size(batch))
            yield batch

    def run(load: Inputs) -> Outcome:
        device, count, queue = free.get(), size(load), queue_of(load, capacity)
        try:
            with programs.computing_on(device):
                outcome = programs.advance_load(plan, (network, clock, queue, count), device)
                each = jax.tree.map(np.asarray, outcome)
                return jax.tree.map(lambda leaf: np.moveaxis(leaf, -1, 0)[:count], each)
        finally:
            free.put(device)

    def finished(load: Future[Outcome]) -> Outcome:
        outcome = load.result()
        load_done(size(outcome))
        return outcome

    def outcomes() -> Iterator[Outcome]:
        """Outcomes of loads in order; few loads run or wait at a time."""
        under_way = deque[Future[Outcome]]()
        for load in regrouped(measured(), lambda: most):
            under_way.append(pool.submit(run, load))
            if len(under_way) == 2 * len(devices):
                yield finished(under_way.popleft())
        yield from map(finished, under_way)

    pool = ThreadPoolExecutor(len(devices))
    try:
        yield from regrouped(outcomes(), lambda: sizes.popleft() if sizes else None)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def queue_of(load: Inputs, capacity: int) -> Inputs:
    """The lanes of a load, filled up to its capacity, with the lanes last."""
    index = np.minimum(np.arange(capacity), size(load) - 1)
    return jax.tree.map(lambda leaf: np.moveaxis(np.asarray(leaf)[index], 0, -1), load)


def trace(job: Job, machine: Machine = EVERYTHING) -> None:
    """Trace the program of a job: kinds that break their contract are found before all compiling.

    A simulation on the same machine needs no second trace.
    """
    (inputs, network, clock, plan), device = job, machine.each()[0]
    plan, capacity = machine.load_of(plan, network, job.size)
    with programs.computing_on(device):
        programs.trace_program(plan, (network, clock, queue_of(inputs, capacity), job.size))


def regrouped(trees: Iterable[Lanes], next_size: Callable[[], int | None]) -> Iterator[Lanes]:
    """Yield the lanes of a stream again in groups of other sizes, and then what is left.

    `next_size` may give None until more of the stream is read.
    """
    held, wanted = list[Lanes](), None
    for tree in trees:
        held.append(tree)
        wanted = wanted or next_size()
        while wanted and sum(map(size, held)) >= wanted:
            whole = joined(held)
            yield part(whole, 0, wanted)
            held, wanted = [part(whole, wanted, None)], next_size()
    if sum(map(size, held)):
        yield joined(held)


def size(tree: Any) -> int:
    """Lanes of a batch or of an outcome."""
    return len(jax.tree.leaves(tree)[0])


def joined(trees: Sequence[Lanes]) -> Lanes:
    if len(trees) == 1:
        return trees[0]
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *trees)


def part(tree: Lanes, start: int, stop: int | None) -> Lanes:
    return jax.tree.map(lambda leaf: leaf[start:stop], tree)
