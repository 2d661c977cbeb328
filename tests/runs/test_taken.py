"""Runs that are interrupted, taken over or terminated, and disks that fail: nothing is lost."""

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
from experiments import kill
from jaxnet.cli import main
from jaxnet.store import lock
from jaxnet.store.results import Results
from tests.runs.conftest import SHARDS, STUDY, done

pytestmark = pytest.mark.usefixtures("many_side_by_side")

IGNORED = ["sh", "-c", 'trap "" INT; exec "$@"', "sh"]  # as a shell starts what ends in &
WAIT = 120  # [s]
MORE = 500  # samples of a run that is interrupted


def started(config: Path, out: Path, before: list[str]) -> subprocess.Popen[str]:
    """A run, when its first shards are there."""
    run = [sys.executable, "-m", "jaxnet", "run", str(config), f"samples={MORE}", "--out", str(out)]
    null, pipe = subprocess.DEVNULL, subprocess.PIPE
    process = subprocess.Popen([*before, *run], stdout=null, stderr=pipe, text=True)
    deadline = time.monotonic() + WAIT
    while not done(out) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    return process


@pytest.mark.long
def test_a_run_in_the_background_that_is_taken_over_stops(parted, assert_begins, tmp_path):
    """Before its next write, while another simulates what is missing; no shard is written twice."""
    out = tmp_path / "out"
    first = started(parted, out, IGNORED)
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


KEPT = "what is finished is kept; the same command resumes"


@pytest.mark.long
@pytest.mark.parametrize(
    ("number", "before", "status", "last"),
    [
        (signal.SIGINT, [], 130, f"interrupted; {KEPT}"),
        (signal.SIGTERM, IGNORED, 143, f"terminated; {KEPT}"),
        (signal.SIGKILL, [], -9, None),
    ],
)
def test_a_run_is_stopped(number, before, status, last, parted, assert_begins, tmp_path):
    """With its status and a word; the same command goes on as if nothing had happened."""
    out = tmp_path / "out"
    process = started(parted, out, before)
    process.send_signal(number)
    _, said = process.communicate(timeout=WAIT)
    assert process.returncode == status, said
    assert last is None or said.splitlines()[-1] == last
    there = done(out)
    assert 0 < len(there) < SHARDS
    assert_begins(jaxnet.run(jaxnet.load(parted, {"samples": MORE}), out).lanes)
    assert there.items() <= done(out).items()


@pytest.mark.long
def test_a_run_killed_twice_ends_as_one_left_alone(tmp_path):
    """No reader ever sees a torn table, and no shard is written twice."""
    study = kill.STUDY | {key: STUDY[key] for key in ("topology", "defence")} | {"samples": 256}
    study["sweep"] = {"attack.magnitude": {"linspace": [0, 10, 24]}}
    config, whole, broken = kill.written(study, tmp_path), tmp_path / "whole", tmp_path / "broken"
    jaxnet.run(config, whole)
    with kill.watched(broken) as reader:
        brought = [kill.run_and_kill(config, broken, delay) for delay in (0.05, 0.13)]
        _, shards = kill.run_through(config, broken)
    assert min(brought) > 0
    assert sum(brought) < shards == 24
    assert reader.reads > shards
    kill.compare(broken, whole)


SMALL = STUDY | {"samples": 2, "horizon": 2.0, "sweep": {"attack.magnitude": [1, 5.5]}}


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> tuple[str, Results]:
    """The file of a study of two shards, and its results, undisturbed."""
    place = tmp_path_factory.mktemp("small")
    (place / "small.yaml").write_text(json.dumps(SMALL))
    return str(place / "small.yaml"), jaxnet.run(jaxnet.load(SMALL), place / "out")


@pytest.mark.parametrize(
    ("files", "error", "file", "shards"),
    [
        (0, errno.EACCES, "study.yaml", 0),
        (1, errno.ENOSPC, "manifest.json", 0),
        (3, errno.EROFS, "lanes/00001.parquet", 1),
        (4, errno.EACCES, "cells.csv", 2),
        (None, errno.ENOSPC, "errors.zarr", 0),  # as the store is made
        (24, errno.ENOSPC, "errors.zarr", 0),  # as chunks are written
    ],
)
def test_a_disk_that_fails_in_the_middle_loses_nothing(
    small, tmp_path, monkeypatch, files, error, file, shards
):
    """Full, or read-only, as a file is written: one line says so, and the same command goes on."""
    from zarr.storage import _local

    config, whole = small
    out, calls = tmp_path / "out", []
    command = ["run", config, "--out", str(out)]
    module, name = (_local, "_put") if file == "errors.zarr" else (os, "fsync")
    real = getattr(module, name)

    def failing(*words, **keys):
        calls.append(words)
        if len(calls) > (files or 0):
            raise OSError(error, os.strerror(error))
        return real(*words, **keys)

    with monkeypatch.context() as patch:
        patch.setattr(module, name, failing)
        ended = CliRunner().invoke(main, command)
    assert ended.exit_code == 2, ended.output
    last = ended.stderr.splitlines()[-1]
    advice = f"{KEPT} or give another place with --out"
    assert last == f"cannot write {out / file}: {os.strerror(error)}; {advice}"
    assert "Traceback" not in ended.stderr
    assert {path.name for path in out.rglob(".*")} == {".lock"}
    there = done(out)
    assert len(there) == shards
    assert CliRunner().invoke(main, command).exit_code == 0
    assert there.items() <= done(out).items()
    results = jaxnet.open(out)
    assert results.lanes.equals(whole.lanes)
    assert results.errors.load().drop_attrs().identical(whole.errors.load().drop_attrs())
