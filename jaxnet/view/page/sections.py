"""Sections of the page: a title, what it says, and a figure or a table of what others computed."""

import shlex
from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import is_leaderless, judged_metric
from jaxnet.config.naming import key_name, quantity, worded
from jaxnet.explore.courses import search_courses
from jaxnet.model.wording import cells_named, count, count_between, number_text
from jaxnet.runs.replay import worst_of_cells
from jaxnet.runs.watched import MOST_REPLAYED
from jaxnet.statistics.amplitude import ROUNDING_ERROR
from jaxnet.statistics.axes import choose_axes
from jaxnet.statistics.bands import error_bands, variable_over_time, vehicle_table
from jaxnet.statistics.curves import (
    BOUND_NAMES,
    METRIC_NAMES,
    Curve,
    cell_magnitudes,
    curves,
    failed_kinds,
    no_magnitudes,
)
from jaxnet.statistics.groups import Group
from jaxnet.statistics.quantities import unended_words
from jaxnet.statistics.recovery import criterion_words
from jaxnet.statistics.tiles import tile_table, tiling
from jaxnet.store.looking import MissingKindError, known_or
from jaxnet.store.results import Results
from jaxnet.store.rows import OK
from jaxnet.view import columns
from jaxnet.view.drawings.analyses import course_drawing
from jaxnet.view.drawings.heat import METRICS, heat_drawing, metric_label
from jaxnet.view.drawings.spreads import bands_drawing
from jaxnet.view.drawings.swept import answers, swept_drawing
from jaxnet.view.drawings.ultimate import ultimate_drawing
from jaxnet.view.figures.every import tail_words
from jaxnet.view.page import findings, trajectories
from jaxnet.view.page.elements import (
    Section,
    facts_html,
    folded_text,
    notes_html,
    paragraph,
    sentence_case,
    sortable_table,
    unbroken_names,
    views_html,
)
from jaxnet.view.page.plots import networks_html, plotted, tiled
from jaxnet.view.page.setting import alternatives, attacks, nested_name, setting_rows
from jaxnet.view.text import check, tables, worst
from jaxnet.view.text.analyses import RARE_LEGEND, SENSITIVITY_LEGEND, rare_rows

MOST_PAGE_ROWS = 10_000
MOST_LISTED = 200
MOST_NOTES = 6  # below the summary, more are folded
VEHICLE_WORDS = {
    "low": "5 % [m]",
    "median": "median [m]",
    "q95": "95 % [m]",
    "greatest": "greatest [m]",
    "unrecovered": "lanes over threshold [%]",
}
LEAD_WORDS = (
    "Cell: one combination of the swept values. Lane: one simulated run of a cell. ā: size of the"
    " attack. Tail: the end of a run, by which it is judged."
)
ULTIMATE_NOTE = "Error over the tail, with the bounds of theory where there are any."
NOT_ON_A_LOG_AXIS = " Cells with ā = 0 have no place on a log axis."
SLOPES_NOTE = (
    "The greatest error of any vehicle as a multiple of ā: the worst found, what was fitted, and"
    " the bounds of theory, if any. A dash: there is no such number."
)
FLEET_NOTE = " A bound of the fleet is one on the norm of the errors of all vehicles together."
HEAT_NOTE = (
    "One scale of colours for all maps. Point at a tile, touch it, or go to it with Tab and"
    " arrow keys for its interval and lanes."
)
TOO_LARGE = (
    "The page has no room for a lane of so large a fleet: see <code>jaxnet animate</code>, and"
    " <code>trajectories.zarr</code>."
)
CHOICE_OF_LANES = (
    "The worst lane of the study is first: it has the greatest {}. The others are the median and"
    f" the worst lane of {MOST_REPLAYED} cells at most, spread evenly over the study, and with"
    " recovery the worst per ā. The report simulates them again."
)
OTHER_ENGINE = (
    " Lanes marked “nonlinear engine” are simulated by it, whatever the engine of the study: they"
    " show whether vehicles come to rest, where their law is singular."
)


