"""What does accuracy cost? Lanes per second against the greatest error, for all solvers and peers.

Twelve vehicles, cyclic, none attacked, 30 s, 301 output times, at relative tolerances from 1e-4 to
1e-12; the absolute one is a hundredth of that. Every point is a process of its own. The error is
the greatest distance of any vehicle at any output time from the exact solution, over the first
lanes, the same for all.

Run it with `python experiments/benchmarks/precision.py`; it takes about a quarter of an hour. It
prints a table and draws docs/figures/precision.png and precision.pdf.
"""

import argparse
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure
from row import apart, shown

from jaxnet.view.figures import style

FIGURES = Path(__file__).parents[2] / "docs" / "figures"
TOLERANCES = [1e-4, 1e-6, 1e-8, 1e-10, 1e-12]
CHECKED = 12  # lanes held against the exact solution
PATIENCE = 60.0  # [s], for a point


class Line(NamedTuple):
    """A program: its lanes for one call, and how it is drawn."""

    name: str
    what: str
    solver: str | None  # of the nonlinear engine
    lanes: int
    color: str
    marker: str


LINES = [
    Line("jaxnet, gauss", "jaxnet", "gauss", 1_024, style.BLUE, "o"),
    Line("jaxnet, dopri8", "jaxnet", "dopri8", 512, style.BLUE, "^"),
    Line("jaxnet, dopri5", "jaxnet", "dopri5", 512, style.BLUE, "s"),
    Line("heyoka.py", "heyoka", None, 1_024, style.RED, "D"),
    Line("numba, 5(4)", "numba", None, 512, style.GREEN, "P"),
    Line("diffrax, Dopri5", "diffrax structured", None, 64, style.GREEN, "X"),
    Line("SciPy, RK45", "scipy structured", None, 12, style.GREEN, "*"),
]


def main() -> None:
    """The table and the figure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--seconds", type=float, default=1.0, help="least time of a point (default 1)"
    )
    parser.add_argument("--out", type=Path, default=FIGURES, help="folder of the figure")
    given = parser.parse_args()
    print(f"{os.cpu_count()} cores, {platform.machine()}\n")
    print("| | " + " | ".join(f"{tolerance:.0e}" for tolerance in TOLERANCES) + " |")
    print("|---" * (len(TOLERANCES) + 1) + "|")
    found = {line: points(line, given.seconds) for line in LINES}
    given.out.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(style.PRINT_STYLE):
        drawn = figure({line: each for line, each in found.items() if any(each)})
        for suffix in ("png", "pdf"):
            drawn.savefig(given.out / f"precision.{suffix}")
    print(f"\nwrote {given.out / 'precision.png'} and precision.pdf", file=sys.stderr)


def points(line: Line, seconds: float) -> list[tuple[float, float] | None]:
    """Print a row: error [m] and lanes per second at each tolerance, None where there is none."""
    found: list[tuple[float, float] | None] = []
    for tolerance in TOLERANCES:
        print(f"{line.name}, {tolerance:.0e} …", file=sys.stderr, flush=True)
        found.append(point(line, tolerance, seconds))
    cells = (f"{shown(each[1])}, {each[0]:.0e}" if each else "" for each in found)
    print(f"| {line.name} | " + " | ".join(cells) + " |", flush=True)
    return found


def point(line: Line, tolerance: float, seconds: float) -> tuple[float, float] | None:
    """Error [m] and lanes per second; None if the program is missing, fails or takes too long."""
    keys: dict[str, Any] = {"attack": "none", "defence": "none"}
    if line.solver:
        keys["engine"] = {"solver": line.solver, "rtol": tolerance, "atol": tolerance / 100}
    request = {
        "what": line.what,
        "keys": keys,
        "lanes": line.lanes,
        "seconds": seconds,
        "checked": CHECKED,
    }
    try:
        row = apart({**request, "tolerance": tolerance}, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        return None
    if "missing" in row:
        print(f"{row['missing']}: not on this machine", file=sys.stderr)
        return None
    return (row["error"], row["rate"]) if not row["failed"] else None


def figure(found: dict[Line, list[tuple[float, float] | None]]) -> Figure:
    """Lanes per second over the greatest error, a curve a program."""
    drawn = Figure(figsize=(style.FIGURE_WIDTH, 3.0), layout="constrained")
    axes = drawn.subplots()
    for line, each in found.items():
        errors, rates = zip(*filter(None, each), strict=True)
        filled = "full" if line.solver in (None, "gauss") else "none"
        look = {"color": line.color, "marker": line.marker, "fillstyle": filled, "markersize": 4.5}
        axes.plot(errors, rates, label=line.name, linewidth=1.0, **look)
    axes.set(xscale="log", yscale="log")
    axes.set_xlabel("greatest error [m]")
    axes.set_ylabel("lanes simulated per second [1/s]")
    axes.invert_xaxis()
    axes.grid(True, color="0.9", linewidth=0.5)
    drawn.legend(loc="outside right upper")
    return drawn


if __name__ == "__main__":
    main()
