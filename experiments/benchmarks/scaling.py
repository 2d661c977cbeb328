"""How does jaxnet's speed grow or fall with the lanes asked for, with vehicles and with cores?

Lanes per second on the cyclic graph over 30 s, with the defaults elsewhere: the nonlinear engine
and the exact one without trimming, and the exact one trimming each 0.05 s. Every point is a process
of its own; all points are run one after another, again and again: the median is shown with the
least and the greatest. A point that needs more than the budget is skipped with all larger ones of
its line, and said to be.

Run it with `python experiments/benchmarks/scaling.py`; it takes about half an hour. It prints a
table and draws docs/figures/scaling.png and scaling.pdf.
"""

import argparse
import math
import os
import platform
import statistics
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from row import apart, spread

from jaxnet.view.figures import style

FIGURES = Path(__file__).parents[2] / "docs" / "figures"
LEAST = 16  # lanes of a call, enough for some chunks of the largest fleets
PATIENCE = 3  # budgets until a point is given up: it draws its lanes and compiles, too


class Line(NamedTuple):
    """An engine at work: how it is drawn, and the lanes of a call if their number is fixed."""

    name: str
    keys: dict[str, Any]
    lanes: int
    look: dict[str, Any]


LINES = [
    Line(
        "nonlinear",
        {"defence": "none"},
        512,
        {"color": style.BLUE, "marker": "o", "linestyle": "-"},
    ),
    Line(
        "exact",
        {"defence": "none", "engine": "exact"},
        8_192,
        {"color": style.RED, "marker": "s", "linestyle": (0, (5, 1.5))},
    ),
    Line(
        "exact, trimming",
        {"engine": "exact"},
        4_096,
        {"color": style.GREEN, "marker": "^", "linestyle": (0, (1, 1))},
    ),
]
GUIDE: dict[str, Any] = {"color": "0.7", "linewidth": 0.8}
GUIDES = {"vehicles": -1, "cores": 1}  # powers to compare the lines with
SAMPLES = [100, 1_000, 10_000, 100_000, 1_000_000]
VEHICLES = [12, 48, 100, 300, 1_000, 3_000, 10_000]


class Point(NamedTuple):
    """One measurement: a line's, of what number along which axis."""

    axis: str  # lanes | vehicles | cores
    number: int
    line: Line

    def request(self, seconds: float) -> dict[str, Any]:
        """What to measure."""
        keys, lanes = {"attack": "rotating", **self.line.keys}, self.line.lanes
        if self.axis == "lanes":
            lanes = self.number
        elif self.axis == "vehicles":
            keys = {**keys, "vehicles": self.number}
            lanes = max(
                LEAST, 2 ** math.ceil(math.log2(lanes * VEHICLES[0] / self.number))
            )  # whole chunks
        return {"what": "jaxnet", "keys": keys, "lanes": lanes, "seconds": seconds}

    def cores(self) -> list[int]:
        """Cores it may use; none named, all."""
        return ours()[: self.number] if self.axis == "cores" else []


Rates = dict[tuple[str, int, str], list[float]]  # by axis, number and line


def ours() -> list[int]:
    """Cores of this process."""
    return sorted(os.sched_getaffinity(0))


def axes() -> dict[str, list[int]]:
    """Numbers along each axis."""
    return {"lanes": SAMPLES, "vehicles": VEHICLES, "cores": list(range(1, len(ours()) + 1))}


