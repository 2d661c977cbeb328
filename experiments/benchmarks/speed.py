"""How fast is jaxnet beside the programs that one would write without it, on the same lanes?

heyoka.py and numba come with `pip install --editable ".[benchmarks]"`.

Twelve vehicles, cyclic, 30 s, 301 output times, 5(4) at rtol 1e-7 and atol 1e-9. Every line is a
process of its own, one after another, and the sequence is repeated: lanes per second are the median
with the least and the greatest, ratios the median of those within a repeat. `cores` is processor
time over time. The greatest error is the distance of any vehicle at any output time (at any tick,
where vehicles decide) from the exact solution, over the first lanes, the same for all; it is left
out where vehicles decide axis by axis, and of the loop in C, which draws lanes of its own.

Run it with `python experiments/benchmarks/speed.py`; it takes about fourteen minutes.
"""

import argparse
import os
import platform
import statistics
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

from row import apart, shown, spread

NOBODY, ATTACKED = {"attack": "none", "defence": "none"}, {"attack": "rotating", "defence": "none"}
EXACT = {"engine": "exact"}
REFERENCE = "SciPy RK45, dense M"
STRONGEST = "heyoka.py, Taylor's method"
CHECKED = 12  # lanes held against the exact solution


class Line(NamedTuple):
    """A line of the table: a program, a scenario, and lanes for one call of it."""

    name: str
    attack: str
    what: str
    keys: dict[str, Any]
    lanes: int
    checked: bool = True  # whether it is held against the exact solution


def ruled(name: str, defence: str, checked: bool = True) -> Line:
    """Lanes of the exact engine in which a rule decides at every tick, of 0.05 s."""
    keys = EXACT | {"defence": defence}
    return Line(f"jaxnet exact, {name} each 0.05 s", "rotating", "jaxnet", keys, 4_096, checked)


LINES = [
    Line("GNU Octave ode45, dense M", "none", "octave dense", NOBODY, 4),
    Line(REFERENCE, "none", "scipy dense", NOBODY, 12),
    Line("SciPy RK45, structured solve", "none", "scipy structured", NOBODY, 12),
    Line("diffrax Dopri5, dense M", "none", "diffrax dense", NOBODY, 64),
    Line("diffrax Dopri5, structured solve", "none", "diffrax structured", NOBODY, 64),
    Line("numba, Dormand–Prince 5(4)", "none", "numba", NOBODY, 1_024),
    Line("numba, Dormand–Prince 5(4)", "rotating", "numba", ATTACKED, 1_024),
    Line(STRONGEST, "none", "heyoka", NOBODY, 2_048),
    Line(STRONGEST, "rotating", "heyoka", ATTACKED, 2_048),
    Line(
        "jaxnet nonlinear, dopri5",
        "none",
        "jaxnet",
        NOBODY | {"engine": {"solver": "dopri5"}},
        2_048,
    ),
    Line("jaxnet nonlinear", "none", "jaxnet", NOBODY, 8_192),
    Line("jaxnet nonlinear", "rotating", "jaxnet", ATTACKED, 8_192),
    Line("jaxnet nonlinear, trimming each 0.05 s", "rotating", "jaxnet", {}, 4_096),
    Line("jaxnet exact", "rotating", "jaxnet", ATTACKED | EXACT, 16_384),
    Line("jaxnet exact, trimming each 0.05 s", "rotating", "jaxnet", EXACT, 8_192),
    Line("the exact loop in C", "rotating", "by hand", ATTACKED | EXACT, 16_384, checked=False),
    Line(
        "the exact loop in C, trimming each 0.05 s",
        "rotating",
        "by hand",
        EXACT,
        16_384,
        checked=False,
    ),
    ruled("W-MSR", "w_msr", checked=False),
    ruled("coordinate median", "coordinate_median", checked=False),
    ruled("geometric median", "geometric_median"),
]


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--repeats", type=int, default=3, help="times that the sequence is run (default 3)"
    )
    parser.add_argument(
        "--seconds", type=float, default=5.0, help="least time of a line (default 5)"
    )
    given = parser.parse_args()
    rounds = [
        [measured(line, given.seconds, check=number == 0) for line in LINES]
        for number in range(given.repeats)
    ]
    print(f"{os.cpu_count()} cores, {platform.machine()}\n")
    print(
        "| what | attack | lanes | lanes/s | ratio | cores"
        " | greatest error [m] | peak memory [MiB] |"
    )
    print("|---|---|---|---|---|---|---|---|")
    reference = [row["rate"] for row in (each[position(REFERENCE)] for each in rounds)]
    for number, line in enumerate(LINES):
        print(text(line, [each[number] for each in rounds], reference))


def position(name: str) -> int:
    """Where a line stands."""
    return next(number for number, line in enumerate(LINES) if line.name == name)


def measured(line: Line, seconds: float, check: bool) -> dict[str, Any]:
    """One line, once; its error is the same every time."""
    print(f"{line.name}, attack {line.attack} …", file=sys.stderr, flush=True)
    checked = min(CHECKED, line.lanes) if check and line.checked else 0
    request = {"what": line.what, "keys": line.keys, "lanes": line.lanes, "checked": checked}
    return apart({**request, "seconds": seconds})


def text(line: Line, rows: Sequence[dict[str, Any]], reference: Sequence[float]) -> str:
    """A line's results in Markdown."""
    name = f"| {line.name} | {line.attack} |"
    if "missing" in rows[0]:
        return f"{name} {rows[0]['missing']}: not on this machine |" + " |" * 5
    rates = [row["rate"] for row in rows]
    ratio = statistics.median(rate / base for rate, base in zip(rates, reference, strict=True))
    cores, memory = (statistics.median(row[key] for row in rows) for key in ("cores", "memory"))
    failed = rows[0]["failed"]
    lanes = f"{rows[0]['lanes']:,}" + (f" ({failed} failed)" if failed else "")
    error = f"{rows[0]['error']:.1e}" if line.checked else ""
    speed = f"{spread(rates)} | {shown(ratio)} | {cores:.1f}"
    return f"{name} {lanes} | {speed} | {error} | {memory:,.0f} |"


if __name__ == "__main__":
    main()
