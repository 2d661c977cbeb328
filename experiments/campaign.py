"""A million lanes on workers that are killed on the way: does the study end as if none had been?

Runs configs/campaign.yaml with two workers: a ring of twelve, trimmed, at four frequencies and
eight sizes of the attack, 31,250 draws each. A worker is killed (SIGKILL) three times, the command
itself once, and given again; then the report is made. Printed are wall times, the peak memory of
each kind of process, and whether all rows are there; a sample of shards is simulated anew,
undisturbed, and must be equal to the last bit.

Run it with `python experiments/campaign.py`, or with less: `--samples 400`.
"""

import contextlib
import functools
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

import click
import numpy as np
import pandas as pd

import jaxnet
from jaxnet.engine import batch
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.runs.cache import enable
from jaxnet.store import rows
from jaxnet.store.folder import Folder
from jaxnet.store.results import Results

CONFIG = Path(__file__).parents[1] / "configs" / "campaign.yaml"
KILLS = [
    (0.15, "worker"),
    (0.35, "worker"),
    (0.5, "command"),
    (0.75, "worker"),
]  # share of shards done, who
AGAIN = 8  # shards simulated anew
POLL = 0.2  # [s]


@click.command()
@click.option("--samples", type=int, help="Draws a cell.  [default: the config's]")
@click.option("--out", default="results/campaign", show_default=True)
def main(samples: int | None, out: str) -> None:
    """Run, kill, run on, report, compare."""
    overrides = [] if samples is None else [f"samples={samples}"]
    study, folder, campaign = jaxnet.load(CONFIG, overrides), Path(out), Campaign(Path(out))
    shutil.rmtree(folder, ignore_errors=True)
    run = ["run", str(CONFIG), *overrides, "--out", out, "--workers", "2"]
    began = time.monotonic()
    while not campaign.ended(run, list(KILLS)):
        print(f"{time.monotonic() - began:.0f} s: the command is given again", flush=True)
    simulated = time.monotonic() - began
    campaign.ended(["report", out], [])
    reported = time.monotonic() - began - simulated
    results = jaxnet.open(folder)
    lanes = results.manifest["lanes"]
    assert (lanes["total"], campaign.killed) == (study.lanes, [who for _, who in KILLS])
    print(f"killed: {', '.join(campaign.killed)}")
    print(
        f"{lanes['total']:,} lanes, {len(results.shards)} shards, {lanes['failed']} failed",
        end=": ",
    )
    print(f"{simulated:.0f} s, {lanes['total'] / simulated:,.0f} lanes/s, what was lost included")
    print(f"fits, worst lanes again, figures and the page: {reported:.0f} s")
    for kind, most in campaign.peak.items():
        print(f"peak memory, {kind}: {most / 2**10:,.0f} MiB")
    print(f"{compared(results):,} rows simulated anew, undisturbed: equal to the last bit")


class Campaign:
    """Watched and disturbed commands; who was killed, and peak memory [KiB] by kind of process."""

    def __init__(self, folder: Path):
        self.folder, self.killed = folder, list[str]()
        self.peak: dict[str, int] = defaultdict(int)

    def ended(self, command: list[str], kills: list[tuple[float, str]]) -> bool:
        """Whether the command ended: False if it was killed; raises RuntimeError if it failed."""
        process = subprocess.Popen(
            [sys.executable, "-m", "jaxnet", *command], stderr=subprocess.PIPE, text=True
        )
        while process.poll() is None:
            workers = workers_of(process.pid)
            for kind, pids in ((command[0], [process.pid]), ("worker", workers)):
                self.peak[kind] = max([self.peak[kind], *map(resident, pids)])
            at, who = (
                kills[len(self.killed)] if len(self.killed) < len(kills) else (np.inf, "nobody")
            )
            if self.share() >= at and (workers or who == "command"):
                self.killed.append(who)
                os.kill(process.pid if who == "command" else workers[0], signal.SIGKILL)
                if who == "command":
                    process.communicate()
                    return False
            time.sleep(POLL)
        said = process.stderr.read() if process.stderr else ""
        print(said, end="", flush=True)
        if process.returncode:
            raise RuntimeError(f"{command[0]} ended with status {process.returncode}")
        return True

    def share(self) -> float:
        """Share of the shards that are done."""
        there = len(list(self.folder.glob("lanes/[0-9]*.parquet")))
        return there / self.shards if there else 0.0

    @functools.cached_property
    def shards(self) -> int:
        """Shards in all."""
        manifest = Folder(self.folder).manifest
        cells = len(jaxnet.load(self.folder / "study.yaml").cells)
        return cells * -(-manifest["samples"] // manifest["shard_size"])


def workers_of(command: int) -> list[int]:
    """The worker processes of a command: children of the child that they are split off from."""
    parents = dict[int, int]()
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it has just ended
            parent = re.search(r"^PPid:\s+(\d+)", (entry / "status").read_text(), re.MULTILINE)
            parents[int(entry.name)] = int(parent[1]) if parent else 0
    return [process for process, parent in parents.items() if parents.get(parent) == command]


def resident(pid: int) -> int:
    """Most memory [KiB] that a process has held; 0 if it has ended."""
    with contextlib.suppress(OSError):
        held = re.search(r"^VmHWM:\s+(\d+)", Path(f"/proc/{pid}/status").read_text(), re.MULTILINE)
        return int(held[1]) if held else 0
    return 0


def compared(results: Results) -> int:
    """How many rows of some shards equal those simulated in this process; raises if one differs."""
    enable()
    config, shards, count = results.study.config, results.shards, 0
    cells = results.study.cells
    columns = rows.row_columns(config, cells)
    for number in np.random.default_rng(0).choice(len(shards), AGAIN, replace=False):
        shard = shards[number]
        outcome = batch.simulate(job(shard.cell.scenario, Keyed(config.seed), shard.samples))
        stored = rows.read_rows(results.path / rows.row_file(shard.number))[0].to_pandas()
        pd.testing.assert_frame_equal(
            columns.table(shard, outcome).to_pandas(),
            stored,
            check_exact=True,
        )
        count += len(stored)
    return count


if __name__ == "__main__":
    main()
