"""Output of `jaxnet compare`: settings, differences, and lanes whose recovery differs."""

from textwrap import shorten
from typing import Any

import pandas as pd

from jaxnet.statistics.pairs import Comparison
from jaxnet.view.text.printer import fitted_text
from jaxnet.view.text.width import MOST_ROWS, filled, left_out_note

MOST_NAMED_LANES = 20  # lanes of a kind
ROUNDING_DIFFERENCE = 1e-9  # [m] what two errors may differ by in arithmetic alone
COMPARED = {"tail_mean": "mean", "tail_max": "max", "spread": "spread", "outside": "outside"}
COMPARISON_COLUMNS = {
    f"{metric}_{name}": f"{words} {told}"
    for metric, words in COMPARED.items()
    for name, told in {
        "median": "median [m]",
        "median_low": "median low",
        "median_high": "median high",
        "difference": "[m]",
        "low": "low",
        "high": "high",
    }.items()
} | {"unrecovered_low": "share low", "unrecovered_high": "share high"}
COUNT_COLUMNS = ("cell", "cell_B", "pairs", "failed", "saved", "lost", "unrecovered", "p")
MAIN, OTHER = ("mean", "spread"), ("max", "outside")  # what is shown to the last, and to the first
COMPARISON_DROP_ORDER = (
    ["failed"],
    [f"{words} {end}" for words in (*MAIN, *OTHER) for end in ("low", "high")],
    [f"{words} median {end}" for words in OTHER for end in ("low", "high")],
    [f"{words} [m]" for words in OTHER],
    ["share low", "share high"],
    [f"{words} median [m]" for words in OTHER],
    *(["p"], ["pairs"], ["unrecovered"]),
    [f"{words} [m]" for words in MAIN],
    [f"{words} median {end}" for words in MAIN for end in ("low", "high")],
)
ERROR_LEGEND = (
    "mean, max: tail_mean and tail_max, the mean [m] of the paired differences and their median;"
    " low, high: 95 % intervals. A mean has none where few lanes are as skewed as these."
)
AGREEMENT_LEGEND = (
    "spread: greatest distance of two vehicles that are not attacked, over the tail; outside:"
    " greatest way of such a vehicle out of the hull of their starts; unrecovered: without"
    " agreement."
)
SHARE_LEGEND = (
    "saved, lost: lanes unrecovered in A alone, in B alone; p: McNemar's exact test of as many"
    " either way."
)


def comparison_legend(found: Comparison) -> str:
    measured = AGREEMENT_LEGEND if "spread_difference" in found.cells else ERROR_LEGEND
    return f"All differences are B - A, of the same draws. {measured} {SHARE_LEGEND}"


def length_columns(table: pd.DataFrame) -> list[str]:
    """Columns with differences of lengths, in which rounding is no difference."""
    return [name for name in map(str, table) if name.startswith(tuple(COMPARED.values()))]


def comparison_rows(found: Comparison) -> pd.DataFrame:
    """A row per pair of cells with readable column names, without empty columns."""
    return found.cells.rename(columns=COMPARISON_COLUMNS).dropna(axis="columns", how="all")


def comparison_text(found: Comparison) -> str:
    table = comparison_rows(found)
    errors = length_columns(table)
    table[errors] = table[errors].where(~(table[errors].abs() < ROUNDING_DIFFERENCE), 0.0)
    labels = [name for name in table if name not in {*COMPARISON_COLUMNS.values(), *COUNT_COLUMNS}]
    text, left_out = fitted_text(table.head(MOST_ROWS), labels, COMPARISON_DROP_ORDER)
    lines = [text, "", filled(comparison_legend(found))]
    if len(table) > MOST_ROWS:
        lines.append(f"… {len(table) - MOST_ROWS} more pairs of cells in differences.csv")
    lines += left_out_note(left_out, "differences.csv")
    parts = [
        "\n".join(settings_lines(found)),
        "\n".join(lines),
        changes_text(found),
        failed_lanes_text(found),
    ]
    return "\n\n".join(filter(None, parts))


def settings_lines(found: Comparison) -> list[str]:
    a, b = found.folders
    keys: Any = found.settings.itertuples()
    told = [f"  {row.key}: {shorten(row.A, 60)} in A, {shorten(row.B, 60)} in B" for row in keys]
    head = [f"A: {a}", f"B: {b}", "they differ in" if told else "they are the same study", *told]
    if found.alone:
        head.append(f"not compared, for the other has none like it: {first_names(found.alone)}")
    return head


def changes_text(found: Comparison) -> str:
    lines = []
    for words, in_a in (("saved", True), ("lost", False)):
        lanes: Any = found.changed[found.changed["unrecovered_A"].astype(bool) == in_a].itertuples()
        named = [f"cell {lane.cell} sample {lane.sample}" for lane in lanes]
        lines += [filled(f"{words}: {len(named)} lanes: {first_names(named)}")] * bool(named)
    return "\n".join(lines)


def failed_lanes_text(found: Comparison) -> str:
    lanes: Any = found.failed.itertuples()
    named = [
        f"cell {lane.cell} sample {lane.sample} ({lane.status_A} in A, {lane.status_B} in B)"
        for lane in lanes
    ]
    return filled(f"failed: {len(named)} lanes: {first_names(named)}") if named else ""


def first_names(named: list[str]) -> str:
    more = len(named) - MOST_NAMED_LANES
    return ", ".join(named[:MOST_NAMED_LANES]) + (f" and {more} more" if more > 0 else "")
