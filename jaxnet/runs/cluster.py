"""Shards, or cells to search, on the workers of a dask scheduler, here or elsewhere.

A worker receives a task and one item, writes the item's files itself, and returns a few numbers. It
works on one item at a time for each of its threads. If a worker dies, other workers repeat its
unfinished items. If the scheduler or the client dies, unfinished items are lost, and the same
command resumes.
"""

import asyncio
import contextlib
import functools
import importlib.util
import logging
import multiprocessing
import os
import pickle
import pkgutil
import signal
import threading
import uuid
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from importlib import metadata
from multiprocessing import forkserver, resource_tracker
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from upath import UPath

from jaxnet.config.keys import Config
from jaxnet.lazy import LazyModule
from jaxnet.outside import blame
from jaxnet.runs import cache
from jaxnet.store.folder import FolderError
from jaxnet.store.manifest import PACKAGES, modules_of, versions

if TYPE_CHECKING:
    import dask.config
    import distributed
    import distributed.comm.core
    import distributed.utils

    from jaxnet.engine import batch
    from jaxnet.runs import shards
    from jaxnet.runs.shards import Assignment, Done
    from jaxnet.store.layout import Shard
else:  # distributed is optional, and JAX must not start before a worker knows its threads
    batch = LazyModule("jaxnet.engine.batch")
    dask = LazyModule("dask")
    distributed = LazyModule("distributed")
    shards = LazyModule("jaxnet.runs.shards")

Item = TypeVar("Item")
Result = TypeVar("Result")

CONNECT = 10  # [s]
KEPT = "what is finished is kept; the same command resumes"
NO_LOGS = logging.CRITICAL + 1  # what is lost is told by us, not by dask
MOST_LOSSES = 5  # workers that one item may take with it before it is given up
SETTING_UP = threading.Lock()


class ClusterError(RuntimeError):
    """Workers that are lost, do not answer, or cannot do the task.

    Examples
    --------
    >>> import jaxnet, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     try:
    ...         jaxnet.run({}, folder, cluster="nowhere")
    ...     except jaxnet.ClusterError as error:
    ...         print(error)
    no scheduler answers at nowhere: missing port number in address 'nowhere'
    """


class Answer(NamedTuple):
    found: Any
    said: list[str]


@contextlib.contextmanager
def executor(
    folder: UPath, workers: int | None, address: str | None, cores: int, chunk: int | None
) -> "Iterator[Cluster | None]":
    """Workers on these cores or at an address, which start in a thread; None without either."""
    if workers is None and address is None:
        yield None
        return
    if workers is not None and address is not None:
        raise ClusterError("give workers or a cluster, not both")
    if folder.protocol == "memory":
        told = "is seen by this process alone: give workers another folder with --out"
        raise ClusterError(f"{folder} {told}")
    if importlib.util.find_spec("distributed") is None:
        raise ClusterError('workers need dask.distributed: pip install "jaxnet-sim[cluster]"')
    connect = workers_here(workers, cores) if workers is not None else workers_at(str(address))
    with contextlib.ExitStack() as stack, ThreadPoolExecutor(1) as pool:
        yield Cluster(pool.submit(stack.enter_context, connect), chunk)