def page_sections(results: Results) -> list[Section]:
    """Every section for which the folder has data."""
    theory = known_or([], lambda: check.networks(results.study.cells))
    makers: list[Callable[[Results], Section | None]]
    makers = [sensitivity_section, rare_section, lambda results: run_section(results, theory)]
    if results.has_run:
        found = known_or([], lambda: curves(results))
        of_navigator = not is_leaderless(results.study.cells)
        makers = [
            lambda results: unbroken_names(
                findings.findings_section(results, found, fit_command(results), theory)
            ),
            answer_section,
            makers[-1],
            summary_section,
            *[lambda results: ultimate_section(results, found)] * of_navigator,
            bands_section,
            vehicles_section,
            heat_section,
            search_section,
            lanes_section,
            *[violations_section] * of_navigator,
            sensitivity_section,
            rare_section,
            failed_section,
            left_out_section,
        ]
    shown = (known_or(None, lambda make=make: make(results)) for make in makers)
    return [section for section in shown if section is not None]


def lead_sentence(results: Results) -> str:
    """The numbers of cells and lanes."""
    cells = count(len(results.study.cells), "cell")
    if not results.has_run:
        return f"{cells}; no run of the study is here."
    lanes, rows = results.manifest["lanes"], known_or({}, lambda: setting_rows(results.study))
    many = count(lanes["total"], "lane")
    told = f"{cells}, {many}: {lanes['ok']:,} ok, {lanes['failed']:,} failed."
    if rows:
        told += f" Vehicles: {escape(rows['vehicles'])}. Time: {escape(rows['time'])}."
    if "attacked signals" in rows:
        kinds = (cell.scenario.attack for cell in results.study.cells if attacks(cell.scenario))
        attack = alternatives([*dict.fromkeys(map(nested_name, kinds))])
        told += escape(f" Attack: {attack}, on {rows['attacked signals']}.")
    return f"{told}<br><small>{LEAD_WORDS}</small>"


def left_out_section(results: Results) -> Section | None:
    if not results.missing:
        return None
    words = escape(str(MissingKindError(", ".join(results.missing))))
    return Section("left-out", "Left out", paragraph(f"What cannot be told without code: {words}"))


def answer_section(results: Results) -> Section | None:
    """The answers of the study, None if no lane tells one."""
    cells = results.study.cells
    if len(cells) == 1:
        return None  # a finding says it
    shown = answers(results, cells)
    if not shown:
        return None
    axes = choose_axes(cells)
    over = f" against {key_name(axes.x)}" if axes.x else ""
    views = {each.words: plotted(swept_drawing(each, axes, cells)) for each in shown}
    title = sentence_case(shown[0].words) + over
    return Section("answer", escape(title), views_html(views) + notes_html([tail_words(cells)]))


def run_section(results: Results, theory: Sequence[check.AlikeCells]) -> Section:
    """The setting, the versions, and the networks."""
    study, manifest = results.study, results.manifest
    values = known_or({}, lambda: setting_rows(study))
    if results.has_run:
        values |= {
            "samples": f"{count_between(results.samples, 'lane')} of each cell",
            "device": manifest["device"],
            "wall time": f"{number_text(manifest['wall_seconds'])} s, without interrupted runs"
            " and searches",
        }
    versions = (f"{package} {version}" for package, version in manifest["versions"].items())
    values |= {"seed": str(study.config.seed), "versions": ", ".join(versions)}
    rows = facts_html({key: [value] for key, value in values.items()})
    networks = known_or("", lambda: networks_html(study.cells))
    certified = check.certificates(theory) if theory else []
    written = (results.path / "study.yaml").read_text()
    folded = folded_text("The study, every default written out", written)
    told = "".join(f"<h4>{escape(title)}</h4>{facts_html(known)}" for title, known in certified)
    folded += f"<details><summary>Certificates</summary>{told}</details>"
    return Section("run", "What was run", f"{rows}{networks}{folded}")


