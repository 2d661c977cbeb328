"""Results as text for a terminal: the summary, the outcome of a run, failed lanes."""

import shlex
from collections.abc import Sequence
from html import escape
from textwrap import fill
from typing import Any, Protocol, runtime_checkable

import numpy as np
import pandas as pd

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Sequential
from jaxnet.model.wording import cells_named
from jaxnet.statistics import recovery
from jaxnet.statistics.amplitude import amplitude_note
from jaxnet.statistics.choice import Where
from jaxnet.statistics.recovery import confidence_told
from jaxnet.statistics.summary import NO_MEAN_INTERVAL, interval_basis
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import known_or
from jaxnet.store.results import Part, Results
from jaxnet.view import columns
from jaxnet.view.columns import Column
from jaxnet.view.text.width import (
    LABEL_LENGTHS,
    MOST_ROWS,
    Lettered,
    cell_title,
    cut_text,
    lettered_text,
    table_notes,
    terminal_width,
)

MOST_FAILURES = 20
FAILURE_REASONS = {
    "disconnected": "a vehicle retained nobody by whom the navigator reaches it",
    "singular": "a vehicle stood still, where the law is singular",
    "max_steps": "more steps than engine.max_steps, or one too small to move time",
    "nonfinite": "a number that is none",
}


@runtime_checkable
class LaneRow(Protocol):
    """A row of a table of lanes, as `itertuples` gives it."""

    cell: int
    sample: int


def summary_text(
    results: Results, names: Sequence[str] = (), where: Where | None = None, sort: str | None = None
) -> str:
    """Return the summary table with notes, as many columns as the terminal holds.

    `names`, `where` and `sort` are as for `columns.summary_columns`.
    """
    whole = columns.summary_columns(results, names, where, sort)
    varied, constant = columns.split_constant(whole)
    swept = 1 + sum(each.key is not None for each in varied)
    shown, text, is_cut = fit_columns(varied, swept)
    lines, count = [text], len(whole[0].values)
    if count > MOST_ROWS:
        lines.append(f"… {count - MOST_ROWS} more cells in {results.path / 'cells.csv'}")
    lines += [fill(each, terminal_width()) for each in [constant, *summary_notes(results, shown)] if each]
    left_out = [each.title for each in varied if each not in shown]
    return "\n".join([*lines, *table_notes(left_out, is_cut, "cells.csv")])


def fit_columns(whole: Sequence[Column], first: int) -> tuple[list[Column], str, bool]:
    """Return the columns that fit the terminal, as text, and whether labels were cut.

    Beside the `first` columns, which are labels, one quantity keeps its interval. The others lose theirs,
    then the last columns go. Then long labels lose their ends. Finally label columns go, from the last on.
    """
    kept = list(whole)
    shown = [lettered(each, True) for each in kept]
    if text_width(shown) > terminal_width():
        shown = [lettered(each, place <= first) for place, each in enumerate(kept)]
    while text_width(shown) > terminal_width() and len(shown) > first + 1:
        del kept[-1], shown[-1]
    is_cut = False
    for room in LABEL_LENGTHS:
        if text_width(shown) > terminal_width():
            is_cut = True
            shown[1:first] = [cut_column(each, room) for each in shown[1:first]]
    while text_width(shown) > terminal_width() and first > 1:
        first -= 1
        del kept[first], shown[first]
    return kept, lettered_text(shown), is_cut


def lettered(column: Column, intervals: bool) -> Lettered:
    """Return a column of the summary as text."""
    return Lettered(column.title, column.texts(intervals)[:MOST_ROWS], column.numeric)


def cut_column(column: Lettered, room: int) -> Lettered:
    """Return a column whose title and values have at most so many letters."""
    return column._replace(
        title=cut_text(column.title, room), values=[cut_text(text, room) for text in column.values]
    )


def text_width(shown: Sequence[Lettered]) -> int:
    """Return the width of a table in letters."""
    return max(map(len, lettered_text(shown).splitlines()))


def summary_notes(results: Results, shown: Sequence[Column]) -> list[str]:
    """Return what the columns leave open: which intervals they have, and what the greatest lane says."""
    config, names = results.study.config, {each.name for each in shown}
    notes = []
    if any(each.ends is not None for each in shown):
        sure = 100 * confidence_told(config.samples)
        notes.append(f"[low, high]: {sure:g} % intervals, of a mean over {interval_basis(config)}")
        notes += blank_interval_lines(results) if "tail_mean_mean" in names else []
    if "unrecovered" in names and config.recovery is not None:
        notes.append(f"unrecovered: {recovery.criterion_words(config.recovery)}")
    if "amplitude" in names:
        notes.append(amplitude_note(results.study.cells))
    if "tail_max_max" in names:
        notes += greatest_lines(results)
    return notes + caveat_lines(results.study.cells)