class Cluster:
    """Workers of a dask cluster, once `client` is there."""

    def __init__(self, client: "Future[distributed.Client]", chunk: int | None):
        self.client, self.chunk = client, chunk

    def __call__(
        self, work: "Assignment", todo: "Sequence[Shard]", load_done: Callable[[int], None]
    ) -> "Iterator[Done]":
        """Simulate shards; yield a report on each. Raises ClusterError or FolderError."""
        task = functools.partial(simulate_shard, work, self.chunk)
        items = {f"shard {shard.number}": shard for shard in todo}
        yield from self.deal(task, work.config, items)

    def deal(
        self, task: Callable[[Item], Result], config: Config, items: Mapping[str, Item]
    ) -> Iterator[Result]:
        """Run the task on each named item; yield the results as they come.

        Workers load the kinds of the config from the same files. Raises ClusterError, and the
        errors of the task.
        """
        if not items:
            return
        if typed := [name for name, made_of in modules_of(config).items() if not made_of.file]:
            told = "which has no file: write its kinds into a module"
            raise ClusterError(f"no worker can import {typed[0]}, {told}")
        try:
            client = self.client.result()
            packed = {name: pickle.dumps(item) for name, item in items.items()}
            work = functools.partial(run_task, pickle.dumps((task, config.scope)), versions())
            yield from worker_answers(client, work, packed)
        except distributed.KilledWorker as error:
            item = str(error.task).split(" of ")[0]
            told = f"took {error.allowed_failures + 1} workers with it, out of memory? {KEPT}"
            raise ClusterError(f"{item} {told}") from error
        except (CancelledError, distributed.comm.core.CommClosedError) as error:
            raise ClusterError(f"the scheduler was lost; {KEPT}") from error


def worker_answers(
    client: "distributed.Client", task: Callable[[bytes], Answer], items: Mapping[str, bytes]
) -> Iterator[Any]:
    told, run = set[str](), uuid.uuid4().hex

    def tell(said: Iterable[str]) -> None:
        for text in said:
            if text not in told:
                told.add(text)
                warnings.warn(text, stacklevel=2)

    def tell_lost(event: tuple[object, Any]) -> None:
        found = event[1]
        if isinstance(found, dict) and found.get("action") == "remove-worker":
            items = sum(run in str(key) for key in found["processing-tasks"])
            if items and not found["expected"]:
                name = f"worker {found['worker']} was lost"
                tell([f"{name}; others do what it had under way: {items}"])

    client.subscribe_topic("all", tell_lost)
    futures = client.map(task, list(items.values()), key=[f"{name} of {run}" for name in items])
    try:
        for _, answer in distributed.as_completed(futures, with_results=True, loop=client.loop):
            if isinstance(answer, ImportError) or "deserialization" in str(answer):
                needed = "the same jaxnet, and the study's own modules"
                raise ClusterError(f"scheduler and workers need {needed}: {answer}")
            if isinstance(answer, BaseException):
                raise answer
            tell(answer.said)
            yield answer.found
    finally:
        client.unsubscribe_topic("all")  # it would be told of its own leaving


