"""Shards by other processes: the same rows to the last bit, whatever dies on the way."""

import contextlib
import multiprocessing
import os
import re
import signal
import socket
import subprocess
import sys
import time
from multiprocessing import forkserver

import pytest
from distributed import Client

import jaxnet
from jaxnet.runs import cluster
from jaxnet.runs.cluster import ClusterError
from jaxnet.store.folder import TakenError
from tests.runs.conftest import SHARDS, done

pytestmark = pytest.mark.usefixtures("many_side_by_side")

MORE = 1000  # samples of a run that is interrupted
WARNING = """
import warnings
import pyarrow.parquet as pq
written = pq.write_table
def write_table(*words, **keys):
    warnings.warn("the disk is old")
    written(*words, **keys)
pq.write_table = write_table
"""
WAIT = 60  # [s]


def awaited(condition):
    deadline = time.monotonic() + WAIT
    while time.monotonic() < deadline:
        if found := condition():
            return found
        time.sleep(0.02)
    raise AssertionError("nothing happened")


@pytest.mark.long
def test_two_devices(parted, assert_same, tmp_path):
    """One process with one, and with two."""
    for devices in (1, 2):
        assert_same(jaxnet.run(parted, tmp_path / str(devices), devices=devices))


@pytest.fixture
def no_server_yet():
    """The process that workers are split off from is started by the test, and ends with it."""
    forkserver._forkserver._stop()
    yield
    forkserver._forkserver._stop()


@pytest.mark.long
def test_a_worker_killed_in_mid_shard(
    parted, whole, assert_same, tmp_path, monkeypatch, no_server_yet
):
    """Its shard is given to the other and nothing is lost; each warning is told once."""
    (tmp_path / "sitecustomize.py").write_text(WARNING)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    killed = []

    def kill(done, total, failed):
        if done and not killed:
            killed.extend(process.pid for process in multiprocessing.active_children())
            os.kill(killed[0], signal.SIGKILL)

    with pytest.warns(UserWarning, match="was lost|old") as warned:
        results = jaxnet.run(parted, tmp_path / "out", progress=kill, workers=2)
    assert results.lanes.equals(whole.lanes)
    # clear of what the worker may have been killed writing
    assert_same(jaxnet.run(parted, tmp_path / "out"))
    assert len(killed) == 2
    assert not multiprocessing.active_children()
    lost, other = sorted((str(each.message) for each in warned), key=lambda text: "old" in text)
    words = r"worker tcp://\S+ was lost; others do what it had under way: [1-9]\d*"
    assert re.fullmatch(words, lost)
    assert other == "the disk is old"


def command(config, out, *words):
    """A run of more samples, in a process group of its own."""
    run = ["run", str(config), "--out", str(out), f"samples={MORE}", *words]
    null, pipe = subprocess.DEVNULL, subprocess.PIPE
    words = [sys.executable, "-m", "jaxnet", *run]
    return subprocess.Popen(words, stdout=null, stderr=pipe, text=True, start_new_session=True)


def members(group):
    """Processes of a group that are at work."""
    table = subprocess.check_output(["ps", "-eo", "pgid=,stat=,pid="], text=True)
    rows = (line.split() for line in table.splitlines())
    return [
        pid for number, state, pid in rows if int(number) == group and not state.startswith("Z")
    ]


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_client_that_is_stopped(parted, assert_begins, tmp_path, number):
    """Its workers go with it, what is finished is kept, and the same command goes on."""
    out = tmp_path / "out"
    client = command(parted, out, "--workers", "2")
    awaited(lambda: len(done(out)) > 1)
    assert len(members(client.pid)) > 2
    os.killpg(client.pid, number) if number == signal.SIGINT else client.send_signal(number)
    _, said = client.communicate(timeout=WAIT)
    awaited(lambda: not members(client.pid))
    assert len(done(out)) < SHARDS
    if number != signal.SIGKILL:
        assert client.returncode == 130
        assert said.endswith("interrupted; what is finished is kept; the same command resumes\n")
    kept = done(out)
    results = jaxnet.run(jaxnet.load(parted, {"samples": MORE}), out)
    assert kept.items() <= done(out).items()
    assert len(results.lanes) == SHARDS * MORE
    assert_begins(results.lanes)


