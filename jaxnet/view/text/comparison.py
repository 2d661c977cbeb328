"""Output of `jaxnet compare`: settings, differences, and lanes whose recovery differs between two studies."""

from textwrap import fill, shorten
from typing import Any

import pandas as pd

from jaxnet.statistics.pairs import Comparison
from jaxnet.view.text.width import MOST_ROWS, fit_terminal, table_notes, table_text, terminal_width

MOST_NAMED_LANES = 20  # lanes of a kind
ROUNDING_DIFFERENCE = 1e-9  # [m] what two errors may differ by in arithmetic alone
COMPARISON_COLUMNS = {
    "tail_mean_difference": "mean [m]",
    "tail_mean_low": "mean low",
    "tail_mean_high": "mean high",
    "tail_max_difference": "max [m]",
    "tail_max_low": "max low",
    "tail_max_high": "max high",
    "spread_difference": "spread [m]",
    "outside_difference": "outside [m]",
    "unrecovered": "unrecovered",
    "unrecovered_low": "share low",
    "unrecovered_high": "share high",
    "p": "p",
}
COUNT_COLUMNS = ("cell", "cell_B", "pairs", "failed", "saved", "lost")
COMPARISON_DROP_ORDER = (
    *(("failed",), ("max low", "max high"), ("share low", "share high"), ("max [m]",)),
    *(("p",), ("pairs",), ("unrecovered",), ("mean low", "mean high")),
)
ERROR_LEGEND = (
    "mean, max: tail_mean and tail_max; low, high: 95 % intervals of means of paired differences; an end is"
    " blank where theory does not bound the errors."
)
AGREEMENT_LEGEND = (
    "spread: greatest distance of two vehicles that are not attacked, over the tail; outside: greatest way of"
    " such a vehicle out of the hull of their starts; unrecovered: without agreement."
)
SHARE_LEGEND = "saved, lost: lanes unrecovered in A alone, in B alone; p: McNemar's exact test of as many either way."


def comparison_legend(found: Comparison) -> str:
    """Return the meaning of the columns."""
    measured = AGREEMENT_LEGEND if "spread_difference" in found.cells else ERROR_LEGEND
    return f"All differences are B - A, of the same draws. {measured} {SHARE_LEGEND}"


def length_columns(table: pd.DataFrame) -> list[str]:
    """Return the columns with differences of lengths, in which rounding is no difference."""
    return [
        name for name in map(str, table) if name.startswith(("mean", "max", "spread", "outside"))
    ]


def comparison_rows(found: Comparison) -> pd.DataFrame:
    """Return a row per pair of cells with readable column names, without empty columns."""
    table = found.cells.rename(columns=COMPARISON_COLUMNS)
    return table.dropna(axis="columns", how="all")


def comparison_text(found: Comparison) -> str:
    """Return the whole comparison for a terminal."""
    table = comparison_rows(found)
    errors = length_columns(table)
    table[errors] = table[errors].where(table[errors].abs() >= ROUNDING_DIFFERENCE, 0.0)
    labels = [name for name in table if name not in {*COMPARISON_COLUMNS.values(), *COUNT_COLUMNS}]
    shown, left_out, is_cut = fit_terminal(table.head(MOST_ROWS), labels, COMPARISON_DROP_ORDER)
    lines = [table_text(shown), "", fill(comparison_legend(found), terminal_width())]
    if len(table) > MOST_ROWS:
        lines.append(f"… {len(table) - MOST_ROWS} more pairs of cells in differences.csv")
    lines += table_notes(left_out, is_cut, "differences.csv")
    parts = [
        "\n".join(settings_lines(found)),
        "\n".join(lines),
        changes_text(found),
        failed_lanes_text(found),
    ]
    return "\n\n".join(filter(None, parts))


def settings_lines(found: Comparison) -> list[str]:
    """Return both folders, and a line per key in which their studies differ."""
    a, b = found.folders
    keys: Any = found.settings.itertuples()
    told = [f"  {row.key}: {shorten(row.A, 60)} in A, {shorten(row.B, 60)} in B" for row in keys]
    head = [f"A: {a}", f"B: {b}", "they differ in" if told else "they are the same study", *told]
    if found.alone:
        head.append(f"not compared, for the other has none like it: {first_names(found.alone)}")
    return head


def changes_text(found: Comparison) -> str:
    """Return the lanes that recover in one study only."""
    lanes: Any = found.changed.itertuples()
    both = {True: [], False: []}
    for lane in lanes:
        both[bool(lane.unrecovered_A)].append(f"cell {lane.cell} sample {lane.sample}")
    words = {True: "saved", False: "lost"}
    return "\n".join(
        fill(f"{words[way]}: {len(named)} lanes: {first_names(named)}", terminal_width())
        for way, named in both.items()
        if named
    )


def failed_lanes_text(found: Comparison) -> str:
    """Return the failed lanes, which no difference includes."""
    lanes: Any = found.failed.itertuples()
    named = [
        f"cell {lane.cell} sample {lane.sample} ({lane.status_A} in A, {lane.status_B} in B)"
        for lane in lanes
    ]
    return (
        fill(f"failed: {len(named)} lanes: {first_names(named)}", terminal_width()) if named else ""
    )


def first_names(named: list[str]) -> str:
    """Return the first names, and the number of further ones."""
    more = len(named) - MOST_NAMED_LANES
    return ", ".join(named[:MOST_NAMED_LANES]) + (f" and {more} more" if more > 0 else "")
