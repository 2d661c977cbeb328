"""Shards, or cells to search, done by other processes: the workers of a dask scheduler, here or elsewhere.

A worker is sent a task and one item of it, writes the item's files itself and answers with a few numbers.
One that dies costs what it had under way, which others are given; a scheduler or a client that dies costs
what was under way, and the same command goes on. A worker takes one item at a time for each of its threads.
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
from concurrent.futures import CancelledError, ThreadPoolExecutor
from importlib import metadata
from multiprocessing import forkserver, resource_tracker
from typing import TYPE_CHECKING, Any, NamedTuple

from upath import UPath

from jaxnet.kinds import blame
from jaxnet.kinds.registry import Scope
from jaxnet.store.folder import PACKAGES, FolderError, versions

if TYPE_CHECKING:
    from jaxnet.kinds.provenance import Provenance
    from jaxnet.runs.shards import Assignment, Done
    from jaxnet.store.layout import Shard

CONNECT = 10  # [s]
KEPT = "what is finished is kept, the same command goes on"
SILENT = logging.CRITICAL + 1  # what is lost is told by us, not by dask
LIVES = 5  # workers that one item may take with it before it is given up
SETTLING = threading.Lock()


class ClusterError(RuntimeError):
    """Workers that cannot do what was asked."""


class Answer(NamedTuple):
    """What a worker answers, and what it was warned of meanwhile."""

    found: Any
    said: list[str]


def crew(
    folder: UPath, workers: int | None, address: str | None, cores: int, chunk: int | None
) -> "contextlib.AbstractContextManager[Cluster | None]":
    """So many processes that share these cores, or the workers of a scheduler; None if neither is asked for.

    Raises ClusterError.
    """
    if workers is None and address is None:
        return contextlib.nullcontext()
    if workers is not None and address is not None:
        raise ClusterError("give workers or a cluster, not both")
    if folder.protocol == "memory":
        raise ClusterError(f"{folder} is seen by this process alone: give workers another folder with --out")
    if importlib.util.find_spec("distributed") is None:
        raise ClusterError('workers need dask.distributed: pip install "jaxnet-sim[cluster]"')
    if workers is not None:
        return Cluster(functools.partial(workers_here, workers, cores), chunk)
    return Cluster(functools.partial(workers_at, str(address)), chunk)


class Cluster:
    """The crew of a dask cluster. It is called together while this process is still about other things."""

    def __init__(self, connect: Callable[[], contextlib.AbstractContextManager[Any]], chunk: int | None):
        self.connect, self.chunk = connect, chunk
        self.stack, self.pool = contextlib.ExitStack(), ThreadPoolExecutor(1)

    def __enter__(self) -> "Cluster":
        self.client = self.pool.submit(lambda: self.stack.enter_context(self.connect()))
        return self

    def __exit__(self, *error: Any) -> None:
        self.pool.shutdown()
        self.stack.close()

    def __call__(
        self, work: "Assignment", todo: "Sequence[Shard]", load_done: Callable[[int], None]
    ) -> "Iterator[Done]":
        """Have shards simulated; each is told of when it is there. Raises ClusterError or FolderError."""
        task = functools.partial(simulate_shard, work, self.chunk)
        yield from self.deal(
            task, work.config.scope, work.modules, {f"shard {shard.number}": shard for shard in todo}
        )

    def deal(
        self,
        task: Callable[[Any], Any],
        scope: Scope,
        modules: "Mapping[str, Provenance]",
        items: Mapping[str, Any],
    ) -> Iterator[Any]:
        """What workers find of items, which have names, as it comes; `modules` are those that kinds are from.

        Workers load the kinds of `scope` from the same files.

        Raises ClusterError, and what the task does.
        """
        if not items:
            return
        if typed := [name for name, made_of in modules.items() if not made_of.file]:
            raise ClusterError(
                f"no worker can import {typed[0]}, which has no file: write its kinds into a module"
            )
        from distributed import KilledWorker
        from distributed.comm.core import CommClosedError

        try:
            client = self.client.result()
            packed = {name: pickle.dumps(item) for name, item in items.items()}
            work = functools.partial(by_worker, pickle.dumps((task, scope)), versions())
            yield from answers(client, work, packed)
        except KilledWorker as error:
            raise ClusterError(
                f"{str(error.task).split(' of ')[0]} took {error.allowed_failures + 1} workers with it,"
                f" out of memory? {KEPT}"
            ) from error
        except (CancelledError, CommClosedError) as error:
            raise ClusterError(f"the scheduler was lost; {KEPT}") from error


def answers(client: Any, task: Callable[[Any], Answer], items: Mapping[str, Any]) -> Iterator[Any]:
    """The workers' answers as they come; what they were warned of is told here, once."""
    from distributed import as_completed

    told, run = set[str](), uuid.uuid4().hex

    def tell(said: Iterable[str]) -> None:
        for text in said:
            if text not in told:
                told.add(text)
                warnings.warn(text, stacklevel=2)

    client.subscribe_topic("all", lambda event: tell(losses(event[1], run)))
    futures = client.map(task, list(items.values()), key=[f"{name} of {run}" for name in items])
    try:
        for _, answer in as_completed(futures, with_results=True, loop=client.loop):
            if isinstance(answer, ImportError) or "deserialization" in str(answer):
                raise ClusterError(
                    f"scheduler and workers need the same jaxnet, and the study's own modules: {answer}"
                )
            if isinstance(answer, BaseException):
                raise answer
            tell(answer.said)
            yield answer.found
    finally:
        client.unsubscribe_topic("all")  # it would be told of its own leaving


