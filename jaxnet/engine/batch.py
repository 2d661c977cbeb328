"""Simulation of many lanes: one compiled program per array shape and plan, fed load by load.

A program takes a load, a fixed number of lanes, and advances a chunk, a fixed number of lanes, side
by side. So a lane's result does not depend, to the last bit, on the other lanes or on their number.
Loads run in parallel, one per core or accelerator. Here the lanes are the first axis of every
array; within the engines the lanes are the last axis.
"""

import functools
import math
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from queue import SimpleQueue
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np
from jaxtyping import Array, Int

from jaxnet.engine.cores import cores
from jaxnet.engine.plan import Clock, Inputs, Outcome, Plan
from jaxnet.model import xla
from jaxnet.model.lane import Network

Lanes = TypeVar("Lanes")

TYPICAL_FLEET = 12  # vehicles in the fleet for which an engine states its chunk
CHOOSING = 16_000  # most vehicles side by side in a plan that chooses at ticks: more gain little
LEAST_CHUNK = 2
MOST_LANES = 2**32
SLOW_CHUNK = 8  # lanes side by side where vehicles decide inside the vector field
LATE_CHUNK = 64  # most lanes side by side where words are late, for each keeps its last words
COMPILING = set[int]()  # threads that compile a program
# Compiler options by platform. The gains are measured on two cores. Wider vectors
# (`xla_cpu_prefer_vector_width` of 512) are left out: XLA 0.10.2 then computes arctan wrongly.
COMPILER = {
    "cpu": {
        # Loops for sums of few terms, not XLA's library: 1.5 times, trimming, 1,000 vehicles.
        "xla_cpu_experimental_ynn_fusion_type": "",
        # A long sum in one pass: 1.02 times, trimming, 12 vehicles. Else sums end in other bits.
        "xla_disable_hlo_passes": "tree_reduction_rewriter",
    }
}


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
        to one that holds all lanes: more would be padding.
        """
        chunk = SLOW_CHUNK if plan.in_field else plan.engine.chunk
        chunk = min(chunk, LATE_CHUNK) if plan.late else chunk
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
    share = max(plan.chunk, -(-lanes // len(devices)))
    for device in devices:
        free.put(device)

    def run(load: Inputs) -> Outcome:
        device = free.get()
        try:
            return advance(load, network, clock, plan, capacity, device)
        finally:
            free.put(device)

    pool = ThreadPoolExecutor(len(devices))
    try:
        loads = parted(batches, min(capacity, share), sizes)
        outcomes = in_order(pool, run, loads, 2 * len(devices))
        yield from regrouped(reporting(outcomes, load_done), sizes)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def advance(
    load: Inputs, network: Network, clock: Clock, plan: Plan, capacity: int, device: Any
) -> Outcome:
    """The outcome of one load, in double precision whatever the process's default is."""
    count, queue = size(load), queue_of(load, capacity)
    with jax.enable_x64(True), jax.default_device(device):
        try:
            outcome = program(device.platform)(plan, network, clock, queue, count)
        finally:
            COMPILING.discard(threading.get_ident())
        return jax.tree.map(lambda leaf: np.moveaxis(np.asarray(leaf), -1, 0)[:count], outcome)


def queue_of(load: Inputs, capacity: int) -> Inputs:
    """The lanes of a load, filled up to its capacity, with the lanes last."""
    index = np.minimum(np.arange(capacity), size(load) - 1)
    return jax.tree.map(lambda leaf: np.moveaxis(np.asarray(leaf)[index], 0, -1), load)


def trace(job: Job, machine: Machine = EVERYTHING) -> None:
    """Trace the program of a job: kinds that break their contract are found before all compiling.

    A simulation on the same machine takes the trace from JAX's cache.
    """
    (inputs, network, clock, plan), device = job, machine.each()[0]
    plan, capacity = machine.load_of(plan, network, job.size)
    with jax.enable_x64(True), jax.default_device(device):
        try:
            traced: Any = program(device.platform)
            traced.trace(plan, network, clock, queue_of(inputs, capacity), job.size)
        finally:
            COMPILING.discard(threading.get_ident())


@functools.cache
def program(platform: str) -> Callable[[Plan, Network, Clock, Inputs, int], Outcome]:
    """The jitted program that runs a plan's engine on a platform."""

    def run(
        plan: Plan, network: Network, clock: Clock, queue: Inputs, count: Int[Array, ""] | int
    ) -> Outcome:
        COMPILING.add(
            threading.get_ident()
        )  # JAX runs this line only while tracing, before compilation
        # One loop around everything, compiled as one function: 1.02 times, plain, 12 vehicles.
        # Without it,
        # iteration over links ends in other bits.
        return xla.materialised(lambda: plan.engine.simulate(queue, count, network, clock, plan))

    return jax.jit(run, static_argnums=0, compiler_options=COMPILER.get(platform))


def compiling() -> bool:
    return bool(COMPILING)


def parted(batches: Iterable[Inputs], most: int, sizes: deque[int]) -> Iterator[Inputs]:
    """Yield lanes in loads of `most`, the last maybe smaller; append batch sizes to `sizes`."""
    waiting: list[Inputs] = []
    for batch in batches:
        sizes.append(size(batch))
        waiting.append(batch)
        while sum(map(size, waiting)) >= most:
            whole = joined(waiting)
            yield part(whole, 0, most)
            waiting = [part(whole, most, None)]
    if sum(map(size, waiting)):
        yield joined(waiting)


def in_order(
    pool: Executor, run: Callable[[Inputs], Outcome], loads: Iterable[Inputs], ahead: int
) -> Iterator[Outcome]:
    """Yield the outcomes of loads in order; at most `ahead` loads run or wait at a time."""
    under_way = deque[Future[Outcome]]()
    for load in loads:
        under_way.append(pool.submit(run, load))
        if len(under_way) == ahead:
            yield under_way.popleft().result()
    for future in under_way:
        yield future.result()


def reporting(outcomes: Iterable[Outcome], load_done: Callable[[int], None]) -> Iterator[Outcome]:
    """Yield the outcomes, and call `load_done` with the number of lanes in each."""
    for outcome in outcomes:
        load_done(len(outcome.status))
        yield outcome


def regrouped(outcomes: Iterable[Outcome], sizes: deque[int]) -> Iterator[Outcome]:
    held: list[Outcome] = []
    for outcome in outcomes:
        held.append(outcome)
        while sizes and sum(len(one.status) for one in held) >= sizes[0]:
            whole, first = joined(held), sizes.popleft()
            yield part(whole, 0, first)
            held = [part(whole, first, None)]


def size(batch: Inputs) -> int:
    return len(batch.lane.initial)


def joined(trees: Sequence[Lanes]) -> Lanes:
    return (
        jax.tree.map(lambda *leaves: np.concatenate(leaves), *trees) if len(trees) > 1 else trees[0]
    )


def part(tree: Lanes, start: int, stop: int | None) -> Lanes:
    return jax.tree.map(lambda leaf: leaf[start:stop], tree)