@pytest.mark.long
def test_workers_whose_client_has_lost_the_folder_write_no_more(parted, assert_begins, tmp_path):
    """They look at the lock themselves, and the client tells of it; the same run goes on."""
    out, before = tmp_path / "out", {}

    def take(*_):
        if done(out) and not before:
            (out / ".lock").write_bytes(b'{"owner": "process 1 on Mars"}')
            time.sleep(0.2)  # for a file that is being renamed
            before.update(done(out))

    longer = jaxnet.load(parted, {"samples": MORE})
    with pytest.raises(
        TakenError, match="was taken over by process 1 on Mars at an unknown time: this process"
    ):
        jaxnet.run(longer, out, progress=take, workers=2)
    assert done(out) == before
    assert 0 < len(before) < SHARDS
    assert_begins(jaxnet.run(longer, out).lanes)


@contextlib.contextmanager
def scheduler(place, *preload):
    """A dask scheduler with one worker, as processes of their own; its address, and both."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    quiet = {"cwd": place, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    port = address.rsplit(":")[-1]
    listen = f"--host 127.0.0.1 --port {port} --dashboard-address 127.0.0.1:0 --no-show"
    alone = "--nthreads 1 --no-nanny --no-dashboard"
    start = [sys.executable, "-m", "distributed.cli.dask_scheduler", *listen.split()]
    work = [sys.executable, "-m", "distributed.cli.dask_worker", address, *alone.split(), *preload]
    processes = [subprocess.Popen(words, **quiet) for words in (start, work)]
    try:
        with Client(address, timeout=WAIT) as client:
            awaited(client.nthreads)
        yield address, processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.mark.long
def test_a_scheduler_that_is_killed(parted, assert_begins, tmp_path, monkeypatch):
    """The client says so and ends; with another scheduler the same command goes on."""
    out, longer = tmp_path / "out", jaxnet.load(parted, {"samples": MORE})
    with scheduler(tmp_path) as (address, (killed, _)):
        client = command(parted, out, "--cluster", address)
        awaited(lambda: done(out))
        killed.kill()
        _, said = client.communicate(timeout=WAIT)
    assert client.returncode == 2
    assert "the scheduler was lost; what is finished is kept; the same command resumes" in said
    assert "Traceback" not in said
    assert 0 < len(done(out)) < SHARDS
    monkeypatch.setattr(cluster, "CONNECT", 0.5)
    with pytest.raises(ClusterError, match=f"no scheduler answers at {address}"):
        jaxnet.run(longer, out, cluster=address)
    monkeypatch.undo()
    with scheduler(tmp_path) as (address, _):
        assert_begins(jaxnet.run(longer, out, cluster=address).lanes)


@pytest.mark.long
def test_a_worker_of_another_version_is_refused(parted, tmp_path):
    """Before anything is simulated, with both versions."""
    (tmp_path / "older.py").write_text("import jaxnet\njaxnet.__version__ = '0.0.1'\n")
    versions = rf"worker tcp://\S+ has jaxnet 0\.0\.1, this is {jaxnet.__version__}"
    refused = pytest.raises(ClusterError, match=versions)
    with scheduler(tmp_path, "--preload", "older.py") as (address, _), refused:
        jaxnet.run(parted, tmp_path / "out", cluster=address)
    assert not done(tmp_path / "out")


def test_what_workers_need_is_said(parted, tmp_path, monkeypatch):
    """The extra that is not installed, and what contradicts itself."""
    with pytest.raises(ClusterError, match="workers or a cluster, not both"):
        jaxnet.run(parted, tmp_path / "out", workers=2, cluster="tcp://127.0.0.1:1")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ClusterError, match=r'pip install "jaxnet-sim\[cluster\]"'):
        jaxnet.run(parted, tmp_path / "out", workers=2)
