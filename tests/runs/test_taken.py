"""Runs in the background, where Ctrl-C is ignored: taken over, terminated, disks that fail."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

import jaxnet
from jaxnet.cli import main
from jaxnet.store import lock
from jaxnet.store.results import Results
from tests.runs.conftest import STUDY

pytestmark = pytest.mark.usefixtures("many_side_by_side")

SHARDS = 12
IGNORED = 'trap "" INT; exec "$@"'  # as a shell without job control starts what ends in &
WAIT = 120  # [s]
MORE = 500  # samples of a run that is interrupted


def done(out: Path) -> dict[Path, int]:
    """Shards whose rows are there, and when they were written."""
    return {path: path.stat().st_mtime_ns for path in out.glob("lanes/*.parquet")}


def started(config: Path, out: Path) -> subprocess.Popen[str]:
    """A run that ignores Ctrl-C, when its first shards are there."""
    run = [sys.executable, "-m", "jaxnet", "run", str(config), f"samples={MORE}", "--out", str(out)]
    process = subprocess.Popen(
        ["sh", "-c", IGNORED, "sh", *run],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + WAIT
    while not done(out) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    return process


@pytest.mark.long
def test_a_run_in_the_background_that_is_taken_over_stops(parted, assert_begins, tmp_path):
    """Before its next write, while another simulates what is missing; no shard is written twice."""
    out = tmp_path / "out"
    first = started(parted, out)
    (tmp_path / "lock").write_bytes(lock.lock_content(lock.holder_entries("another"), 0))
    (tmp_path / "lock").rename(out / ".lock")
    there = done(out)
    results = jaxnet.run(jaxnet.load(parted, {"samples": MORE}), out)
    _, said = first.communicate(timeout=WAIT)
    assert first.returncode == 2, said
    (line,) = (line for line in said.splitlines() if "taken over" in line)
    assert line.startswith(f"{out} was taken over by process {os.getpid()} on ")
    assert "this process writes no more; what it has written stays: " in line
    assert "Traceback" not in said
    assert 0 < len(there) < SHARDS
    assert there.items() <= done(out).items()
    assert_begins(results.lanes)


@pytest.mark.long
def test_a_run_in_the_background_is_terminated(parted, assert_begins, tmp_path):
    """With status 143 and a word; the same command goes on as if nothing had happened."""
    out = tmp_path / "out"
    process = started(parted, out)
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=WAIT)
    assert process.returncode == 143, said
    assert said.splitlines()[-1] == "terminated; what is finished is kept, the same command goes on"
    there = done(out)
    assert 0 < len(there) < SHARDS
    assert_begins(jaxnet.run(jaxnet.load(parted, {"samples": MORE}), out).lanes)
    assert there.items() <= done(out).items()


SMALL = STUDY | {"samples": 2, "horizon": 2.0, "sweep": {"attack.magnitude": [1, 5.5]}}
FILES = ["study.yaml", "manifest.json", "lanes/00000.parquet", "lanes/00001.parquet", "cells.csv"]
KEPT = "what is finished is kept, the same command goes on or give another place with --out"


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> tuple[str, Results]:
    """The file of a study of two shards, and its results, undisturbed."""
    place = tmp_path_factory.mktemp("small")
    (place / "small.yaml").write_text(json.dumps(SMALL))
    return str(place / "small.yaml"), jaxnet.run(jaxnet.load(SMALL), place / "out")


def failing(real, error: int, after: int):
    """A function that does its work so many times, and fails then and ever after."""
    calls = []

    def function(*words, **keys):
        calls.append(words)
        if len(calls) > after:
            raise OSError(error, os.strerror(error))
        return real(*words, **keys)

    return function


ERRORS = [errno.EACCES, errno.ENOSPC, errno.EROFS, errno.ENOSPC, errno.EACCES]


def assert_equal(results: Results, whole: Results) -> None:
    assert results.lanes.equals(whole.lanes)
    assert results.errors.load().drop_attrs().identical(whole.errors.load().drop_attrs())


@pytest.mark.parametrize(("file", "error"), list(zip(FILES, ERRORS, strict=True)))
def test_a_disk_that_fails_in_the_middle_loses_nothing(small, tmp_path, monkeypatch, file, error):
    """Full, or read-only, as a file is written: one line says so, and the same command goes on."""
    config, whole = small
    out = tmp_path / "out"
    command = ["run", config, "--out", str(out)]
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", failing(os.fsync, error, FILES.index(file)))
        ended = CliRunner().invoke(main, command)
    assert ended.exit_code == 2, ended.output
    assert (
        ended.stderr.splitlines()[-1] == f"cannot write {out / file}: {os.strerror(error)}; {KEPT}"
    )
    assert "Traceback" not in ended.stderr
    assert {path.name for path in out.rglob(".*")} == {".lock"}
    there = done(out)
    assert len(there) == max(0, FILES[:4].index(file) - 2 if file in FILES[:4] else 2)
    assert CliRunner().invoke(main, command).exit_code == 0
    assert there.items() <= done(out).items()
    assert_equal(jaxnet.open(out), whole)


@pytest.mark.parametrize("after", [0, 24])
def test_a_disk_that_fails_within_arrays_loses_nothing(small, tmp_path, monkeypatch, after):
    """As the store is made, and as chunks are written."""
    from zarr.storage import _local

    config, whole = small
    command = ["run", config, "--out", str(tmp_path / "out")]
    with monkeypatch.context() as patch:
        patch.setattr(_local, "_put", failing(_local._put, errno.ENOSPC, after))
        ended = CliRunner().invoke(main, command)
    assert ended.exit_code == 2, ended.output
    stores = [
        f"cannot write {tmp_path / 'out' / name}: " for name in ("errors.zarr", "trajectories.zarr")
    ]
    *_, last = ended.stderr.splitlines()
    assert last in [f"{store}No space left on device; {KEPT}" for store in stores]
    assert CliRunner().invoke(main, command).exit_code == 0
    assert_equal(jaxnet.open(tmp_path / "out"), whole)
