"""Results as text for a terminal: the summary, the outcome of a run, failed lanes."""

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.keys import RANDOMISATIONS, Config, Sequential
from jaxnet.config.naming import label_notes
from jaxnet.config.sweep import is_joint
from jaxnet.kinds.metrics import AGREEMENT, COLUMNS_OF_METRIC, CONTRACT
from jaxnet.model.wording import cells_named, count, count_between, counted, number_text
from jaxnet.statistics import recovery
from jaxnet.statistics.amplitude import amplitude_note
from jaxnet.statistics.choice import Where, select_cells
from jaxnet.statistics.curves import failed_kinds, mostly_failed
from jaxnet.statistics.falling import falling_words
from jaxnet.statistics.horizon import cuts_words, errors_words, lost_words
from jaxnet.statistics.intervals import LEAST_LANES, below_greatest
from jaxnet.statistics.isolation import isolated_lines
from jaxnet.statistics.nominal import misfit_words
from jaxnet.statistics.quantities import FORMATION_NOTE, definition, share_failed
from jaxnet.statistics.recovery import confidence_told
from jaxnet.statistics.summary import UNSETTLED_NOTE, hull_note, lane_shares, unsettled_shares
from jaxnet.statistics.tiles import share_lost
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import known_or
from jaxnet.store.results import Part, Results
from jaxnet.view import columns
from jaxnet.view.columns import Column
from jaxnet.view.text.formats import in_format
from jaxnet.view.text.printer import columns_text, narrow_columns, parted
from jaxnet.view.text.width import (
    MOST_ROWS,
    cell_title,
    cut_text,
    filled,
    left_out_note,
    numbered_words,
    terminal_width,
)

CRITERIA = {  # by which the worst lane is chosen
    "tail_mean": "mean error over vehicles and the tail (tail_mean)",
    "spread": "spread over the tail",
}
FAILURE_REASONS = {
    "disconnected": "a vehicle retained no source through which the navigator reaches it",
    "singular": "a vehicle stood still, where the law is singular",
    "max_steps": "more steps than engine.max_steps allows, or a step too short to change the time",
    "nonfinite": "a number is infinite or undefined",
    "diverged": "an error over 1e100 m",
    "unmeasured": "a metric of the study is infinite or undefined (extending.md: undefined)",
}
HELD_TOO_LONG = ["singular", "max_steps", "nonfinite", "diverged"]  # of a digital controller


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
    rows = len(whole[0].entries)
    head = [each.at(slice(most)) for each in varied]
    shown, left_out = narrow_columns(head, bool(names or pivot))
    lines = ["\n\n".join(map(columns_text, parted(shown)))]
    if most is not None and most < rows:
        hint = "`show --all` has all, `show --where KEY=VALUE` some"
        lines.append(f"… {rows - most} more rows: {hint}")
    every = {each.name: each for each in varied}  # also the rows that are not printed
    shown = [every[e.name] if "low" in e.entries else every[e.name].bare() for e in shown]
    if pivot:
        beside = any(any(each.intervals()) for each in shown)
        shown = asked if beside else [each.bare() for each in asked]
    cells = [results.study.cells[each] for each in sorted(asked[0].values)]
    lines += map(filled, filter(None, [constant]))
    verdict = list[str]()
    if not (names or pivot):
        verdict = known_or([], lambda: held_lines(results, cells))
        verdict += isolated_lines(results, cells, partial(numbered_words, cells=cells))
    notes = [*grave_warnings(results, cells), *other_warnings(results, cells)]
    notes += summary_notes(results, shown)
    below = [*map(filled, notes), *left_out_note(left_out, "cells.csv")]
    return "\n\n".join(map("\n".join, filter(None, (lines, [*map(filled, verdict)], below))))


def formatted(
    results: Results,
    form: str,
    names: Sequence[str] = (),
    where: Where | None = None,
    sort: str | None = None,
    pivot: str | None = None,
) -> str:
    """Return the summary table as csv, markdown or latex, whole, chosen as `summary_text` is."""
    asked = asked_columns(results, names, where, sort, pivot)
    cells = [results.study.cells[each] for each in asked[0].values]
    notes = [*grave_warnings(results, cells), *other_warnings(results, cells)]
    notes += [*summary_notes(results, asked), setting_note(results)]
    return in_format(columns.pivoted(asked, pivot) if pivot else asked, form, notes)


def asked_columns(
    results: Results, names: Sequence[str], where: Where | None, sort: str | None, pivot: str | None
) -> list[Column]:
    """Columns of the summary; without names, a pivoted one has the first quantity alone."""
    found = columns.summary_columns(results, names, where, sort)
    if pivot is None or names:
        return found
    quantities = [each.name for each in found[1:] if each.key is None]
    return [each for each in found if each.name not in quantities[1:]]