@contextlib.contextmanager
def workers_here(number: int, cores: int) -> Iterator[Any]:
    """A client of so many workers, processes of this machine that share its cores."""
    quiet_tracker()
    start_server()
    import distributed
    from dask import config

    each = max(1, cores // number)
    settings = {"scheduler.allowed-failures": LIVES, "worker.multiprocessing-method": "forkserver"}
    with (
        config.set({f"distributed.{key}": value for key, value in settings.items()}),
        distributed.LocalCluster(
            n_workers=number,
            threads_per_worker=each,
            memory_limit=None,
            dashboard_address="127.0.0.1:0",
            silence_logs=SILENT,
            preload=__name__,
            env={"NPROC": str(each)},  # threads of XLA's
        ) as cluster,
        contextlib.closing(distributed.Client(cluster, set_as_default=False)) as client,
    ):
        yield client


def start_server() -> None:
    """Spawn the process that workers are split off from.

    It imports what they need, once and while this one is about other things, and no more: JAX is not started
    in it, which would not survive the fork.
    """
    multiprocessing.get_context("forkserver").set_forkserver_preload(["distributed", "jaxnet.runs.shards"])
    forkserver.ensure_running()


def quiet_tracker() -> None:
    """Start the process that clears up after others, which would tell of what one left that was killed."""
    before = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = "ignore:resource_tracker"
    resource_tracker.ensure_running()
    os.environ.pop("PYTHONWARNINGS")
    if before is not None:
        os.environ["PYTHONWARNINGS"] = before


@contextlib.contextmanager
def workers_at(address: str) -> Iterator[Any]:
    """A client of the scheduler at an address."""
    import distributed
    from distributed.utils import silence_logging_cmgr

    with contextlib.ExitStack() as stack:
        stack.enter_context(silence_logging_cmgr(SILENT))
        try:
            client = distributed.Client(address, timeout=CONNECT, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ClusterError(f"no scheduler answers at {address}: {error}") from error
        stack.callback(client.close)
        refuse_strangers(client)
        client.run(get_ready, wait=False, on_error="ignore")
        if not client.nthreads():
            warnings.warn(f"the scheduler at {address} has no workers yet: waiting for them", stacklevel=2)
        yield client


def refuse_strangers(client: Any) -> None:
    """Raise ClusterError if a worker has other versions than this process of what rows depend on.

    It is asked by functions of Python's own, for another version may not have any of ours.
    """
    theirs = {"jaxnet": client.run(pkgutil.resolve_name, "jaxnet:__version__", on_error="return")}
    theirs |= {name: client.run(metadata.version, name, on_error="return") for name in PACKAGES}
    for worker in theirs["jaxnet"]:
        answered = {package: said.get(worker) for package, said in theirs.items()}
        if not any(each is None or isinstance(each, OSError) for each in answered.values()):  # it lives
            refuse(worker, answered, versions())


def refuse(worker: str, theirs: Mapping[str, Any], ours: Mapping[str, str]) -> None:
    """Raise ClusterError if a worker's versions are not ours."""
    for package in ("jaxnet", *PACKAGES):
        if theirs[package] != ours[package]:
            raise ClusterError(
                f"worker {worker} has {package} {theirs[package]}, this is {ours[package]}:"
                " the same is needed everywhere"
            )


def losses(event: Any, run: str) -> Iterator[str]:
    """What is to be told of an event of the scheduler: a worker that was lost with items of this run."""
    if isinstance(event, dict) and event.get("action") == "remove-worker" and not event["expected"]:
        items = sum(run in str(key) for key in event["processing-tasks"])
        if items:
            yield f"worker {event['worker']} was lost; others do what it had under way: {items}"


def by_worker(work: bytes, needed: dict[str, str], item: bytes) -> Answer:
    """On a worker: do a task with one item; `needed` are the versions asked for.

    `work` holds the task, and the scope that loads the classes of the study's kinds. It is unpacked here: a
    class that cannot be loaded while dask reads a message stops the worker for ever.
    """
    from distributed import get_worker

    worker = get_worker()
    with SETTLING:
        said = settle_in(worker.state.nthreads)
    refuse(worker.address, versions(), needed)
    with blame.blaming():
        task, _ = pickle.loads(work)
        found = task(pickle.loads(item))
    return Answer(found, list(drained(said)))


def simulate_shard(work: "Assignment", chunk: int | None, shard: "Shard") -> "Done":
    """On a worker: simulate and store a shard, unless it is there."""
    from distributed import get_worker

    from jaxnet.engine.batch import Machine
    from jaxnet.runs import shards

    ended = 0

    def see(lanes: int = 0) -> None:  # at first, and before anything is written: it may be another's by then
        nonlocal ended
        ended += lanes
        work.folder.look()
        if ended in (0, len(shard.samples)) and work.folder.manifest.get("hash") != work.study:
            raise FolderError(
                f"worker {get_worker().address} does not see this study in {work.folder.path}:"
                " it must be on storage that all share"
            )

    see()
    done = shards.there(work, shard)
    if done is None or work.missing(shard, done):
        done = next(shards.simulate_shards(work, [shard], Machine(1, chunk), see))
    return done


def drained(said: deque[str]) -> Iterator[str]:
    """All that is in it, which is taken out; other threads may do so too."""
    with contextlib.suppress(IndexError):
        while True:
            yield said.popleft()


@functools.cache
def settle_in(threads: int) -> deque[str]:
    """Make a process a worker, before JAX starts; where its warnings are kept until they are sent."""
    os.environ.setdefault("NPROC", str(threads))
    from jaxnet.runs import cache

    cache.enable()
    said: deque[str] = deque(maxlen=1000)
    warnings.showwarning = lambda message, category, *rest: said.append(str(message))
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: said.append(record.getMessage())
    logging.getLogger().addHandler(handler)
    return said


async def get_ready(dask_worker: Any) -> None:
    """On a worker: do what is done once, before the first item comes."""
    with SETTLING:
        settle_in(dask_worker.state.nthreads)
    await asyncio.to_thread(importlib.import_module, "jaxnet.runs.shards")


async def dask_setup(worker: Any) -> None:
    """On a worker of this machine, as it starts: get ready, and leave Ctrl-C to the client.

    The whole process group is sent it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    await get_ready(worker)