def greatest_lines(results: Results) -> list[str]:
    """Return a note on the confidence of the observed maximum, if lanes are independent."""
    ended = [count for count in results.cells["ok"].tolist() if count]
    if not ended or results.study.config.draws != "random":
        return []
    share = 1 - recovery.below_greatest(min(ended))
    words = f"worst is the greatest of the lanes simulated: with 95 % confidence at most {share:.2%} of all"
    return [f"{words} lanes of a cell are over it"]


def blank_interval_lines(results: Results) -> list[str]:
    """Return a note on cells whose mean has no complete interval, if there are any."""
    cells: Any = results.cells
    blank = cells["tail_mean_mean"].notna() & cells[["tail_mean_low", "tail_mean_high"]].isna().any(axis=1)
    where = cells.index[blank].tolist()
    return [f"{NO_MEAN_INTERVAL}: {cells_named(where)}"] if where else []


def caveat_lines(cells: Sequence[Cell]) -> list[str]:
    """Return notes on attacks that depart from the paper, with their cells."""
    found: dict[str, list[int]] = {}
    for cell in cells:
        words = known_or("of which no code is here", cell.scenario.attack.caveat)
        found.setdefault(words, []).append(cell.number)
    return [f"attack {words}: {cells_named(where)}" for words, where in found.items() if words]


def summary_html(results: Results) -> str:
    """Return the summary for a notebook, or the reason that there is none."""
    try:
        shown, constant = columns.split_constant(columns.summary_columns(results))
    except FolderError as error:
        return f"<p>{escape(str(error))}</p>"
    lanes = results.manifest["lanes"]
    name = "" if results.in_memory else f"{results.path}: "
    head = f"{name}{lanes['ok']:,} of {lanes['total']:,} lanes ok, {lanes['failed']:,} failed"
    table = pd.DataFrame({each.title: each.texts() for each in shown}).to_html(
        index=False, max_rows=MOST_ROWS, border=0
    )
    return f"<p>{escape(head)}</p>{table}" + (f"<p>{escape(constant)}</p>" if constant else "")


def written_text(results: Results) -> str:
    """Return the numbers of lanes, and the files that a run wrote."""
    lanes = results.manifest["lanes"]
    names = ["cells.csv", "lanes/"]
    names += [name for name in ("errors.zarr", "trajectories.zarr") if (results.path / name).exists()]
    return (
        f"{lanes['ok']} of {lanes['total']} lanes ok, {lanes['failed']} failed;"
        f" wrote {results.path}: {', '.join(names)}" + stop_reason(results)
    )


def nothing_to_do_text(results: Results) -> str:
    """Return the message of a run that found all lanes stored."""
    lanes = results.manifest["lanes"]
    return f"nothing to do: all {lanes['total']} lanes were there, {lanes['failed']} failed" + stop_reason(
        results
    )


def next_command(results: Results) -> str:
    """Return the command that follows a run."""
    return f"next: {shlex.join(['jaxnet', 'report', str(results.path)])}"


def part_text(run: Part) -> str:
    """Return the result of one part of a run that was split by --shard."""
    if run.simulated:
        there = run.shards - run.simulated
        words = f"{run.simulated} shards simulated, {there} were there; {run.failed} lanes failed;"
        words += f" wrote {run.path}: lanes/"
    else:
        words = f"nothing to do: all {run.shards} shards were there, {run.failed} lanes failed"
    return f"{words}\nwhen all parts are done, the same command without --shard makes the tables"


def stop_reason(results: Results) -> str:
    """Return why a run with a sequential number of samples stopped; empty for another run."""
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
    return f"\n{fill(words, terminal_width())}"


def failures_text(results: Results) -> str:
    """Return the failed lanes with the commands that replay them; empty if there are none."""
    count, failed = results.failed(MOST_FAILURES)
    rows: Any = failed.itertuples()
    lines = [
        f"failed: {lane_title(results, row)}: {row.status}\n  {results.replay_command(row.cell, row.sample)}"
        for row in rows
    ]
    if count > MOST_FAILURES:
        lines.append(f"… {count - MOST_FAILURES} more; see the column status in lanes/")
    lines += [
        f"{status}: {FAILURE_REASONS[status]}"
        for status in failed["status"].unique()
        if status in FAILURE_REASONS
    ]
    return "\n".join(lines)


def lane_title(results: Results, row: LaneRow) -> str:
    """Return cell and sample of a lane, short enough for a line with a word or two more."""
    return f"{cell_title(results.study.cells[row.cell], terminal_width() - 40)}, sample {row.sample}"


def lane_text(results: Results, row: pd.Series) -> str:
    """Return the row of a lane, and whether the stored row equals it."""
    cell, sample = map(int, row.loc[["cell", "sample"]].tolist())
    stored = results.row(cell, sample)
    lines = row.map(
        lambda value: cut_text(value, terminal_width() - 4 - max(map(len, row.index)))
    ).to_string()
    if stored is None:
        return f"{lines}\nno such row is stored"
    apart = stored.compare(row, result_names=("stored", "replayed"))
    verdict = "the same as the stored row" if apart.empty else f"DIFFERS from the stored row:\n{apart}"
    return f"{lines}\n{verdict}"
