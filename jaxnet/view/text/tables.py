"""Results as text for a terminal."""

import shlex
from collections.abc import Sequence
from html import escape
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Sequential
from jaxnet.model.wording import cells_named
from jaxnet.statistics import recovery
from jaxnet.statistics.recovery import confidence_told
from jaxnet.statistics.summary import NO_MEAN_INTERVAL, interval_basis
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import known_or
from jaxnet.store.results import Part, Results
from jaxnet.view.text.width import MOST_ROWS, WIDTH, as_lines, clipped, cut, narrow, notes, number

MOST_FAILURES = 20
REASONS = {
    "disconnected": "a vehicle retained nobody by whom the navigator reaches it",
    "singular": "a vehicle stood still, where the law is singular",
    "max_steps": "more steps than engine.max_steps, or one too small to move time",
    "nonfinite": "a number that is none",
}
SUMMARY = {
    "tail_mean_mean": "tail mean [m]",
    "tail_mean_low": "mean low",
    "tail_mean_high": "mean high",
    "tail_mean_median": "median",
    "tail_mean_q95": "q95",
    "tail_max_max": "worst [m]",
}
LEAST_WANTED = (
    ("q95",),
    ("median",),
    ("mean low", "mean high"),
    ("share low", "share high"),
    ("worst [m]",),
    ("unrecovered",),
)
RECOVERY = {"unrecovered": "unrecovered", "unrecovered_low": "share low", "unrecovered_high": "share high"}


def summary_rows(results: Results) -> pd.DataFrame:
    """The summary: a row per cell."""
    cells: Any = results.cells
    swept = list(results.study.cells[0].labels)
    shown = (RECOVERY if "unrecovered" in cells else {}) | SUMMARY
    table = cells[[*swept, "ok", "failed", *shown]].rename(columns=shown)
    table.insert(0, "cell", range(len(table)))
    return table


def summary(results: Results) -> str:
    """The summary table: a line per cell, as many columns as a terminal has room for."""
    table = summary_rows(results)
    shown, left_out, is_cut = narrow(table.head(MOST_ROWS), list(results.study.cells[0].labels), LEAST_WANTED)
    lines = [as_lines(shown)]
    if len(table) > MOST_ROWS:
        lines.append(f"… {len(table) - MOST_ROWS} more cells in {results.path / 'cells.csv'}")
    if "mean low" in shown:
        over = interval_basis(results.study.config)
        sure = 100 * confidence_told(results.study.config.samples)
        lines.append(f"mean low, mean high: {sure:g} % interval of the mean over {over}")
        lines += [fill(each, WIDTH) for each in blank_ends(results)]
    if "worst [m]" in shown:
        lines += [fill(each, WIDTH) for each in greatest_told(results)]
    lines += [fill(each, WIDTH) for each in caveats(results.study.cells)]
    return "\n".join([*lines, *notes(left_out, is_cut, "cells.csv")])


def greatest_told(results: Results) -> list[str]:
    """What the greatest of independent lanes bounds, in the cell that has fewest; nothing without lanes."""
    ended = [count for count in results.cells["ok"].tolist() if count]
    if not ended or results.study.config.draws != "random":
        return []
    share = 1 - recovery.below_greatest(min(ended))
    words = f"worst is the greatest of the lanes simulated: with 95 % confidence at most {share:.2%} of all"
    return [f"{words} lanes of a cell are over it"]


def blank_ends(results: Results) -> list[str]:
    """Why means of some cells have no interval, or one end alone, and which cells; nothing where all have."""
    cells: Any = results.cells
    blank = cells["tail_mean_mean"].notna() & cells[["tail_mean_low", "tail_mean_high"]].isna().any(axis=1)
    where = cells.index[blank].tolist()
    return [f"{NO_MEAN_INTERVAL}: {cells_named(where)}"] if where else []


def caveats(cells: Sequence[Cell]) -> list[str]:
    """What attacks leave of the paper's, and in which cells."""
    found: dict[str, list[int]] = {}
    for cell in cells:
        words = known_or("of which no code is here", cell.scenario.attack.caveat)
        found.setdefault(words, []).append(cell.number)
    return [f"attack {words}: {cells_named(where)}" for words, where in found.items() if words]


