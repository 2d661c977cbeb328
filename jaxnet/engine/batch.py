"""Many lanes at once: one compiled program per shape and choice of types, fed load by load.

A program takes a fixed number of lanes and advances a fixed number of them side by side, a chunk, so that a
lane's result is the same to the last bit whatever lanes are beside it and however many there are. Loads run
beside each other, one to a core or accelerator. Here lanes are the first axis of every array; within the
engines they are the last.
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

from jaxnet.engine.cores import cores
from jaxnet.engine.plan import Clock, Inputs, Outcome, Plan
from jaxnet.model import xla
from jaxnet.model.lane import Network

Lanes = TypeVar("Lanes")

TYPICAL_FLEET = 12  # vehicles, of which an engine takes its chunk of lanes side by side
CHOOSING = 16_000  # vehicles of all lanes side by side where anybody chooses at ticks: more gain little
LEAST_CHUNK = 2
SLOW_CHUNK = 8  # lanes side by side that decide inside the vector field
COMPILING = set[int]()  # threads that are about it
# Options by platform. Sums of few terms are quicker in loops than by the library that XLA has for sums.
# Long sums of whole numbers are quicker in one pass than in the several that XLA makes of them.
COMPILER = {
    "cpu": {
        "xla_cpu_prefer_vector_width": 512,
        "xla_cpu_experimental_ynn_fusion_type": "",
        "xla_disable_hlo_passes": "tree_reduction_rewriter",
    }
}


class Job(NamedTuple):
    """Lanes of one network and clock, for one compiled program; every leaf of the inputs has lanes first."""

    inputs: Inputs
    network: Network
    clock: Clock
    plan: Plan

    @property
    def size(self) -> int:
        """Number of lanes."""
        return size(self.inputs)


class Machine(NamedTuple):
    """What lanes run on."""

    devices: int | None = None  # cores, or accelerators where there are any; None: all
    chunk: int | None = None  # lanes side by side; None: what suits the engine

    def each(self) -> list[Any]:
        """A device for each load under way: an accelerator, or the CPU once for each core."""
        there = jax.local_devices()
        if there[0].platform == "cpu":
            there = there[:1] * cores()
        return there[: self.devices]

    def width(self, plan: Plan, vehicles: int) -> int:
        """Lanes side by side: of larger fleets fewer, about as the root of their size, a power of two."""
        if self.chunk:
            return self.chunk
        chunk = SLOW_CHUNK if plan.in_field else plan.engine.chunk
        cached = min(plan.engine.cached, CHOOSING if plan.choosing else math.inf)
        few = min(chunk * math.sqrt(TYPICAL_FLEET / max(TYPICAL_FLEET, vehicles)), cached / vehicles)
        return max(LEAST_CHUNK, 2 ** math.ceil(math.log2(few)))


EVERYTHING = Machine()


def simulate(job: Job, machine: Machine = EVERYTHING) -> Outcome:
    """Outcome of a job's lanes: NumPy arrays with a leading axis over lanes."""
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
    """Outcome of each of some batches with `lanes` in all, in order.

    Batches are taken from the iterable as devices become free, so that few are held at a time.
    `load_done` is told how many lanes each load has brought to their end.
    """
    devices, free, sizes = machine.each(), SimpleQueue[Any](), deque[int]()
    plan = plan._replace(chunk=machine.width(plan, network.hearing.sources.shape[1]))
    capacity = plan.chunk * (1 if plan.save else plan.engine.queue)
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


def advance(load: Inputs, network: Network, clock: Clock, plan: Plan, capacity: int, device: Any) -> Outcome:
    """Outcome of one load, in double precision whatever the process's default is."""
    count = size(load)
    index = np.minimum(np.arange(capacity), count - 1)
    queue = jax.tree.map(lambda leaf: np.moveaxis(np.asarray(leaf)[index], 0, -1), load)
    with jax.enable_x64(True), jax.default_device(device):
        try:
            outcome = program(device.platform)(plan, network, clock, queue, count)
        finally:
            COMPILING.discard(threading.get_ident())
        return jax.tree.map(lambda leaf: np.moveaxis(np.asarray(leaf), -1, 0)[:count], outcome)


@functools.cache
def program(platform: str) -> Callable[[Plan, Network, Clock, Inputs, int], Outcome]:
    """The engines, compiled for a platform."""

    def run(plan: Plan, network: Network, clock: Clock, queue: Inputs, count: Any) -> Outcome:
        COMPILING.add(threading.get_ident())  # JAX traces it to compile it, and never else comes here
        # All of it is one loop, that XLA may compile it as one function, which other loads do not disturb.
        return xla.materialised(lambda: plan.engine.simulate(queue, count, network, clock, plan))

    return jax.jit(run, static_argnums=0, compiler_options=COMPILER.get(platform))


def compiling() -> bool:
    """Whether a program is being compiled."""
    return bool(COMPILING)


def parted(batches: Iterable[Inputs], most: int, sizes: deque[int]) -> Iterator[Inputs]:
    """The lanes of batches in loads of `most`, the last one smaller; `sizes` is told those of the batches."""
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
    """Outcomes of loads in their order; so many loads are under way or wait at a time."""
    under_way = deque[Future[Outcome]]()
    for load in loads:
        under_way.append(pool.submit(run, load))
        if len(under_way) == ahead:
            yield under_way.popleft().result()
    for future in under_way:
        yield future.result()


def reporting(outcomes: Iterable[Outcome], load_done: Callable[[int], None]) -> Iterator[Outcome]:
    """The outcomes, of whose lanes `load_done` is told."""
    for outcome in outcomes:
        load_done(len(outcome.status))
        yield outcome


def regrouped(outcomes: Iterable[Outcome], sizes: deque[int]) -> Iterator[Outcome]:
    """The lanes of outcomes in groups of these sizes."""
    held: list[Outcome] = []
    for outcome in outcomes:
        held.append(outcome)
        while sizes and sum(len(one.status) for one in held) >= sizes[0]:
            whole, first = joined(held), sizes.popleft()
            yield part(whole, 0, first)
            held = [part(whole, first, None)]


def size(batch: Inputs) -> int:
    """Lanes of a batch."""
    return len(batch.lane.initial)


def joined(trees: Sequence[Lanes]) -> Lanes:
    """Lanes of several trees as one."""
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *trees) if len(trees) > 1 else trees[0]


def part(tree: Lanes, start: int, stop: int | None) -> Lanes:
    """Some lanes of a tree."""
    return jax.tree.map(lambda leaf: leaf[start:stop], tree)
