"""What processes of their own cost, and what a second one brings.

Whole commands on 10⁵ lanes of the exact engine, trimmed, horizon 30 s: one process on two cores,
one worker with one core, two workers with one core each, and two such workers of a scheduler that
runs already. Every command is run into an empty folder, in turn, with a warm compilation cache.
Printed are the least and the median wall times with all that a command does, and lanes per second
from the first to the last shard, which leave the start out.

Run it with `python experiments/benchmarks/cluster.py`; three rounds take about ten minutes.
"""

import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click
import yaml
from distributed import LocalCluster

from jaxnet.engine.methods.exact import Exact

STUDY = {"name": "cluster", "samples": 0, "engine": "exact", "sweep": {"attack.magnitude": [1, 5]}}
WAYS = {
    "one process, two cores": ("--devices", "2"),
    "one worker of one core": ("--workers", "1", "--devices", "1"),
    "two workers of one core": ("--workers", "2", "--devices", "2"),
    "two that run already": ("--cluster",),
}
POLL = 0.01  # [s]


@click.command()
@click.option("--lanes", default=100_000, show_default=True)
@click.option("--rounds", default=3, show_default=True)
@click.option("--defence", default="trusted_trim", show_default=True)
def main(lanes: int, rounds: int, defence: str) -> None:
    """Time every way in turn and print them side by side."""
    print(f"{os.cpu_count()} cores, {platform.machine()}; {lanes:,} lanes, defence {defence}\n")
    with tempfile.TemporaryDirectory() as place:
        config = Path(place) / "cluster.yaml"
        study = STUDY | {"samples": lanes // 2, "defence": defence}
        config.write_text(yaml.safe_dump(study))
        timed(config, ("--devices", "1"), "samples=1")  # fills the compilation cache
        times: dict[str, list[tuple[float, float]]] = {name: [] for name in WAYS}
        for _ in range(rounds):
            for name, way in WAYS.items():
                times[name].append(
                    timed_there(config) if way == ("--cluster",) else timed(config, way)
                )
    print(f"{'':26}{'least [s]':>10}{'median [s]':>12}{'lanes/s':>10}{'after the first':>17}")
    seconds, rates = {}, {}
    for name, seen in times.items():
        whole, after = zip(*seen, strict=True)
        seconds[name], rates[name] = statistics.median(whole), statistics.median(after)
        rate = lanes / seconds[name]
        print(f"{name:26}{min(whole):10.1f}{seconds[name]:12.1f}{rate:10.0f}{rates[name]:17.0f}")
    process, one, two, there = WAYS
    print(f"\ntwo workers over one: {seconds[one] / seconds[two]:.2f} × as fast,", end=" ")
    print(f"{rates[two] / rates[one]:.2f} × after the first shard")
    for way, what in ((two, "two workers"), (there, "two that run already")):
        print(
            f"{what} take {seconds[way] / seconds[process]:.2f} × the time of one process,", end=" "
        )
        print(f"{rates[process] / rates[way]:.2f} × after the first shard")


def timed_there(config: Path) -> tuple[float, float]:
    """As `timed`, given to two new workers of a scheduler of this process."""
    with LocalCluster(n_workers=2, threads_per_worker=1, memory_limit=None) as cluster:
        return timed(config, ("--cluster", str(cluster.scheduler_address)))  # pyright: ignore[reportAttributeAccessIssue]


def timed(config: Path, way: tuple[str, ...], *overrides: str) -> tuple[float, float]:
    """Wall seconds of a command, and lanes per second after its first shard."""
    out = config.with_name("out")
    command = [
        sys.executable,
        "-m",
        "jaxnet",
        "run",
        str(config),
        *overrides,
        "--out",
        str(out),
        *way,
    ]
    began, seen = time.monotonic(), list[float]()
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    while process.poll() is None:
        there = len(list(out.glob("lanes/[0-9]*.parquet")))
        seen += [time.monotonic()] * (there - len(seen))
        time.sleep(POLL)
    took = time.monotonic() - began
    if process.returncode:
        raise RuntimeError(process.stderr.read() if process.stderr else "")
    shutil.rmtree(out)
    after = (len(seen) - 1) * Exact.shard / (seen[-1] - seen[0]) if len(seen) > 2 else float("nan")
    return took, after


if __name__ == "__main__":
    main()
