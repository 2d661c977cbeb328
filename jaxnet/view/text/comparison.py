"""Output of `jaxnet compare`: settings, differences, and lanes whose recovery differs."""

from collections.abc import Sequence
from textwrap import shorten
from typing import Any

import pandas as pd

from jaxnet.kinds.metrics import CONTRACT
from jaxnet.kinds.metrics.collisions import COLLISIONS
from jaxnet.kinds.metrics.min_separation import MIN_SEPARATION
from jaxnet.kinds.metrics.outside import OUTSIDE_HULL
from jaxnet.kinds.metrics.spread import SPREAD
from jaxnet.model.wording import count
from jaxnet.statistics.pairs import Comparison
from jaxnet.statistics.quantities import TITLES, definition, stored_values
from jaxnet.view.columns import Column, all_alike, key_column, plain_column, split_constant
from jaxnet.view.text.printer import columns_text, narrow_columns
from jaxnet.view.text.tables import missing_lines
from jaxnet.view.text.width import MOST_ROWS, filled, left_out_note

MOST_NAMED_LANES = 20  # lanes of a kind
FIRST_METRICS = {"tail_mean": "mean", "spread": "spread"}  # metrics that are shown to the last
SECOND_METRICS = {"tail_max": "max", "outside": "outside"}
FILTER_METRICS = {MIN_SEPARATION.name: "least distance"}  # where studies differ in their filters
SHOWN_AS = {"mean": TITLES["tail_mean"], "max": TITLES["tail_max"]}  # of the words of a CSV table


def of_metrics(metrics: dict[str, str], end: str, title: str) -> list[tuple[str, ...]]:
    stem = "_median" if end == "median" else ""
    return [
        (f"{metric}_{end}", f"{words}{title} [m]", f"{metric}{stem}", f"{words}{title}")
        for metric, words in metrics.items()
    ]


# Columns of differences.csv, what matters most first: name, that in a CSV table, and how the names
# of the ends of its interval begin, there and in a CSV table.
DIFFERENCES = [
    ("unrecovered", "unrecovered", "unrecovered", "share"),
    ("p", "p"),
    ("saved", "only A off"),
    ("lost", "only B off"),
    *of_metrics(FILTER_METRICS | FIRST_METRICS, "median", " median"),
    *of_metrics(FILTER_METRICS | FIRST_METRICS, "difference", ""),
    (f"{COLLISIONS.name}_difference", "collisions", COLLISIONS.name, "collisions"),
    ("pairs", "pairs"),
    *of_metrics(SECOND_METRICS, "median", " median"),
    *of_metrics(SECOND_METRICS, "difference", ""),
    ("failed", "failed"),
]
DELTA = "Δ "  # before the title of a difference
LEGEND = (
    "Δ: B − A, of the same draws: means, and medians where so named; [low, high]: 95 % intervals."
)
NOTES = {  # of columns whose titles begin so
    "error": definition(CONTRACT[0]),
    "worst vehicle": definition(CONTRACT[1]),
    "least distance": definition(MIN_SEPARATION),
    "spread": definition(SPREAD),
    "outside": definition(OUTSIDE_HULL),
    "only": "only A off: unrecovered in A and recovered in B; only B off: the reverse",
    "p": "McNemar's exact test gives p: only A off and only B off are equally likely",
}


def comparison_legend(found: Comparison, shown: Sequence[Column]) -> str:
    """What the columns that are shown have, in sentences."""
    lanes: Any = found.cells.set_index("cell")
    independent = bool(lanes.filter(like="_median_low").notna().to_numpy().any())
    titles = [f"{each.title.removeprefix(DELTA)} " for each in shown]
    notes = [
        note for begin, note in NOTES.items() if any(t.startswith(f"{begin} ") for t in titles)
    ]
    notes += missing_lines(shown, lanes["pairs"], independent)
    return " ".join([LEGEND, *(f"{each[0].upper()}{each[1:]}." for each in notes)])


