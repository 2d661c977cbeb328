"""Shards by other processes: the same rows to the last bit, whatever dies or is torn on the way."""

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

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml
from distributed import Client
from upath import UPath

import jaxnet
from jaxnet.runs import cluster
from jaxnet.runs.cluster import ClusterError
from jaxnet.store import arrays, layout
from jaxnet.store.folder import FolderError, TakenError

pytestmark = pytest.mark.usefixtures("many_side_by_side")

STUDY = {
    "name": "parted",
    "samples": 256,
    "horizon": 5.0,
    "tail": 1.0,
    "topology": "star",
    "defence": "none",
    "engine": "exact",
    "sweep": {"attack.magnitude": {"linspace": [0, 10, 12]}},
    "save": {"errors": True},
}
SHARDS = 12
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


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    """The study's file."""
    path = tmp_path_factory.mktemp("config") / "parted.yaml"
    path.write_text(yaml.safe_dump(STUDY, sort_keys=False))
    return path


@pytest.fixture(scope="module")
def study(config):
    """The study."""
    return jaxnet.load(config)


@pytest.fixture(scope="module")
def whole(study, tmp_path_factory):
    """Its results, by this process alone."""
    return jaxnet.run(study, tmp_path_factory.mktemp("whole") / "out")


def assert_same(results, whole):
    """Rows, tables and arrays are equal to the last bit, and all lanes are told of."""
    pd.testing.assert_frame_equal(results.lanes, whole.lanes, check_exact=True)
    xr.testing.assert_equal(results.errors.load(), whole.errors.load())
    assert (results.path / "cells.csv").read_bytes() == (whole.path / "cells.csv").read_bytes()
    assert results.manifest["lanes"] == whole.manifest["lanes"]
    leftovers = {path.name for path in results.path.rglob(".*")}
    assert leftovers == {".lock"}


def done(folder):
    """Shards whose rows are there."""
    return sorted((folder / "lanes").glob("*.parquet"))


def awaited(condition):
    """What a condition comes to, when it comes to something."""
    deadline = time.monotonic() + WAIT
    while time.monotonic() < deadline:
        if found := condition():
            return found
        time.sleep(0.02)
    raise AssertionError("nothing happened")


def test_two_devices(study, whole, tmp_path):
    """One process with one, and with two."""
    for devices in (1, 2):
        assert_same(jaxnet.run(study, tmp_path / str(devices), devices=devices), whole)


def test_three_parts_in_any_order(study, whole, tmp_path):
    """They write `lanes/` alone; a run makes the rest, and simulates what a part has left out."""
    for part in (2, 0):
        told = jaxnet.run_part(study, part, 3, tmp_path / "out")
        assert told == (tmp_path / "out", 4, 4, 0)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"lanes", ".lock"}
    assert [int(path.stem) % 3 for path in done(tmp_path / "out")] == [0, 2] * 4
    stamps = [path.stat().st_mtime_ns for path in done(tmp_path / "out")]
    assert jaxnet.run_part(study, 2, 3, tmp_path / "out").simulated == 0
    assert [path.stat().st_mtime_ns for path in done(tmp_path / "out")] == stamps
    with pytest.raises(FolderError, match="another study"):
        jaxnet.run_part(jaxnet.load(STUDY, {"seed": 1}), 1, 3, tmp_path / "out")
    (tmp_path / "out" / "lanes" / "00002.npz").write_bytes(b"PK")
    swap(*(tmp_path / "out" / "lanes" / f"{shard}.npz" for shard in ("00005", "00008")))
    with pytest.warns(
        UserWarning, match=r"the arrays beside it are torn .* simulated again"
    ) as said:
        told = told_by(study, tmp_path / "out")
    assert sorted(re.search(r"\d{5}", str(each.message))[0] for each in said) == [
        "00002",
        "00005",
        "00008",
    ]
    assert told[0] == (5 * 256, 12 * 256, 0)  # all of two parts, but for these
    assert_same(jaxnet.open(tmp_path / "out"), whole)
    assert not list((tmp_path / "out").glob("lanes/*.npz"))


