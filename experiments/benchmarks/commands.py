"""How long do whole commands take, as users give them, beside another version and beside peers?

Each command is a process of its own, with start-up, files and compiling. The commands of a round
run one after another; versions and peers take turns. A line has the least of all repeats. The first
repeat also compiles programs, so there are two at least.

    python experiments/benchmarks/commands.py --against CHECKOUT --out commands.csv

ends with status 1 if a line lost over 10 % of its speed against the other version. Rates are per
processor second, which other processes hardly change: two cores do nearly twice as many a second.
Wall seconds, and how a report compares with its run, are shown, not judged. A repeat takes some
five minutes a version. What stands in commands.csv is not measured again.
"""

import argparse
import csv
import itertools
import os
import platform
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import peers
import yaml
from row import apart, shown

LOST = 0.9  # of the speed of the other version
MANY, LONG = 8_192, 100_000  # lanes of "all included", values of "long sweep"
HERE = Path(__file__).parents[2]
NOBODY = {"attack": "none", "defence": "none"}


class Step(NamedTuple):
    """A command, with its number of lanes or cells; `cold`: no program is compiled before."""

    words: str
    number: int = 0
    cold: bool = False


class Times(NamedTuple):
    """Seconds of a command."""

    cpu: float
    wall: float


Record = dict[tuple[str, ...], list[Times]]  # of each step, by round, side and repeat


def run(study: str, number: int = 0, cold: bool = False) -> Step:
    """A study, simulated anew."""
    return Step(f"run {study} --out out --fresh", number, cold)


def drawn(words: str, *lanes: int, cold: bool = False) -> list[Step]:
    """A cell with each of these numbers of lanes."""
    return [run(f"study.yaml {words} samples={n}", n, cold) for n in lanes]


def swept(cells: int, samples: int) -> str:
    """Cells of the exact engine."""
    spacing = f'sweep.attack.magnitude={{"linspace":[1,10,{cells}]}}'
    return f"study.yaml engine=exact defence=none samples={samples} {spacing}"


PLAIN = "attack=none defence=none"
QUICK = f"{HERE / 'configs' / 'quick.yaml'} engine=nonlinear horizon=30 samples=5"
ROUNDS = {
    "help": [Step("--help")],
    "exact": drawn("engine=exact defence=none", 512, 16_384, 131_072),
    "trimming": drawn("engine=exact defence=trusted_trim", 512, 8_192, 65_536),
    "nonlinear": drawn(PLAIN, 512, 4_096, 32_768),
    "all included": [*drawn(PLAIN, MANY), *drawn(PLAIN, MANY, cold=True)],
    "quick": [run(QUICK, cold=True)],
    "many cells": [run(swept(2_000, 8), 2_000)],
    "tables": [run(swept(300, 8)), *map(Step, ("show out", "fit out", f"check {swept(300, 8)}"))],
    "report": [run(QUICK), Step("report out")],
    "long sweep": [Step(f"check {swept(LONG, 1)}"), Step("check list.yaml")],
}
PEERS = {  # for the rates; heyoka.py is imported and compiled within its time
    "exact": [Step(f"exact_loop {n} 0", n) for n in (65_536, 524_288)],
    "trimming": [Step(f"exact_loop {n} 1", n) for n in (32_768, 262_144)],
    "nonlinear": [Step(f"nonlinear_loop {n}", n) for n in (2_048, 8_192)],
    "all included": [Step("heyoka", MANY)] * 2,
}


class Line(NamedTuple):
    """A line of the table: what one step of a round took, or how fast it was."""

    name: str
    unit: str
    round: str
    step: int = 0

    def value(self, record: Record, side: str) -> float | None:
        """The number by the least times of a side, None where they were not measured."""
        rounds = [each for place, each in record.items() if place[:2] == (self.round, side)]
        times = [Times(*map(min, zip(*step, strict=True))) for step in zip(*rounds, strict=True)]
        if not times or (side == "peer" and "/CPU s" not in self.unit):
            return None
        counts = [step.number for step in (PEERS if side == "peer" else ROUNDS)[self.round]]
        now, last = times[self.step], times[self.step - 1]
        match self.unit:
            case "CPU s":
                return now.cpu
            case "wall s":
                return now.wall
            case "times its run":
                return now.cpu / last.cpu
            case "more lanes/CPU s":
                return (counts[self.step] - counts[self.step - 1]) / (now.cpu - last.cpu)
        return counts[self.step] / now.cpu

    def row(self, record: Record) -> tuple[str, bool]:
        """The line in Markdown, and whether it lost against the other version."""
        now, *others = (self.value(record, side) for side in ("now", "before", "peer"))
        rises = "/CPU s" in self.unit
        fast = [other and now and (now / other if rises else other / now) for other in others]
        numbers = now, *itertools.chain(*zip(others, fast, strict=True))
        text = " | ".join("" if each is None else shown(each) for each in numbers)
        lost = self.unit not in ("wall s", "times its run") and (fast[0] or 1) < LOST
        return f"| {self.name} | {self.unit} | {text} |", lost