def summary_notes(results: Results, shown: Sequence[Column]) -> list[str]:
    """What the columns leave open: which intervals they have, and what the greatest lane says."""
    config, names, numbers = results.study.config, {each.name for each in shown}, shown[0].values
    cells, table = [results.study.cells[each] for each in numbers], results.cells.loc[numbers]
    metrics = {
        each.name: definition(each)
        for each in config.measured()
        if names & {f"{each.name}_{end}" for end in COLUMNS_OF_METRIC}
    }
    independent, lanes = config.draws == "random", table.loc[:, "ok"]
    alone = {key: each for key, each in config.sweep.items() if not is_joint(key)}
    notes = [*interval_lines(config, shown), *missing_lines(shown, lanes, independent)]
    notes += label_notes(alone, [cell.labels for cell in cells])
    if names & {"unrecovered", columns.SHARE_LOST} and config.recovery is not None:
        notes.append(recovery.share_definition(config.recovery, cells))
    notes += filter(None, metrics.values())
    notes += [hull_note(config, cells)] if "in_hull" in names else []
    if metrics.keys() & {*AGREEMENT, *(each.name for each in CONTRACT)}:
        notes += [FORMATION_NOTE] * any(cell.scenario.formation.present for cell in cells)
    notes += [UNSETTLED_NOTE] * bool(names & unsettled_shares(config).keys())
    if "amplitude" in names:
        notes.append(amplitude_note(cells))
    failed, total = table[["failed", "lanes"]].to_numpy(int).sum(axis=0)
    if failed and not names & {columns.SHARE_FAILED, "failed", "ok"}:
        whose = "other columns are of lanes that ended"
        notes.append(f"{failed:,} of {count(int(total), 'lane')} failed; {whose}")
    if any(each.has_rounding() for each in shown):
        notes.append("errors below 1e-9 ā (1e-9 m without an attack) are shown as 0")
    if names & {"tail_max_max", "spread_max", "outside_max"} and lanes.any() and independent:
        many = lanes[lanes > 0].astype(int)
        beyond = share_beyond(int(many.min()))
        possible = "lanes that end" if failed else "possible lanes"
        words = f"at most {beyond} of all {possible} are above, with 95 % confidence"
        notes.append(f"max: greatest of {count_between(many.tolist(), 'lane')} of a cell; {words}")
    return [*notes, *caveat_lines(cells)]


def held_lines(results: Results, cells: Sequence[Cell]) -> list[str]:
    """Where most lanes or all do not hold, and the range of the worst errors."""
    if len(cells) < 2:
        return []
    table: Any = results.cells.loc[[cell.number for cell in cells]]
    named, asked = partial(numbered_words, cells=cells), results.study.config.recovery is not None
    ways = ["failed"] * bool(table["failed"].any())
    ways += [f"ended {recovery.share_name(cells)}"] * asked
    lines, way = list[str](), " or ".join(ways)
    lost: Any = share_lost(results)["unrecovered"]
    shares: Any = lost[table.index].dropna() if asked else share_failed(table)["value"]
    kind = "cells" if len(shares) == len(cells) else "attacked cells"

    if way and len(shares) and (most := shares.max()) > 0:
        where, share = shares.index[shares == most].tolist(), number_text(100 * most, whole=100)
        told = f"{len(where)} of {len(shares)}" if len(where) < len(shares) else f"all {len(where)}"
        told = f"In {told} {kind} all lanes" if most == 1 else f"At worst {share} % of lanes"
        lines.append(f"{told} {way}" + f": {named(where)}" * (len(where) < len(shares)))
    name, words = "tail_max_max", "Worst vehicle"
    if is_leaderless(cells):
        name, words = "outside_max", "Farthest out of the hull of the starts"
    column = columns.summary_columns(results, [name])[-1]
    lengths: Any = pd.Series(column.numbers("value"), results.cells.index)
    known = lengths[table.index].drop(index=mostly_failed(results), errors="ignore").dropna()
    ends = [
        f"{column.text(end)} m in {named(known.index[np.isclose(known, end, atol=0)].tolist())}"
        for end in dict.fromkeys((known.min(), known.max()))
    ]
    return [*lines, *[f"{words}: {' to '.join(ends)}"] * (len(known) > 0)]


def grave_warnings(results: Results, some: Sequence[Cell] | None = None) -> list[str]:
    """Why errors of these cells (None: all) are not ultimate, or no errors of a whole fleet."""
    named = partial(numbered_words, cells=some) if some else cells_named
    cells = some or results.study.cells
    return [*filter(None, [lost_words(results, cells, named), falling_words(results, cells)])]