def summary_section(results: Results) -> Section:
    shown, constant = columns.split_constant(columns.summary_columns(results))
    notes, first = tables.summary_notes(results, shown), [constant]
    many = len(results.study.cells)
    if many > MOST_PAGE_ROWS:
        first.append(f"the first {MOST_PAGE_ROWS:,} of {many:,} cells; all are in cells.csv")
    lengths = [each.title for each in shown if each.title.endswith("[m]") and each.key is None]
    table = sortable_table(
        pd.DataFrame({each.title: each.scaled()[:MOST_PAGE_ROWS] for each in shown}),
        dict.fromkeys(lengths, cell_magnitudes(results)),
        {each.title: each.intervals() for each in shown if any(each.intervals())},
        names=[each.title for each in shown if each.key is not None],
    )
    told = notes_html(notes)
    if len(notes) > MOST_NOTES:
        told = f"<details><summary>Notes on the columns</summary>{told}</details>"
    return Section("summary", "Summary", table + notes_html(first) + told)


def ultimate_section(results: Results, found: Sequence[Curve]) -> Section | None:
    """The error over the tail against ā; None if no two cells differ in ā alone."""
    if not any(len(curve.cells) > 1 for curve in found):
        return None
    name = "Bounds and fits"
    if reason := no_magnitudes(found):
        return Section("ultimate", name, paragraph(escape(reason)))
    unattacked = bool((cell_magnitudes(results) == 0).any())
    note = paragraph(ULTIMATE_NOTE + NOT_ON_A_LOG_AXIS * unattacked)
    if not any(curve.bounds for curve in found):
        written = f"<code>{fit_command(results)}</code> writes them."
        note += paragraph(f"No bounds.csv and no fit.csv: {written}")
    views = {
        f"{words} ({metric})": plotted(ultimate_drawing(found, metric))
        for metric, words in METRIC_NAMES.items()
    }
    return Section("ultimate", name, note + views_html(views) + slopes_html(found))


def slopes_html(found: Sequence[Curve]) -> str:
    """Errors per ā by group: worst found, fitted, and bounded."""
    sound, rows = {b: name for b, name in BOUND_NAMES.items() if b != findings.UNSOUND_BOUND}, []
    for curve in found:
        fitted = curve.fit("tail_max") or (np.nan,) * 3
        share = findings.share_of_bound(curve)
        row = {"worst found": curve.worst, "of the least bound [%]": share}
        row |= dict(zip(("fit of the means", "fit, low", "fit, high"), fitted, strict=True))
        row["95 % of lanes below"] = (curve.fit("tail_max", 0.95) or (np.nan,))[0]
        for bound, name in sound.items():
            row[name], fleet = (curve.slope(bound, of) for of in ("worst", "fleet"))
            row[f"{name}, fleet"] = fleet
        rows.append(row)
    shown: Any = pd.DataFrame(rows)
    fleets = {name: f"{name}, fleet" for name in sound.values()}
    same = [fleet for name, fleet in fleets.items() if shown[name].equals(shown[fleet])]
    shown = shown.drop(columns=same).dropna(axis=1, how="all")
    slopes = dict.fromkeys(shown, np.ones(len(shown)))
    labels = pd.DataFrame(worded(curve.group.labels) for curve in found)
    about = [[cell.number for cell in curve.group.cells] for curve in found]
    table = sortable_table(pd.concat([labels, shown], axis=1), slopes, cells=about, names=[*labels])
    note = SLOPES_NOTE + FLEET_NOTE * any(name.endswith(", fleet") for name in shown)
    return paragraph(note) + table


def bands_section(results: Results) -> Section | None:
    """Errors over time, None if they are not stored."""
    if not (results.path / "errors.zarr").exists():
        return None
    cells = results.study.cells
    variable = variable_over_time(cells)
    found = error_bands(results.errors[variable], cells)
    if not found:
        return None
    name = "Spread over time" if is_leaderless(cells) else "Error over time"
    groups = [Group(dict(cells[number].labels), (cells[number],)) for number in found]
    drawing = bands_drawing(groups, found, variable)
    drawing = drawing._replace(notes=[*drawing.notes, unended_words(results, cells)])
    return Section("bands", name, plotted(drawing))