def told_by(study, out, **keys):
    """What a run says of its progress."""
    told = []
    jaxnet.run(study, out, progress=lambda *now: told.append(now), **keys)
    return told


def test_what_was_torn_is_told_and_done_again(study, whole, tmp_path):
    """Row files cut short, with a bit changed, of another study; chunks with a bit changed, gone, swapped."""
    jaxnet.run(study, tmp_path / "out")
    other = jaxnet.run(jaxnet.load(STUDY, {"seed": 1}), tmp_path / "other")
    cut, changed, foreign = done(tmp_path / "out")[2:5]
    cut.write_bytes(cut.read_bytes()[:-100])
    flip(changed, 300)
    foreign.write_bytes((other.path / "lanes" / foreign.name).read_bytes())
    flip(tmp_path / "out" / "errors.zarr" / "tracking" / "c" / "6" / "0" / "0", 500)
    (tmp_path / "out" / "errors.zarr" / "disagreement" / "c" / "8" / "0" / "0").unlink()
    (tmp_path / "out" / "errors.zarr" / "disagreement" / "c" / "9" / "0" / "0").write_bytes(b"")
    swap(
        *(
            tmp_path / "out" / "errors.zarr" / "tracking" / "c" / cell / "0" / "0"
            for cell in ("0", "1")
        )
    )
    with pytest.warns(UserWarning, match="simulated again") as said:
        told = told_by(study, tmp_path / "out")
    assert told[0][0] == (SHARDS - 8) * 256
    assert_same(jaxnet.open(tmp_path / "out"), whole)
    words = {re.search(r"\d{5}", str(each.message))[0]: str(each.message) for each in said}
    assert "torn" in words["00002"]
    assert "torn" in words["00003"]
    assert "another study" in words["00004"]
    assert "errors.zarr is corrupt at cell 0" in words["00000"]
    assert "errors.zarr is corrupt at cell 1" in words["00001"]
    assert "errors.zarr is corrupt at cell 6, samples 0 to 255" in words["00006"]
    assert "errors.zarr is corrupt at cell 8" in words["00008"]
    assert "errors.zarr is corrupt at cell 9" in words["00009"]
    assert all(text.endswith("simulated again") for text in words.values())


@pytest.fixture
def small_disk(tmp_path):
    """A disk of two MiB."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(place)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no disk of its own can be mounted here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_a_full_disk(study, whole, small_disk):
    """The run ends with the system's own error; with room again the same command goes on."""
    ballast = small_disk / "ballast"

    def fill(done, total, failed):
        if done and not ballast.exists():
            with contextlib.suppress(OSError), ballast.open("wb", buffering=0) as file:
                while True:
                    file.write(bytes(4096))

    with pytest.raises(OSError, match="No space left on device"):
        jaxnet.run(study, small_disk / "out", progress=fill, devices=1)
    ballast.unlink()
    kept = {path: path.stat().st_mtime_ns for path in done(small_disk / "out")}
    assert len(kept) < SHARDS
    assert_same(jaxnet.run(study, small_disk / "out"), whole)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_a_store_that_cannot_be_read_is_made_anew(study, whole, tmp_path):
    """Its lanes are simulated again."""
    jaxnet.run(study, tmp_path / "out")
    (tmp_path / "out" / "errors.zarr" / "tracking" / "zarr.json").write_bytes(b"")
    assert told_by(study, tmp_path / "out")[0][0] == 0
    assert_same(jaxnet.open(tmp_path / "out"), whole)


def test_lanes_that_failed_at_once_are_stored_like_others(study, tmp_path):
    """A chunk of nothing but not-a-number is there, and is not taken for one that is gone."""
    place, cells = UPath(tmp_path / "errors.zarr"), study.cells
    arrays.prepare(place, layout.ERRORS, cells, samples=4, chunk=2)
    store = arrays.open_for_writing(place)
    blank = np.full((2, 51), np.nan)
    arrays.write_chunks(store, (3, slice(2, 4)), dict.fromkeys(layout.ERRORS, blank))
    written = arrays.read_checksums(place, layout.ERRORS, (3, 1))
    assert arrays.is_intact(place, layout.ERRORS, (3, 1), written)
    assert not arrays.is_intact(place, layout.ERRORS, (3, 0), written)