@contextlib.contextmanager
def workers_here(number: int, cores: int) -> "Iterator[distributed.Client]":
    quiet_tracker()
    # The process from which workers are forked imports their modules once, while this process does
    # other things. It does not start JAX, which would not survive a fork.
    modules = ["distributed", "jaxnet.runs.shards"]
    multiprocessing.get_context("forkserver").set_forkserver_preload(modules)
    forkserver.ensure_running()
    each = max(1, cores // number)
    settings = {
        "distributed.scheduler.allowed-failures": MOST_LOSSES,
        "distributed.worker.multiprocessing-method": "forkserver",
    }
    _ = distributed.LocalCluster  # imports the defaults that `settings` change
    with (
        dask.config.set(settings),
        distributed.LocalCluster(
            n_workers=number,
            threads_per_worker=each,
            memory_limit=None,
            dashboard_address="127.0.0.1:0",
            silence_logs=NO_LOGS,
            preload=__name__,
            env={"NPROC": str(each)},  # threads of XLA
        ) as cluster,
        contextlib.closing(distributed.Client(cluster, set_as_default=False)) as client,
    ):
        yield client


def quiet_tracker() -> None:
    """Start Python's resource tracker without warnings about the leftovers of killed workers."""
    before = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = "ignore:resource_tracker"
    resource_tracker.ensure_running()
    os.environ.pop("PYTHONWARNINGS")
    if before is not None:
        os.environ["PYTHONWARNINGS"] = before


@contextlib.contextmanager
def workers_at(address: str) -> "Iterator[distributed.Client]":
    with contextlib.ExitStack() as stack:
        stack.enter_context(distributed.utils.silence_logging_cmgr(NO_LOGS))
        try:
            client = distributed.Client(address, timeout=CONNECT, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ClusterError(f"no scheduler answers at {address}: {error}") from error
        stack.callback(client.close)
        # by functions of Python alone, since another version of jaxnet may lack ours
        asked = {"jaxnet": (pkgutil.resolve_name, "jaxnet:__version__")}
        asked |= {package: (metadata.version, package) for package in PACKAGES}
        told: Any = {name: client.run(*ask, on_error="return") for name, ask in asked.items()}
        for worker in told["jaxnet"]:
            theirs = {package: said.get(worker) for package, said in told.items()}
            if not any(each is None or isinstance(each, OSError) for each in theirs.values()):
                refuse_versions(worker, theirs, versions())
        client.run(get_ready, wait=False, on_error="ignore")
        if not client.nthreads():
            warnings.warn(
                f"the scheduler at {address} has no workers yet: waiting for them", stacklevel=2
            )
        yield client


def refuse_versions(worker: str, theirs: Mapping[str, object], ours: Mapping[str, str]) -> None:
    """Raise ClusterError if versions on which rows depend differ from those of this process."""
    for package in ("jaxnet", *PACKAGES):
        if theirs[package] != ours[package]:
            versions = f"{package} {theirs[package]}, this is {ours[package]}"
            raise ClusterError(f"worker {worker} has {versions}: the same is needed everywhere")


def run_task(work: bytes, needed: dict[str, str], item: bytes) -> Answer:
    """Run a task on one item, on a worker; `needed` are the versions of the client.

    `work` holds the task and the scope, which loads the classes of the study's kinds. This function
    unpacks it: a class that fails to load while dask reads a message would stop the worker for
    ever.
    """
    worker = distributed.get_worker()
    with SETTING_UP:
        said = set_up_worker(worker.state.nthreads)
    refuse_versions(worker.address, versions(), needed)
    with blame.blaming():
        task, _ = pickle.loads(work)
        found = task(pickle.loads(item))
    with SETTING_UP:
        return Answer(found, [said.popleft() for _ in range(len(said))])


def simulate_shard(work: "Assignment", chunk: int | None, shard: "Shard") -> "Done":
    """Simulate and store a shard on a worker, unless the folder has it."""
    ended = 0

    def see(lanes: int = 0) -> None:
        # at first, and before anything is written: the folder may be another's by then
        nonlocal ended
        ended += lanes
        work.folder.look()
        if ended in (0, len(shard.samples)) and work.folder.manifest.get("hash") != work.study:
            worker = f"worker {distributed.get_worker().address}"
            told = f"{worker} does not see this study in {work.folder.path}"
            raise FolderError(f"{told}: it must be on storage that all share")

    see()
    done = shards.find_done(work, shard)
    if done is None or work.missing(shard, done):
        done = next(shards.simulate_shards(work, [shard], batch.Machine(1, chunk), see))
    return done


@functools.cache
def set_up_worker(threads: int) -> deque[str]:
    """Prepare a process as a worker before JAX starts; return the queue of its warnings."""
    os.environ.setdefault("NPROC", str(threads))
    cache.enable()
    said: deque[str] = deque(maxlen=1000)
    warnings.showwarning = lambda message, category, *rest: said.append(str(message))
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: said.append(record.getMessage())
    logging.getLogger().addHandler(handler)
    return said


async def get_ready(dask_worker: "distributed.Worker") -> None:
    """Prepare a worker before its first item comes."""
    with SETTING_UP:
        set_up_worker(dask_worker.state.nthreads)
    await asyncio.to_thread(importlib.import_module, "jaxnet.runs.shards")


async def dask_setup(worker: "distributed.Worker") -> None:
    """Prepare a local worker at its start; it ignores Ctrl-C, which reaches the whole group."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    await get_ready(worker)
