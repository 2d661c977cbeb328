"""Results as text for a terminal: the summary, the outcome of a run, failed lanes."""

import shlex
from collections.abc import Sequence
from html import escape
from textwrap import fill
from typing import Any, Protocol, runtime_checkable

import numpy as np
import pandas as pd

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.keys import Config, Sequential
from jaxnet.model.wording import cells_named, count, count_between
from jaxnet.statistics import recovery
from jaxnet.statistics.amplitude import amplitude_note
from jaxnet.statistics.choice import Where
from jaxnet.statistics.hull import hull_definition
from jaxnet.statistics.quantities import AGREEMENT_NOTES
from jaxnet.statistics.recovery import confidence_told
from jaxnet.statistics.summary import NO_MEAN_INTERVAL, interval_basis
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import known_or
from jaxnet.store.results import Part, Results
from jaxnet.view import columns
from jaxnet.view.columns import SHARE_NAMES, Column
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
    "diverged": "an error over 1e100 m",
    "unmeasured": "a metric of the study is no finite number (extending.md: undefined)",
}


@runtime_checkable
class LaneRow(Protocol):
    """A row of a table of lanes, as `itertuples` gives it."""

    cell: int
    sample: int


def summary_text(
    results: Results,
    names: Sequence[str] = (),
    where: Where | None = None,
    sort: str | None = None,
    pivot: str | None = None,
    most: int | None = MOST_ROWS,
) -> str:
    """Return the summary table with notes, as many columns as the terminal holds.

    `names`, `where` and `sort` are as for `columns.summary_columns`, `pivot` is the key of
    `columns.pivoted`. The table has `most` rows at most, None for all.
    """
    asked = asked_columns(results, names, where, sort, pivot)
    whole = columns.pivoted(asked, pivot) if pivot else asked
    varied, constant = columns.split_constant(whole)
    fitting, text, is_cut = fit_columns(varied, most)
    lines, rows = [text], len(whole[0].values)
    shown = [each for each in asked if each.key is None] if pivot else fitting
    if not any(each.ends for each in fitting):
        shown = [each._replace(ends=None) for each in shown]
    if most is not None and rows > most:
        lines.append(
            f"… {rows - most} more rows: `show --all` has all, `show --where KEY=VALUE` some"
        )
        shown = shown if pivot else [first_rows(each, most) for each in shown]
    lines += [
        fill(each, terminal_width()) for each in [constant, *summary_notes(results, shown)] if each
    ]
    return "\n".join([*lines, *table_notes(left_out_titles(varied, fitting), is_cut, "cells.csv")])


def asked_columns(
    results: Results, names: Sequence[str], where: Where | None, sort: str | None, pivot: str | None
) -> list[Column]:
    """Return the columns of the summary; without names, a pivoted one has the first quantity alone."""
    found = columns.summary_columns(results, names, where, sort)
    if pivot is None or names:
        return found
    quantities = [each.name for each in found[1:] if each.key is None]
    return [each for each in found if each.name not in quantities[1:]]


def first_rows(column: Column, most: int) -> Column:
    """Return the first rows of a column."""
    ends = column.ends and (column.ends[0][:most], column.ends[1][:most])
    return column._replace(
        values=column.values[:most], ends=ends, sizes=column.sizes and column.sizes[:most]
    )


def left_out_titles(varied: Sequence[Column], shown: Sequence[Column]) -> list[str]:
    """Return the titles of the columns that are not shown, and of those shown without their intervals."""
    there = {each.name: each for each in shown}
    bare = [
        each.title
        for each in varied
        if each.ends and each.name in there and not there[each.name].ends
    ]
    lost = [each.title for each in varied if each.name not in there]
    which = (
        "all intervals"
        if not any(each.ends for each in shown)
        else f"intervals of {', '.join(bare)}"
    )
    return [*[which] * bool(bare), *lost]


def fit_columns(whole: Sequence[Column], most: int | None) -> tuple[list[Column], str, bool]:
    """Return the columns that fit the terminal, as text, and whether labels were cut.

    Beside the number of the cell and the labels, the first quantity keeps its interval. The others lose
    theirs, then the last columns go; pivoted quantities lose theirs together. Then long labels lose their
    ends. Finally label columns go, from the last on.
    """
    numbered = whole[0].name == "cell"
    first = numbered + sum(each.key is not None for each in whole)
    kept = list(whole)
    shown = [lettered(each, most) for each in kept]
    if text_width(shown) > terminal_width():
        intervals = first + (not any(each.across for each in whole))
        kept = [
            each if place < intervals else each._replace(ends=None)
            for place, each in enumerate(kept)
        ]
        shown = [lettered(each, most) for each in kept]
    while text_width(shown) > terminal_width() and len(shown) > first + 1:
        del kept[-1], shown[-1]
    is_cut = False
    for room in LABEL_LENGTHS:
        if text_width(shown) > terminal_width():
            is_cut = True
            shown[numbered:first] = [cut_column(each, room) for each in shown[numbered:first]]
    while text_width(shown) > terminal_width() and first > 1:
        first -= 1
        del kept[first], shown[first]
    return kept, lettered_text(shown), is_cut