def test_parts_of_a_longer_study(study, whole, tmp_path):
    """A shorter run takes what is its own; the longer one has all its arrays; what was derived goes."""
    out, longer = tmp_path / "out", jaxnet.load(STUDY, {"samples": 300})
    for part in (0, 1):
        jaxnet.run_part(longer, part, 2, out)
    assert_same(jaxnet.run(study, out), whole)
    (out / "fit.csv").touch()
    for part in (0, 1):
        jaxnet.run_part(longer, part, 2, out)
    assert len(jaxnet.open(out).lanes) == SHARDS * 256
    with pytest.warns(UserWarning, match=r"removing what was made of the rows before: fit\.csv \("):
        results = jaxnet.run(longer, out)
    assert len(results.lanes) == SHARDS * 300
    assert not results.errors["tracking"].isnull().any()
    assert not (out / "fit.csv").exists()
    assert results.row(0, 300) is None


def swap(one, other):
    """Put two files in each other's place."""
    content = one.read_bytes()
    one.write_bytes(other.read_bytes())
    other.write_bytes(content)


def flip(path, place):
    """Change one bit of a file."""
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)


@pytest.fixture
def no_server_yet():
    """The process that workers are split off from is started by the test, and ends with it."""
    forkserver._forkserver._stop()
    yield
    forkserver._forkserver._stop()


def test_a_worker_killed_in_mid_shard(study, whole, tmp_path, monkeypatch, no_server_yet):
    """Its shard is given to the other and nothing is lost; all is told once, also what both are warned of."""
    (tmp_path / "sitecustomize.py").write_text(WARNING)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    killed = []

    def kill(done, total, failed):
        if done and not killed:
            killed.extend(process.pid for process in multiprocessing.active_children())
            os.kill(killed[0], signal.SIGKILL)

    with pytest.warns(UserWarning, match="was lost|old") as warned:
        results = jaxnet.run(study, tmp_path / "out", progress=kill, workers=2)
    pd.testing.assert_frame_equal(results.lanes, whole.lanes, check_exact=True)
    xr.testing.assert_equal(results.errors.load(), whole.errors.load())
    assert_same(
        jaxnet.run(study, tmp_path / "out"), whole
    )  # clear of what it may have been killed writing
    assert len(killed) == 2
    assert not multiprocessing.active_children()
    lost, other = sorted((str(each.message) for each in warned), key=lambda text: "old" in text)
    assert re.fullmatch(
        r"worker tcp://\S+ was lost; others do what it had under way: [1-9]\d*", lost
    )
    assert other == "the disk is old"