def comparison_columns(found: Comparison) -> list[Column]:
    """A row per pair of cells; columns without any number are left out."""
    table: Any = found.cells.set_index("cell", drop=False)
    keys = list(table)[1 : list(table).index("pairs")]
    columns = [plain_column("cell", table["cell"].tolist())]
    for key in keys:
        values = table[key].tolist()
        numbers = plain_column(key, values, key=key)
        columns.append(numbers if key == "cell_B" else key_column(key, values))
    for name, told, *stems in DIFFERENCES:
        if name not in table or table[name].isna().all():
            continue
        first, gap, rest = told.partition(" ")
        values = table[name]
        if name == "p":  # says nothing of no lanes
            values = values.where(table["saved"] + table["lost"] > 0)
        column = plain_column(told, values.tolist())
        if stems:
            title = f"{DELTA}{SHOWN_AS.get(first, first)}{gap}{rest}"
            column = column._replace(title=title)
            entries = stored_values(table, [name, f"{stems[0]}_low", f"{stems[0]}_high"])
            if "[m]" in told:
                metric, entries["size"] = stems[0].removesuffix("_median"), 1.0
                mean, most = table[f"{metric}_difference"], table[f"{metric}_max"]
                entries["alike"] = all_alike(mean, most, table["pairs"], entries.loc[:, "size"])
            ends = f"{stems[1]} low", f"{stems[1]} high"
            known = ends if entries[["low", "high"]].notna().to_numpy().any() else None
            column = column._replace(entries=entries, ends=known)
        if name == "unrecovered":
            failed = "failed or " * (not found.failed.empty)
            column = column._replace(title=f"{DELTA}{failed}unrecovered [%]", scale=100.0)
        columns.append(column)
    return columns


def comparison_text(found: Comparison) -> str:
    columns = comparison_columns(found)
    varied, constant = split_constant(columns)
    shown, left_out = narrow_columns([each.at(slice(MOST_ROWS)) for each in varied])
    lines = [columns_text(shown), *[filled(constant)] * bool(constant), ""]
    same = [each for each in columns if all(each is not other for other in varied)]
    lines.append(filled(comparison_legend(found, [*shown, *same])))
    if len(found.cells) > MOST_ROWS:
        lines.append(f"… {len(found.cells) - MOST_ROWS} more pairs of cells in differences.csv")
    lines += left_out_note(left_out, "differences.csv")
    changed: Any = found.changed
    saved = changed["unrecovered_A"].astype(bool)
    parts = [
        "\n".join(settings_lines(found)),
        "\n".join(lines),
        named_lanes("recovered only in B", changed[saved]),
        named_lanes("recovered only in A", changed[~saved]),
        named_lanes("failed", found.failed),
    ]
    return "\n\n".join(filter(None, parts))


def settings_lines(found: Comparison) -> list[str]:
    a, b = found.folders
    keys: Any = found.settings.itertuples()
    told = [f"  {row.key}: {shorten(row.A, 60)} in A, {shorten(row.B, 60)} in B" for row in keys]
    head = [f"A: {a}", f"B: {b}", "they differ in" if told else "they are the same study", *told]
    if found.alone:
        alone = first_names(found.alone)
        head.append(filled(f"not compared, for the other has none like it: {alone}"))
    return head


def named_lanes(what: str, lanes: pd.DataFrame) -> str:
    """So many lanes, with the samples of each cell."""
    named: dict[int, list[str]] = {}
    for lane in lanes.head(MOST_NAMED_LANES).to_dict("records"):
        a, b = lane.get("status_A", ""), lane.get("status_B", "")
        ends = f" ({a} in A, {b} in B)" if a != b else f" ({a} in both)" * bool(a)
        named.setdefault(lane["cell"], []).append(f"{lane['sample']}{ends}")
    told = [
        f"cell {cell} sample{'s' * (len(mine) > 1)} {', '.join(mine)}"
        for cell, mine in named.items()
    ]
    more = len(lanes) - MOST_NAMED_LANES
    told[-1:] = [f"{told[-1]} and {more} more"] if more > 0 else told[-1:]
    return filled(f"{what}: {count(len(lanes), 'lane')}: {'; '.join(told)}") if told else ""


def first_names(named: Sequence[str]) -> str:
    more = len(named) - MOST_NAMED_LANES
    return ", ".join(named[:MOST_NAMED_LANES]) + (f" and {more} more" if more > 0 else "")