def lettered(column: Column, most: int | None) -> Lettered:
    """Return the first rows of a column of the summary as text."""
    return Lettered(column.title, column.texts()[:most], column.numeric)


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
    config, names, cells = results.study.config, {each.name for each in shown}, results.study.cells
    notes = [*interval_lines(config, shown), *missing_end_lines(shown)]
    if "unrecovered" in names and config.recovery is not None:
        notes.append(recovery.share_definition(config.recovery, cells))
    if is_leaderless(cells):
        told = {name.rpartition("_")[0] for name in names}
        notes += [words for metric, words in AGREEMENT_NOTES.items() if metric in told]
        notes += [hull_definition(cells)] if "in_hull" in names else []
    if "amplitude" in names:
        notes.append(amplitude_note(cells))
    if names & {"tail_max_max", "spread_max"}:
        notes += greatest_lines(results)
    return notes + caveat_lines(cells)


def interval_lines(config: Config, shown: Sequence[Column]) -> list[str]:
    """Return a note on the intervals of shares, and one on those of means, where these are shown."""
    sure = f"{100 * confidence_told(config.samples):g} %"
    ended = [
        (each.title.partition(" [")[0], each.name in SHARE_NAMES) for each in shown if each.ends
    ]
    shares, means = (
        [title for title, share in ended if share is wanted] for wanted in (True, False)
    )
    exact = "exact binomial " if config.draws == "random" else "binomial "
    at_once = ", at once at every look" if isinstance(config.samples, Sequential) else ""
    of = ", ".join(shares)
    told = [f"[low, high] of {of}: {exact}{sure} intervals (Clopper and Pearson){at_once}"] * bool(
        shares
    )
    basis = f"{sure} intervals of a mean over {interval_basis(config)}{at_once}"
    return told + [f"[low, high] of {', '.join(means)}: {basis}"] * bool(means)


def greatest_lines(results: Results) -> list[str]:
    """Return a note on the confidence of the observed maximum, if lanes are independent."""
    ended = [count for count in results.cells["ok"].tolist() if count]
    if not ended or results.study.config.draws != "random":
        return []
    share = 1 - recovery.below_greatest(min(ended))
    words = f"worst is the greatest of the lanes simulated: with 95 % confidence at most {share:.2%} of all"
    return [f"{words} lanes of a cell are over it"]


def missing_end_lines(shown: Sequence[Column]) -> list[str]:
    """Return a note on cells whose mean has no complete interval, if the table shows such a mean."""
    numbers = next((each.values for each in shown if each.name == "cell"), [])
    where = {
        number
        for each in shown
        if each.ends and each.name not in SHARE_NAMES
        for number, value, *ends in zip(numbers, each.values, *each.ends, strict=True)
        if not np.isnan(value) and np.isnan(ends).any()
    }
    if not where:
        return []
    return [f"{NO_MEAN_INTERVAL}: {cells_named(sorted(where))}"]


def setting_note(results: Results) -> str:
    """Return samples, horizon and tail of a study, for a table that leaves the folder."""
    study = results.study
    samples = f"{count_between(results.samples, 'lane')} a cell"
    horizons = sorted({cell.scenario.horizon for cell in study.cells})
    tails = sorted({cell.scenario.tail for cell in study.cells})
    told = (" or ".join(f"{each:g}" for each in values) for values in (horizons, tails))
    return "{}; horizon {} s, of which the tail is the last {} s".format(samples, *told)


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
    stores = ("errors.zarr", "vehicles.zarr", "trajectories.zarr")
    names += [name for name in stores if (results.path / name).exists()]
    return (
        f"{lanes['ok']} of {lanes['total']} lanes ok, {lanes['failed']} failed;"
        f" wrote {results.path}: {', '.join(names)}" + stop_reason(results)
    )


def nothing_to_do_text(results: Results) -> str:
    """Return the message of a run that found all lanes stored."""
    lanes = results.manifest["lanes"]
    return (
        f"nothing to do: all {lanes['total']} lanes were there, {lanes['failed']} failed"
        + stop_reason(results)
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
    halves = (cells["unrecovered_high"] - cells["unrecovered_low"]) / 2
    words = f"stopped after {count_between(results.samples, 'sample')} a cell: "
    if halves.isna().all():
        words += "no attacked lane came to its end"
    else:
        wide = int((halves > samples.until.half_width).sum())
        why = (
            f"and no more samples are allowed ({count(wide, 'cell')})" if wide else "narrow enough"
        )
        share = recovery.share_name(results.study.cells)
        words += f"the widest interval of the share {share} is ± {halves.max():.2g}, {why}"
    return f"\n{fill(words, terminal_width())}"


def failures_text(results: Results) -> str:
    """Return the failed lanes with the commands that replay them; empty if there are none."""
    count, failed = results.failed(MOST_FAILURES)
    rows: Any = failed.itertuples()
    lines = [
        f"failed: {lane_title(results, row)}: {row.status}"
        f"{cut_off_words(getattr(row, 'cut_off', 0), getattr(row, 'cut_off_at', 0.0))}\n"
        f"  {results.replay_command(row.cell, row.sample)}"
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


def cut_off_words(vehicle: int, since: float) -> str:
    """Return which vehicle was cut off first, and when; "" for number 0, which is none."""
    return f", vehicle {vehicle} since {since:g} s" if vehicle else ""


def lane_title(results: Results, row: LaneRow) -> str:
    """Return cell and sample of a lane, short enough for a line with a word or two more."""
    return (
        f"{cell_title(results.study.cells[row.cell], terminal_width() - 40)}, sample {row.sample}"
    )


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
    verdict = (
        "the same as the stored row" if apart.empty else f"DIFFERS from the stored row:\n{apart}"
    )
    return f"{lines}\n{verdict}"