def main() -> None:
    """The table and the figure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--repeats", type=int, default=3, help="times that all points are run (default 3)"
    )
    parser.add_argument(
        "--seconds", type=float, default=3.0, help="least time of a point [s] (default 3)"
    )
    parser.add_argument(
        "--budget", type=float, default=60.0, help="most time of a point [s] (default 60)"
    )
    parser.add_argument(
        "--out", type=Path, default=FIGURES, help="folder of the figure (default docs/figures)"
    )
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    rates: Rates = {}
    for _ in range(given.repeats):
        race(rates, given.seconds, given.budget)
    print(f"{len(ours())} cores, {platform.machine()}\n")
    print("\n".join(table(rates, given.budget)))
    with mpl.rc_context(style.PRINT_STYLE):
        drawn = figure(rates)
        for suffix in ("png", "pdf"):
            drawn.savefig(given.out / f"scaling.{suffix}")


def race(rates: Rates, seconds: float, budget: float) -> None:
    """Every point once, along each line until it becomes too slow."""
    for axis, numbers in axes().items():
        for line in LINES:
            rate = math.inf
            for number in numbers:
                rate = measured(Point(axis, number, line), seconds, budget, rate)
                if rate is None:
                    break
                rates.setdefault((axis, number, line.name), []).append(rate)


def measured(point: Point, seconds: float, budget: float, before: float) -> float | None:
    """Lanes per second, None where they take too long: foreseen from the last point, or seen."""
    print(f"{point.line.name}, {point.number} {point.axis} …", file=sys.stderr, flush=True)
    request = point.request(seconds)
    if request["lanes"] > budget * before:
        return None
    try:
        return apart(request, point.cores(), PATIENCE * budget)["rate"]
    except subprocess.TimeoutExpired:
        return None


def table(rates: Rates, budget: float) -> Iterator[str]:
    """Medians and ranges in Markdown."""
    yield "| | " + " | ".join(f"{line.name} [lanes/s]" for line in LINES) + " |"
    yield "|---|" + "---|" * len(LINES)
    for axis, numbers in axes().items():
        for number in numbers:
            found = [rates.get((axis, number, line.name)) for line in LINES]
            cells = [spread(each) if each else f"skipped: over {budget:g} s" for each in found]
            yield f"| {axis}: {number:,} | " + " | ".join(cells) + " |"


def figure(rates: Rates) -> Figure:
    """A panel per axis, log-log: medians with bars from the least to the greatest."""
    drawn = Figure(figsize=(style.FIGURE_WIDTH, 2.5))
    panels = drawn.subplots(1, 3, sharey=True, width_ratios=[1.4, 1.4, 1])
    for panel, letter, (axis, numbers) in zip(panels, "abc", axes().items(), strict=True):
        for line in LINES:
            found = {n: rates[axis, n, line.name] for n in numbers if (axis, n, line.name) in rates}
            draw_line(panel, line, found, GUIDES.get(axis))
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.grid(True, axis="y", color="0.9", linewidth=0.5)
        panel.set_title(f"({letter}) {others(axis)}", pad=3)
        panel.set_xlabel(f"number of {axis}")
        if axis != "lanes":
            panel.set_xticks(numbers, [str(number) for number in numbers])
            panel.minorticks_off()
    panels[0].set_ylabel("lanes simulated per second [1/s]")
    handles, labels = panels[0].get_legend_handles_labels()
    handles.append(Line2D([], [], **GUIDE))
    labels.append("in proportion to 1 / vehicles and to cores")
    drawn.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return drawn


def others(axis: str) -> str:
    """What is held along an axis."""
    held = {"vehicles": f"{VEHICLES[0]} vehicles", "cores": f"{len(ours())} cores"}
    return ", ".join(text for name, text in held.items() if name != axis)


def draw_line(panel: Axes, line: Line, found: dict[int, list[float]], power: int | None) -> None:
    """One line of a panel, and how it would go on from its first point in proportion to a power."""
    if not found:
        return
    numbers, middle = (
        np.array(list(found)),
        np.array([statistics.median(rates) for rates in found.values()]),
    )
    low, high = (np.array([pick(rates) for rates in found.values()]) for pick in (min, max))
    if power is not None:
        panel.plot(numbers, middle[0] * (numbers / numbers[0]) ** float(power), **GUIDE, zorder=1)
    look = {**line.look, "markersize": 3.5, "capsize": 2, "elinewidth": 0.7}
    panel.errorbar(numbers, middle, yerr=[middle - low, high - middle], label=line.name, **look)


if __name__ == "__main__":
    main()
