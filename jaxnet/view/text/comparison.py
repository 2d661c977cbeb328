"""What `jaxnet compare` says: what differs between two studies, their differences, and who changed sides."""

from textwrap import fill, shorten
from typing import Any

import pandas as pd

from jaxnet.statistics.pairs import Comparison
from jaxnet.view.text.width import MOST_ROWS, WIDTH, as_lines, narrow, notes

MOST_NAMED = 20  # lanes of a kind
ROUNDING = 1e-9  # [m] what two errors may differ by in arithmetic alone
SHOWN = {
    "tail_mean_difference": "mean [m]",
    "tail_mean_low": "mean low",
    "tail_mean_high": "mean high",
    "tail_max_difference": "max [m]",
    "tail_max_low": "max low",
    "tail_max_high": "max high",
    "unrecovered": "unrecovered",
    "unrecovered_low": "share low",
    "unrecovered_high": "share high",
    "p": "p",
}
COUNTS = ("cell", "cell_B", "pairs", "failed", "saved", "lost")
FIRST_TO_GO = (
    *(("failed",), ("max low", "max high"), ("share low", "share high"), ("max [m]",)),
    *(("p",), ("pairs",), ("unrecovered",), ("mean low", "mean high")),
)
LEGEND = (
    "All differences are B - A, of the same draws. mean, max: tail_mean and tail_max;"
    " low, high: 95 % intervals of means of paired differences; an end is blank where theory does not bound"
    " the errors. saved, lost: lanes"
    " unrecovered in A alone, in B alone; p: McNemar's exact test of as many either way."
)


def rows(found: Comparison) -> pd.DataFrame:
    """A row per pair of cells, under the names that people read; the share only where there is one."""
    table = found.cells.rename(columns=SHOWN)
    return table.dropna(axis="columns", how="all")


def told(found: Comparison) -> str:
    """All of it for a terminal."""
    table = rows(found)
    errors = [name for name in table if "mean" in str(name) or "max" in str(name)]
    table[errors] = table[errors].where(table[errors].abs() >= ROUNDING, 0.0)
    labels = [name for name in table if name not in {*SHOWN.values(), *COUNTS}]
    shown, left_out, is_cut = narrow(table.head(MOST_ROWS), labels, FIRST_TO_GO)
    lines = [as_lines(shown), "", fill(LEGEND, WIDTH)]
    if len(table) > MOST_ROWS:
        lines.append(f"… {len(table) - MOST_ROWS} more pairs of cells in differences.csv")
    lines += notes(left_out, is_cut, "differences.csv")
    parts = ["\n".join(what_differs(found)), "\n".join(lines), changes(found), failures_in(found)]
    return "\n\n".join(filter(None, parts))


def what_differs(found: Comparison) -> list[str]:
    """The two folders, and a line for each key in which their studies differ."""
    a, b = found.folders
    keys: Any = found.settings.itertuples()
    told = [f"  {row.key}: {shorten(row.A, 60)} in A, {shorten(row.B, 60)} in B" for row in keys]
    head = [f"A: {a}", f"B: {b}", "they differ in" if told else "they are the same study", *told]
    if found.alone:
        head.append(f"not compared, for the other has none like it: {some_of(found.alone)}")
    return head


def changes(found: Comparison) -> str:
    """The lanes that changed sides."""
    lanes: Any = found.changed.itertuples()
    both = {True: [], False: []}
    for lane in lanes:
        both[bool(lane.unrecovered_A)].append(f"cell {lane.cell} sample {lane.sample}")
    words = {True: "saved", False: "lost"}
    return "\n".join(
        fill(f"{words[way]}: {len(named)} lanes: {some_of(named)}", WIDTH)
        for way, named in both.items()
        if named
    )


def failures_in(found: Comparison) -> str:
    """The lanes that count in no difference, for they failed."""
    lanes: Any = found.failed.itertuples()
    named = [
        f"cell {lane.cell} sample {lane.sample} ({lane.status_A} in A, {lane.status_B} in B)"
        for lane in lanes
    ]
    return fill(f"failed: {len(named)} lanes: {some_of(named)}", WIDTH) if named else ""


def some_of(named: list[str]) -> str:
    """The first of them, and how many more there are."""
    more = len(named) - MOST_NAMED
    return ", ".join(named[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