def vehicles_section(results: Results) -> Section | None:
    """Vehicles and their errors, None if errors of vehicles are not stored."""
    if not (results.path / "vehicles.zarr").exists():
        return None
    found = vehicle_table(results, results.study.cells)
    if found.empty:
        return None
    found = found.dropna(axis="columns", how="all")  # the share, without a threshold of recovery
    sizes = cell_magnitudes(results)
    per_size: Any = found["median"] / np.where(sizes > 0, sizes, 1.0)[found["cell"].astype(int)]
    known: Any = found[per_size.groupby(found["cell"]).transform("max") >= ROUNDING_ERROR]
    ranked = known.sort_values("median", ascending=False, kind="stable")
    rounded = sorted(map(int, {*found["cell"]} - {*known["cell"]}))
    ends = ranked.groupby("cell").nth([0, -1]).sort_values("cell", kind="stable")
    name, note = "Error of each vehicle", "Mean error over the tail"
    if is_leaderless(results.study.cells):
        name = note = "Distance of each vehicle from the mean"
    note += ", over lanes: the vehicles with the greatest and the least median of each cell."
    asked = results.study.config.recovery
    if asked is not None and "unrecovered" in found:
        criterion = escape(criterion_words(asked, results.study.cells))
        note += f" Lanes over threshold: recovery's, for the vehicle's own error ({criterion})."
    if rounded:
        note += f" In {cells_named(rounded)} the errors of all vehicles are rounding: no ranks."
    if ranked.empty:
        return Section("vehicles", name, paragraph(note))

    def table(rows: Any) -> str:
        of_rows = sizes[rows["cell"].astype(int)]
        lengths = {words: of_rows for words in VEHICLE_WORDS.values() if "[m]" in words}
        return sortable_table(rows.rename(columns=VEHICLE_WORDS), lengths)

    most = f"{min(MOST_LISTED, len(ranked))} of {count(len(ranked), 'row')}"
    folded = (
        f"<details><summary>By vehicle, {most}</summary>{table(ranked[:MOST_LISTED])}</details>"
    )
    return Section("vehicles", name, paragraph(note) + table(ends[:MOST_LISTED]) + folded)


def heat_section(results: Results) -> Section | None:
    """Heat maps, None unless two swept keys have two values each and a tile has a number."""
    tiles = tiling(results.study.cells)
    if tiles is None:
        return None
    known: Any = tile_table(results)
    differing = sorted(METRICS, key=lambda metric: known[metric].nunique() < 2)
    views = {
        metric_label(metric, results): tiled(heat_drawing(results, tiles, metric))
        for metric in differing
        if known[metric].notna().any()
    }
    body = paragraph(HEAT_NOTE) + views_html(views) if views else ""
    return Section("heat", "Heat map", body) if body else None


def search_section(results: Results) -> Section | None:
    """A search, random lanes and bounds; None before a search."""
    asked = results.study.config.search
    if asked is None or not (results.path / "worst.csv").exists():
        return None
    name = "The worst that a search found"
    rows, cells = worst.worst_rows(results), results.study.cells
    note = (
        f"{escape(sentence_case(worst.maximised_text(results)))}. The curves show the worst until"
        ' then, by lanes; <a href="#lanes">Lanes in motion</a> shows what was found.'
    )
    courses, unit = list(search_courses(results, cells)), worst.metric_with_unit(results)
    drawn = plotted(course_drawing(courses, cells, unit)) if courses else ""
    table = sortable_table(rows, names=[*map(quantity, cells[0].labels)])
    body = paragraph(note) + table + notes_html(worst.search_notes(results)) + drawn
    return Section("search", name, body)