def other_warnings(results: Results, some: Sequence[Cell] | None = None) -> list[str]:
    """What else than the attack may decide in these cells, or may not fit presumptions."""
    named = partial(numbered_words, cells=some) if some else cells_named
    config, cells = results.study.config, some or results.study.cells
    told = errors_words(config, cells, named), cuts_words(cells, named)
    told += recovery.lowered_words(results, cells, named), *misfit_words(results, cells)
    return [*filter(None, told)]


def interval_lines(config: Config, shown: Sequence[Column]) -> list[str]:
    """How the intervals of shares, medians and means are made."""
    sure = f"{100 * confidence_told(config.samples):g} %"
    independent = config.draws == "random"
    lanes = "lanes" if independent else f"the means of {RANDOMISATIONS} scrambled sequences"
    kinds = {
        "share": f"{'exact ' * independent}binomial {sure} intervals (Clopper and Pearson)",
        "median": f"{sure} intervals of order statistics",
        "mean": f"{sure} intervals of a mean over {lanes} (Student)",
    }
    at_once = ", valid at all looks together" if isinstance(config.samples, Sequential) else ""
    found: dict[str, list[str]] = {}
    for each in shown:
        if any("," in text for text in each.intervals()):
            kind = "share" if each.name in lane_shares(config) else each.name.rpartition("_")[2]
            found.setdefault(kind, []).append(each.title.partition(" [")[0])
    return [
        f"[low, high] of {'; '.join(found[kind])}: {words}{at_once}"
        for kind, words in kinds.items()
        if kind in found
    ]


def missing_lines(shown: Sequence[Column], lanes: pd.Series, independent: bool) -> list[str]:
    """What (alike) says of cells with these `lanes`, and which cells' means have no interval."""
    alike, without, notes = set[int](), set[int](), list[str]()
    for entries in (each.entries for each in shown if "alike" in each.entries):
        same: Any = entries["alike"]
        alike |= {*entries.index[same]}
        without |= {*entries.index[entries["value"].notna() & entries["low"].isna() & ~same]}
    if without:
        why = f"fewer than {LEAST_LANES} lanes, or too few for so skewed values"
        notes.append(f"mean without interval: {why}: {cells_named(sorted(without))}")
    if alike:
        most = share_beyond(int(lanes.loc[sorted(alike)].min()))
        words = f"; at most {most} of all possible lanes have another, with 95 % confidence"
        notes.append("(alike): all lanes of the cell have the same value" + words * independent)
    return notes


def share_beyond(lanes: int) -> str:
    """Share of all lanes that may be over the greatest of some, with 95 % confidence."""
    return f"{number_text(100 * (1 - below_greatest(lanes)))} %"


def setting_note(results: Results) -> str:
    study = results.study
    samples = f"{count_between(results.samples, 'lane')} a cell"
    failed, total = results.cells[["failed", "lanes"]].to_numpy(int).sum(axis=0)
    samples += f", {failed:,} of all {total:,} failed" * bool(failed)
    horizons = sorted({cell.scenario.horizon for cell in study.cells})
    tails = sorted({cell.scenario.tail for cell in study.cells})
    told = (" or ".join(f"{each:g}" for each in values) for values in (horizons, tails))
    return "{}; horizon {} s, of which the tail is the last {} s".format(samples, *told)


def caveat_lines(cells: Sequence[Cell]) -> list[str]:
    found: dict[str, list[int]] = {}
    for cell in cells:
        words = known_or("of which no code is here", cell.scenario.attack.caveat)
        found.setdefault(words, []).append(cell.number)
    return [f"attack {words}: {cells_named(where)}" for words, where in found.items() if words]


def summary_html(results: Results) -> str:
    try:
        shown, constant = columns.split_constant(columns.summary_columns(results))
    except FolderError as error:
        return f"<p>{escape(str(error))}</p>"
    lanes = results.manifest["lanes"]
    name = "" if results.in_memory else f"{results.path}: "
    head = f"{name}{lanes['ok']:,} of {lanes['total']:,} lanes ok, {lanes['failed']:,} failed"
    table = pd.DataFrame({each.title: each.texts() for each in shown})
    html = table.to_html(index=False, max_rows=MOST_ROWS, border=0)
    return f"<p>{escape(head)}</p>{html}" + (f"<p>{escape(constant)}</p>" if constant else "")


def outcome_text(results: Results, found_all: bool) -> str:
    """What a run did, why it stopped, and its failed lanes."""
    lanes = results.manifest["lanes"]
    if found_all:
        words = f"nothing to do: all {lanes['total']} lanes were there, {lanes['failed']} failed"
    else:
        stores = ("errors.zarr", "vehicles.zarr", "trajectories.zarr")
        there = [name for name in stores if (results.path / name).exists()]
        words = (
            f"{lanes['ok']} of {lanes['total']} lanes ok, {lanes['failed']} failed;"
            f" wrote {results.path}: {', '.join(['cells.csv', 'lanes/', *there])}"
        )
    parts = [words, filled(stop_reason(results)), failures_text(results)]
    return "\n".join(filter(None, parts))