def html(results: Results) -> str:
    """The summary for a notebook, or why there is none."""
    try:
        rows = summary_rows(results)
    except FolderError as error:
        return f"<p>{escape(str(error))}</p>"
    lanes = results.manifest["lanes"]
    head = f"{results.path}: {lanes['ok']} of {lanes['total']} lanes ok, {lanes['failed']} failed"
    table = rows.to_html(index=False, max_rows=MOST_ROWS, float_format=number, na_rep="-", border=0)
    return f"<p>{escape(head)}</p>{table}"


def what_was_written(results: Results) -> str:
    """What a run wrote where."""
    lanes = results.manifest["lanes"]
    names = ["cells.csv", "lanes/"]
    names += [name for name in ("errors.zarr", "trajectories.zarr") if (results.path / name).exists()]
    return (
        f"{lanes['ok']} of {lanes['total']} lanes ok, {lanes['failed']} failed;"
        f" wrote {results.path}: {', '.join(names)}" + stopped(results)
    )


def nothing_to_do(results: Results) -> str:
    """That a run found all of it there."""
    lanes = results.manifest["lanes"]
    return f"nothing to do: all {lanes['total']} lanes were there, {lanes['failed']} failed" + stopped(
        results
    )


def next_command(results: Results) -> str:
    """What to type after a run."""
    return f"next: {shlex.join(['jaxnet', 'report', str(results.path)])}"


def part(run: Part) -> str:
    """What a part of a run wrote where, or that all of it was there."""
    if run.simulated:
        there = run.shards - run.simulated
        words = f"{run.simulated} shards simulated, {there} were there; {run.failed} lanes failed;"
        words += f" wrote {run.path}: lanes/"
    else:
        words = f"nothing to do: all {run.shards} shards were there, {run.failed} lanes failed"
    return f"{words}\nwhen all parts are done, the same command without --shard makes the tables"


def stopped(results: Results) -> str:
    """Why a run that takes as many lanes as it needs has stopped; empty for another."""
    samples = results.study.config.samples
    if not isinstance(samples, Sequential):
        return ""
    cells: Any = results.cells
    half = (cells["unrecovered_high"] - cells["unrecovered_low"]).max() / 2
    words = f"stopped after {results.manifest['samples']} samples a cell: "
    if np.isnan(half):
        words += "no attacked lane came to its end"
    else:
        why = "narrow enough" if half <= samples.until.half_width else "and no more samples are allowed"
        words += f"the widest interval of the share unrecovered is ± {half:.2g}, {why}"
    return f"\n{fill(words, WIDTH)}"


def failures(results: Results) -> str:
    """The failed lanes, each with the command that replays it; empty if there is none."""
    count, failed = results.failed(MOST_FAILURES)
    rows: Any = failed.itertuples()
    lines = [
        f"failed: {lane_named(results, row)}: {row.status}\n  {results.replay_command(row.cell, row.sample)}"
        for row in rows
    ]
    if count > MOST_FAILURES:
        lines.append(f"… {count - MOST_FAILURES} more; see the column status in lanes/")
    lines += [f"{status}: {REASONS[status]}" for status in failed["status"].unique() if status in REASONS]
    return "\n".join(lines)


def lane_named(results: Results, row: Any) -> str:
    """A lane in a line of its own, with room for a word or two."""
    return f"{clipped(results.study.cells[row.cell], WIDTH - 40)}, sample {row.sample}"


def lane(results: Results, row: Any) -> str:
    """One lane's row, and whether it is the one that the folder holds."""
    stored = results.row(int(row["cell"]), int(row["sample"]))
    lines = row.map(lambda value: cut(value, WIDTH - 4 - max(map(len, row.index)))).to_string()
    if stored is None:
        return f"{lines}\nno such row is stored"
    apart = stored.compare(row, result_names=("stored", "replayed"))
    verdict = "the same as the stored row" if apart.empty else f"DIFFERS from the stored row:\n{apart}"
    return f"{lines}\n{verdict}"