LINES = [
    Line("`--help`", "CPU s", "help"),
    *(
        line
        for name in ("exact", "trimming", "nonlinear")
        for line in (
            Line(f"`run`, 512 lanes, {name}", "CPU s", name),
            Line(f"`run`, 512 lanes, {name}", "wall s", name),
            Line(f"`run`, each lane more, {name}", "more lanes/CPU s", name, -1),
        )
    ),
    Line(f"`run`, {MANY:,} lanes, nonlinear", "lanes/CPU s", "all included"),
    Line("the same, nothing compiled before", "lanes/CPU s", "all included", 1),
    Line("`run`, 15 nonlinear lanes, nothing compiled before", "CPU s", "quick"),
    Line("`run`, 15 nonlinear lanes, nothing compiled before", "wall s", "quick"),
    Line("`run`, 2,000 cells of 8 exact lanes", "cells/CPU s", "many cells"),
    Line("`show`, 300 cells", "CPU s", "tables", 1),
    Line("`fit`, 300 cells", "CPU s", "tables", 2),
    Line("`check`, 300 cells", "CPU s", "tables", 3),
    Line("`report`, 15 nonlinear lanes", "CPU s", "report", 1),
    Line("`report`, 15 nonlinear lanes", "times its run", "report", 1),
    Line(f"`check`, {LONG:,} values by a spacing", "CPU s", "long sweep"),
    Line(f"`check`, {LONG:,} values in a list", "CPU s", "long sweep", 1),
]


def timed(step: Step, folder: Path, checkout: str | None) -> Times:
    """A command of a checkout, or of a peer; raises NotInstalledError if the peer is absent."""
    program, *words = step.words.split()
    if program == "heyoka":
        found = apart({"what": program, "keys": NOBODY, "lanes": step.number, "warmed": False})
        if "missing" in found:
            raise peers.NotInstalledError(found["missing"])
        return Times(step.number / found["rate"] * found["cores"], step.number / found["rate"])
    command = [sys.executable, "-m", "jaxnet", program] if checkout else [peers.loop(program)]
    with tempfile.TemporaryDirectory() as empty:
        settings = {"JAX_COMPILATION_CACHE_DIR": empty} if step.cold else {}
        settings |= {"PYTHONPATH": checkout} if checkout else {}
        began, before = time.perf_counter(), spent()
        environment = os.environ | settings
        subprocess.run(
            [*command, *words], cwd=folder, env=environment, stdout=subprocess.DEVNULL, check=True
        )
        return Times(spent() - before, time.perf_counter() - began)


def spent() -> float:
    """Processor seconds of all commands up to now."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measured(place: tuple[str, ...], folder: Path, checkout: str | None) -> list[Times]:
    """The steps of a round, in a folder without results; none where the peer is absent."""
    print(f"{', '.join(place)} …", file=sys.stderr, flush=True)
    shutil.rmtree(folder / "out", ignore_errors=True)
    try:
        return [timed(step, folder, checkout) for step in (ROUNDS if checkout else PEERS)[place[0]]]
    except peers.NotInstalledError as missing:
        print(f"{missing}: not on this machine", file=sys.stderr)
        return []


def main() -> None:
    """Measure what is missing, print the table, judge it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--against", metavar="CHECKOUT", help="a folder with another jaxnet")
    parser.add_argument("--repeats", type=int, default=3, help="at least 2 (default 3)")
    parser.add_argument("--only", default="", metavar="WORD", help=f"of {', '.join(ROUNDS)}")
    parser.add_argument("--out", type=Path, metavar="FILE.csv", help="for times, and to go on")
    given = parser.parse_args()
    sides = {"now": str(HERE), "before": given.against, "peer": None}
    names, record = [name for name in ROUNDS if given.only in name], Record()
    with tempfile.TemporaryDirectory() as place:
        folder, study = Path(place), {"name": "commands", "samples": 1}
        values = [1.0 + number / 7 for number in range(LONG)]
        listed = {"engine": "exact", "sweep": {"attack.magnitude": values}}
        (folder / "study.yaml").write_text(yaml.safe_dump(study))
        (folder / "list.yaml").write_text(yaml.safe_dump(study | listed))
        file = given.out or folder / "times.csv"
        for *key, _, cpu, wall in csv.reader(file.open()) if file.exists() else ():
            record.setdefault(tuple(key), []).append(Times(float(cpu), float(wall)))
        for repeat, name, side in itertools.product(range(given.repeats), names, sides):
            key = name, side, str(repeat)
            there = name in PEERS if side == "peer" else sides[side]
            if there and key not in record:
                record[key] = measured(key, folder, sides[side])
                with file.open("a", newline="") as rows:
                    steps = enumerate(record[key])
                    csv.writer(rows).writerows((*key, step, *times) for step, times in steps)
    table = [line.row(record) for line in LINES if line.round in names]
    print(f"{os.cpu_count()} cores, {platform.machine()}\n")
    print("| what | unit | now | before | now to before | peer | now to peer |")
    print(f"{'|---' * 7}|", *(text for text, _ in table), sep="\n")
    sys.exit(any(lost for _, lost in table))


if __name__ == "__main__":
    main()