def command(config, out, *words):
    """A run in a process group of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "jaxnet", "run", str(config), "--out", str(out), *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def members(group):
    """Processes of a group that are at work."""
    table = subprocess.check_output(["ps", "-eo", "pgid=,stat=,pid="], text=True)
    rows = (line.split() for line in table.splitlines())
    return [
        pid for number, state, pid in rows if int(number) == group and not state.startswith("Z")
    ]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_client_that_is_stopped(config, whole, tmp_path, number):
    """Its workers go with it, what is finished is kept, and the same command goes on."""
    out = tmp_path / "out"
    client = command(config, out, "samples=1000", "--workers", "2")
    awaited(lambda: len(done(out)) > 1)
    assert len(members(client.pid)) > 2
    os.killpg(client.pid, number) if number == signal.SIGINT else client.send_signal(number)
    _, said = client.communicate(timeout=WAIT)
    awaited(lambda: not members(client.pid))
    assert len(done(out)) < SHARDS
    if number != signal.SIGKILL:
        assert client.returncode == 130
        assert said.endswith("interrupted; what is finished is kept, the same command goes on\n")
    kept = {path: path.stat().st_mtime_ns for path in done(out)}
    results = jaxnet.run(jaxnet.load(config, {"samples": 1000}), out)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    rows = results.lanes
    assert len(rows) == SHARDS * 1000
    first = rows[rows["sample"] < 256].reset_index(drop=True)
    pd.testing.assert_frame_equal(first, whole.lanes, check_exact=True)


def test_workers_whose_client_has_lost_the_folder_write_no_more(study, whole, tmp_path):
    """They look at the lock themselves, and the client tells of it; the same run goes on."""
    out, before = tmp_path / "out", {}

    def take(*_):
        if done(out) and not before:
            (out / ".lock").write_bytes(b'{"owner": "process 1 on Mars"}')
            time.sleep(0.2)  # for a file that is being renamed
            before.update({path: path.stat().st_mtime_ns for path in done(out)})

    longer = jaxnet.load(STUDY, {"samples": 1000})
    with pytest.raises(
        TakenError, match="was taken over by process 1 on Mars at an unknown time: this process"
    ):
        jaxnet.run(longer, out, progress=take, workers=2)
    assert {path: path.stat().st_mtime_ns for path in done(out)} == before
    assert 0 < len(before) < SHARDS
    rows = jaxnet.run(longer, out).lanes
    first = rows[rows["sample"] < 256].reset_index(drop=True)
    pd.testing.assert_frame_equal(first, whole.lanes, check_exact=True)


@contextlib.contextmanager
def scheduler(place, *preload):
    """A dask scheduler with one worker, as processes of their own; its address, and both."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    quiet = {"cwd": place, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    words = [
        "--host",
        "127.0.0.1",
        "--port",
        address.rsplit(":")[-1],
        "--dashboard-address",
        "127.0.0.1:0",
        "--no-show",
    ]
    start = [sys.executable, "-m", "distributed.cli.dask_scheduler", *words]
    work = [
        sys.executable,
        "-m",
        "distributed.cli.dask_worker",
        address,
        "--nthreads",
        "1",
        "--no-nanny",
    ]
    processes = [
        subprocess.Popen(start, **quiet),
        subprocess.Popen([*work, "--no-dashboard", *preload], **quiet),
    ]
    try:
        yield address, processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


def nthreads(address):
    """Threads of a scheduler's workers."""
    with Client(address, timeout=WAIT) as client:
        return client.nthreads()


def test_a_scheduler_that_is_killed(config, study, whole, tmp_path, monkeypatch):
    """The client says so and ends; with another scheduler the same command goes on."""
    out = tmp_path / "out"
    with scheduler(tmp_path) as (address, (killed, _)):
        client = command(config, out, "--cluster", address)
        awaited(lambda: done(out))
        killed.kill()
        _, said = client.communicate(timeout=WAIT)
    assert client.returncode == 2
    assert "the scheduler was lost; what is finished is kept, the same command goes on" in said
    assert "Traceback" not in said
    assert 0 < len(done(out)) < SHARDS
    monkeypatch.setattr(cluster, "CONNECT", 0.5)
    with pytest.raises(ClusterError, match=f"no scheduler answers at {address}"):
        jaxnet.run(study, out, cluster=address)
    monkeypatch.undo()
    with scheduler(tmp_path) as (address, _):
        awaited(lambda: nthreads(address))
        assert_same(jaxnet.run(study, out, cluster=address), whole)


def test_a_worker_of_another_version_is_refused(study, tmp_path):
    """Before anything is simulated, with both versions."""
    (tmp_path / "older.py").write_text("import jaxnet\njaxnet.__version__ = '0.0.1'\n")
    versions = rf"worker tcp://\S+ has jaxnet 0\.0\.1, this is {jaxnet.__version__}"
    with scheduler(tmp_path, "--preload", "older.py") as (address, _):
        awaited(lambda: nthreads(address))
        with pytest.raises(ClusterError, match=versions):
            jaxnet.run(study, tmp_path / "out", cluster=address)
    assert not done(tmp_path / "out")


def test_what_workers_need_is_said(study, tmp_path, monkeypatch):
    """The extra that is not installed, and what contradicts itself."""
    with pytest.raises(ClusterError, match="workers or a cluster, not both"):
        jaxnet.run(study, tmp_path / "out", workers=2, cluster="tcp://127.0.0.1:1")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ClusterError, match=r'pip install "jaxnet-sim\[cluster\]"'):
        jaxnet.run(study, tmp_path / "out", workers=2)
