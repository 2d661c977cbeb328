"""Does a run that is killed again and again lose, repeat or tear anything?

A sweep of two hundred shards is run to its end once, undisturbed. Then the same command is run and
killed (SIGKILL) at a random moment after a new shard has appeared, and given again, until the study
is complete. All the while a reader opens every table that it finds in the folder: none may ever be
torn, and no shard may be written twice. At the end rows, errors.zarr, cells.csv and study.yaml must
be those of the undisturbed run.

Run it with `python experiments/kill.py`, or with `--kills 50 --seed 1`; twenty kills take a few
minutes.
"""

import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd
import xarray as xr
import yaml

import jaxnet

STUDY: dict[str, Any] = {
    "name": "kill",
    "samples": 200,
    "horizon": 5.0,
    "tail": 1.0,
    "engine": "exact",
    "sweep": {"attack.magnitude": {"linspace": [0, 10, 240]}},
    "save": {"errors": True},
}
POLL = 0.005  # [s]


@click.command()
@click.option("--kills", default=20, show_default=True)
@click.option("--seed", default=0, show_default=True)
def main(kills: int, seed: int) -> None:
    """Undisturbed, then killed, then compared."""
    with tempfile.TemporaryDirectory() as place:
        whole, broken = Path(place) / "whole", Path(place) / "broken"
        config = written(STUDY, Path(place))
        took, shards = run_through(config, whole)
        print(f"undisturbed: {shards} shards in {took:.1f} s after the first", flush=True)
        random, cut = np.random.default_rng(seed), list[str]()
        with watched(broken) as reader:
            for number in range(kills):
                left = 1 - len(done(broken)) / shards
                delay = random.uniform(0, 1.5) * took * left / (kills - number + 1)
                brought = run_and_kill(config, broken, delay)
                cut += unfinished(broken)
                print(
                    f"life {number + 1}: {brought} shards, killed after {delay:.2f} s", flush=True
                )
            before = len(done(broken))
            run_through(config, broken)
            print(f"last life: {len(done(broken)) - before} shards", flush=True)
        assert not unfinished(broken)
        compare(broken, whole)
        print(f"{reader.reads} tables read on the way, none torn, no shard written twice")
        print(
            f"{kills} kills, {len(cut)} within the writing of a table: {', '.join(cut) or 'none'}"
        )
        print("all is equal to the undisturbed run")


def written(study: dict[str, Any], place: Path) -> Path:
    """The study's file."""
    config = place / "kill.yaml"
    config.write_text(yaml.safe_dump(study, sort_keys=False))
    return config


def done(folder: Path) -> list[Path]:
    """Files of the shards that are done."""
    return sorted(folder.glob("lanes/*.parquet"))


def unfinished(folder: Path) -> list[str]:
    """Names of the tables that the last run was writing when killed; the next run removes them."""
    return [path.name for path in folder.rglob(".*") if path.is_file() and path.name != ".lock"]


def started(config: Path, folder: Path) -> subprocess.Popen[str]:
    """The command on its way, when it has brought a new shard (or ended)."""
    before = len(done(folder))
    command = [sys.executable, "-m", "jaxnet", "run", str(config), "--out", str(folder)]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    while process.poll() is None and len(done(folder)) == before:
        time.sleep(POLL)
    return process


def run_through(config: Path, folder: Path) -> tuple[float, int]:
    """Run to the end; seconds since the first new shard, and shards in all."""
    process, began = started(config, folder), time.monotonic()
    _, said = process.communicate()
    if process.returncode:
        raise RuntimeError(f"the run ended with status {process.returncode}: {said}")
    return time.monotonic() - began, len(done(folder))


def run_and_kill(config: Path, folder: Path, delay: float) -> int:
    """Kill the run so many seconds after its first new shard; how many shards it has brought."""
    before, process = len(done(folder)), started(config, folder)
    try:
        _, said = process.communicate(timeout=delay)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return len(done(folder)) - before
    raise RuntimeError(
        f"the run ended with status {process.returncode} before it was killed: {said}"
    )


class Reader:
    """Opens tables as they appear and counts its reads; a torn one raises."""

    def __init__(self, folder: Path):
        self.folder, self.reads = folder, 0
        self.seen: dict[Path, tuple[int, int]] = {}

    def look(self) -> None:
        """Read every table that is new or was replaced."""
        tables = [*done(self.folder), self.folder / "manifest.json", self.folder / "cells.csv"]
        for path in tables:
            if not path.exists():
                continue
            about = path.stat()
            stamp = about.st_ino, about.st_mtime_ns
            if self.seen.get(path) != stamp:
                self.read(path)
                self.seen[path] = stamp

    def read(self, path: Path) -> None:
        """One table, whole."""
        self.reads += 1
        if path.suffix == ".parquet":
            if path in self.seen:
                raise AssertionError(f"{path.name} was written twice")
            assert len(set(pd.read_parquet(path)["cell"])) == 1
        elif path.suffix == ".json":
            assert "finished" in json.loads(path.read_text())
        else:
            assert len(pd.read_csv(path)) == len(jaxnet.load(self.folder / "study.yaml").cells)


@contextmanager
def watched(folder: Path) -> Iterator[Reader]:
    """A reader of the folder at work beside; what it came upon is raised at the end."""
    reader, stop = Reader(folder), threading.Event()

    def keep_looking() -> None:
        while not stop.wait(POLL):
            reader.look()

    with ThreadPoolExecutor(1) as beside:
        looking = beside.submit(keep_looking)
        try:
            yield reader
        finally:
            stop.set()
        looking.result()
    reader.look()


def compare(ours: Path, theirs: Path) -> None:
    """Raise unless both folders hold the same."""
    mine, other = jaxnet.open(ours), jaxnet.open(theirs)
    pd.testing.assert_frame_equal(mine.lanes, other.lanes, check_exact=True)
    for name in ("cells.csv", "study.yaml"):
        assert (ours / name).read_bytes() == (theirs / name).read_bytes(), name
    manifests = [{**each.manifest, "wall_seconds": None} for each in (mine, other)]
    assert manifests[0] == manifests[1]
    if (theirs / "errors.zarr").exists():
        xr.testing.assert_equal(mine.errors.load(), other.errors.load())


if __name__ == "__main__":
    main()