def lanes_section(results: Results) -> Section | None:
    """Lanes whose trajectories are stored, or the command that makes them; None if none is ok."""
    found, many = trajectories.lanes_data(results)
    if found:
        again, report = "results.replay(C, S)", "results.report(DIR)"
        if not results.in_memory:
            report = escape(shlex.join(["jaxnet", "report", str(results.path)]))
            again = results.replay_command(0, 0).removesuffix(" --cell 0 --sample 0")
            again = f"{escape(again)} --cell C --sample S"
        note = (
            f"{count(len(found), 'lane')} of the {many:,} whose trajectories are stored. Any other:"
            f" <code>{again}</code>, then <code>{report}</code>."
            f" {CHOICE_OF_LANES.format(tables.CRITERIA[judged_metric(results.study.cells)])}"
        )
        note += OTHER_ENGINE * any("nonlinear engine)" in lane["label"] for lane in found)
        body = paragraph(note) + trajectories.lanes_html(found)
    elif many:
        body = paragraph(TOO_LARGE)
    elif (ended := worst_of_cells(results, 1)).empty:
        return None
    else:
        row: Any = ended.loc[ended[judged_metric(results.study.cells)].idxmax()]
        command = escape(results.replay_command(int(row["cell"]), int(row["sample"])))
        body = paragraph(f"No lane was replayed yet; the worst: <code>{command}</code>")
    return Section("lanes", "Lanes in motion", body)


def violations_section(results: Results) -> Section | None:
    """Lanes above a bound that claims to hold for them, None if there are none."""
    if not results.file("violations.csv").exists() or results.violations.empty:
        return None
    rows = results.violations
    note = f"; the first {MOST_LISTED}:" if len(rows) > MOST_LISTED else ":"
    body = paragraph(f"{count(len(rows), 'lane')}{note}") + sortable_table(rows.head(MOST_LISTED))
    return Section("violations", "Lanes above a bound of theory", body)


def sensitivity_section(results: Results) -> Section | None:
    """Sobol's indices, None if there are none."""
    if "sensitivity" not in results.analyses:
        return None
    rows: Any = results.sensitivity.dropna(subset="first")
    swept = [*results.study.cells[0].labels]
    shown = rows[["cell", *swept, "metric", "quantity", "first", "total", "samples"]].copy()
    shown["metric"] = shown["metric"].str.replace("_", " ")
    shown["quantity"] = shown["quantity"].map(key_name)
    intervals = {
        order: [
            "" if np.isnan(low) else f"[{low:.2f}, {high:.2f}]"
            for low, high in zip(rows[f"{order}_low"], rows[f"{order}_high"], strict=True)
        ]
        for order in ("first", "total")
    }
    named = swept_named(shown, swept)
    named = named.rename(columns={"metric": "of", "quantity": "quantity drawn"})
    note = f"Sobol's indices: {escape(SENSITIVITY_LEGEND)} A click on a header sorts."
    table = sortable_table(named, intervals=intervals)
    return Section("sensitivity", "What matters", paragraph(note) + table)


def rare_section(results: Results) -> Section | None:
    """Rare failures, None if they were not counted."""
    if "rare" not in results.analyses:
        return None
    rows = swept_named(rare_rows(results.rare), [*results.study.cells[0].labels])
    return Section("rare", "Rare failures", sortable_table(rows) + notes_html([RARE_LEGEND]))


def swept_named(rows: pd.DataFrame, keys: Sequence[str]) -> pd.DataFrame:
    """Rows with the names of swept keys and of their values."""
    labels: Any = rows[[*keys]]
    named = rows.rename(columns={key: quantity(key) for key in keys})
    for name, words in pd.DataFrame(map(worded, labels.to_dict("records")), rows.index).items():
        named[name] = words
    return named


def failed_section(results: Results) -> Section | None:
    by_cell = failed_kinds(results)
    if not by_cell:
        return None
    groups, rows = tables.failures_alike(results, by_cell), []
    for cells, told, lanes in groups:
        first: Any = next(results.by_cell(where=~OK, cells=cells[:1]))[1].iloc[0]
        command = results.replay_command(cells[0], int(first["sample"]))
        row = {"cells": cells_named(cells), "failed": told, "of lanes": lanes}
        rows.append(row | {"to see the first": command})
    about = [cells for cells, *_ in groups]
    return Section("failed", "Failed lanes", sortable_table(pd.DataFrame(rows), cells=about))


def fit_command(results: Results) -> str:
    """The command that writes fits, bounds and violations, escaped for HTML."""
    if results.in_memory:
        return "results.fit()"
    return escape(shlex.join(["jaxnet", "fit", str(results.path)]))