def part_text(run: Part) -> str:
    if run.simulated:
        there = run.shards - run.simulated
        words = f"{run.simulated} shards simulated, {there} were there; {run.failed} lanes failed;"
        words += f" wrote {run.path}: lanes/"
    else:
        words = f"nothing to do: all {run.shards} shards were there, {run.failed} lanes failed"
    return f"{words}\nwhen all parts are done, the same command without --shard makes the tables"


def stop_reason(results: Results) -> str:
    """Say why a run with a sequential number of samples stopped; empty for another run."""
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
        more = f"and no more samples are allowed ({count(wide, 'cell')})"
        why = more if wide else "narrow enough"
        share = recovery.share_name(results.study.cells)
        words += f"the widest interval of the share {share} is ± {halves.max():.2g}, {why}"
    return words


def failures_text(results: Results, where: Where | None = None) -> str:
    """Failed lanes by reason, the first with the command that replays it; empty of none."""
    cells = select_cells(results.study.cells, where or {})
    known = {cell.number: cell for cell in cells}
    by_cell = {cell: kinds for cell, kinds in failed_kinds(results).items() if cell in known}
    lines = [
        filled(f"failed: {told} of {count(lanes, 'lane')} in {numbered_words(numbers, cells)}")
        for numbers, told, lanes in failures_alike(results, by_cell)
    ]
    every = dict.fromkeys(kind for kinds in by_cell.values() for kind in kinds)
    lines += [filled(f"{k}: {FAILURE_REASONS[k]}") for k in every if k in FAILURE_REASONS]
    held = [known[cell] for cell, kinds in by_cell.items() if {*kinds} & {*HELD_TOO_LONG}]
    lines += filter(None, [filled(held_words(held))])
    failed: Any = results.failed(sys.maxsize)[1]
    for row in failed[failed["cell"].isin([*known])].head(1).itertuples():
        vehicle = getattr(row, "cut_off", 0)  # the first that was cut off; 0 is none
        since = f", vehicle {vehicle} since {row.cut_off_at:g} s" if vehicle else ""
        title = cell_title(known[row.cell])
        lines.append(filled(f"the first: {title}, sample {row.sample}: {row.status}{since}"))
        lead = "  " if results.cells["ok"].to_numpy().any() else "next: "
        lines.append(f"{lead}{results.replay_command(row.cell, row.sample)}")
    return "\n".join(lines)


def held_words(cells: Sequence[Cell]) -> str:
    """What may help where vehicles hold inputs for a tick, without what all of them have."""
    vehicles = [cell.scenario.vehicle for cell in cells if cell.scenario.engine.samples]
    helps = ["vehicle.standstill: stop"] * any(each.standstill == "fail" for each in vehicles)
    helps += ["vehicle.limits"] * any(not each.limits for each in vehicles)
    helps += ["a shorter tick", "a faster start (initial.speed)"]
    told = "engine: sampled holds inputs for a tick, and a slow vehicle's are great (as 1/speed)"
    return f"{told}: try {', '.join(helps)}, best together" if vehicles else ""


def failures_alike(
    results: Results, by_cell: Mapping[int, Counter[str]]
) -> list[tuple[list[int], str, int]]:
    """Cells whose lanes failed for the same reasons, all or some of them.

    Each group has its cells, how many lanes failed for which reason, and the number of its lanes.
    """
    lanes = results.cells["lanes"].astype(int).to_dict()
    groups: dict[tuple[bool, tuple[str, ...]], list[int]] = {}
    for cell, kinds in by_cell.items():
        groups.setdefault((kinds.total() == lanes[cell], tuple(sorted(kinds))), []).append(cell)
    told = (counted(sum((by_cell[n] for n in cells), Counter[str]())) for cells in groups.values())
    many = (sum(lanes[cell] for cell in cells) for cells in groups.values())
    return [*zip(groups.values(), told, many, strict=True)]


def lane_text(results: Results, row: pd.Series) -> str:
    """Row of a lane, and whether the stored row equals it."""
    stored = results.row(*map(int, row.loc[["cell", "sample"]].tolist()))
    room = terminal_width() - 4 - max(map(len, row.index))
    lines = row.dropna().map(lambda value: cut_text(value, room)).to_string()
    status = str(row["status"])
    if status in FAILURE_REASONS:
        lines = f"{lines}\n{filled(f'{status}: {FAILURE_REASONS[status]}')}"
    if stored is None:
        return f"{lines}\nno such row is stored"
    known: Any = row[stored.index]  # without columns that earlier versions had not
    apart = stored.compare(known, result_names=("stored", "replayed"))
    differs = f"DIFFERS from the stored row:\n{apart}"
    return f"{lines}\n{'the same as the stored row' if apart.empty else differs}"
