"""Sections of the page: text, tables, and places for the plots."""

import shlex
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from jaxnet.config.cells import is_leaderless, judged_metric
from jaxnet.config.naming import key_name, quantity, value_alone
from jaxnet.explore.courses import search_courses
from jaxnet.model.wording import count_between
from jaxnet.runs.replay import worst_of_cells
from jaxnet.runs.watched import MOST_REPLAYED
from jaxnet.statistics.axes import choose_axes
from jaxnet.statistics.bands import error_bands
from jaxnet.statistics.curves import (
    BOUND_NAMES,
    LOG_FLOOR,
    NO_SLOPE,
    Curve,
    cell_magnitudes,
    curves,
    no_magnitudes,
)
from jaxnet.statistics.limits import unchecked_words
from jaxnet.statistics.quantities import asked_quantity, quantity_of
from jaxnet.statistics.recovery import share_name
from jaxnet.statistics.tiles import tiling
from jaxnet.statistics.vehicles import vehicle_table
from jaxnet.store.looking import MissingKindError, known_or
from jaxnet.store.results import Results
from jaxnet.view import columns
from jaxnet.view.page import findings, networks, plots, trajectories
from jaxnet.view.page.elements import folded_text, sortable_table
from jaxnet.view.page.setting import setting_rows
from jaxnet.view.text import check, tables, worst
from jaxnet.view.text.sensitivity import SENSITIVITY_LEGEND

MOST_PAGE_ROWS = 10_000
MOST_LISTED = 200
PLOT_PLACE = '<div class="drawn"></div>'  # where the script draws


class Section(NamedTuple):
    """A section of the page: HTML below a title, and data for the script that draws its plot."""

    id: str
    title: str
    body: str
    plots: Any = None

    def __str__(self) -> str:
        """Return the section as HTML."""
        return f'<section id="{self.id}"><h2>{self.title}</h2>\n{self.body}</section>'


def page_sections(results: Results) -> list[Section]:
    """Return every section for which the folder has data."""
    if not results.has_run:
        analyses = [sensitivity_section(results), rare_section(results), run_section(results)]
        return [section for section in analyses if section is not None]
    found, alone = known_or([], lambda: curves(results)), is_leaderless(results.study.cells)
    each: list[Callable[[], Section | None]] = [
        lambda: answer_section(results),
        lambda: findings_section(results, found),
        lambda: run_section(results),
        lambda: summary_section(results),
        lambda: None if alone else ultimate_section(results, found),
        lambda: bands_section(results),
        lambda: vehicles_section(results),
        lambda: heat_section(results),
        lambda: search_section(results),
        lambda: lanes_section(results),
        lambda: None if alone else violations_section(results),
        lambda: sensitivity_section(results),
        lambda: rare_section(results),
        lambda: failed_section(results),
        lambda: left_out_section(results),
    ]
    shown = (known_or(None, section) for section in each)
    return [section for section in shown if section is not None]


def left_out_section(results: Results) -> Section | None:
    """Return the section that names kinds without code, or None if the code of all is here."""
    if not results.missing:
        return None
    words = escape(str(MissingKindError(", ".join(results.missing))))
    return Section("left-out", "Left out", f"<p>What cannot be told without code: {words}</p>")


def lead_sentence(results: Results) -> str:
    """Return the numbers of cells and lanes as a sentence."""
    if not results.has_run:
        return f"{check.count(len(results.study.cells), 'cell')}; no run of the study is here."
    count = results.manifest["lanes"]
    return (
        f"{check.count(len(results.study.cells), 'cell')}, {check.count(count['total'], 'lane')}:"
        f" {count['ok']:,} ok, {count['failed']:,} failed."
    )


def findings_section(results: Results, found: list[Curve]) -> Section:
    """Return the section of findings, in sentences."""
    told = findings.finding_sentences(results, found, fit_command(results))
    return Section(
        "findings", "Findings", f"<ul>{''.join(f'<li>{each}</li>' for each in told)}</ul>"
    )


def run_section(results: Results) -> Section:
    """Return the section on the study, the versions and the networks."""
    study, manifest = results.study, results.manifest
    versions = ", ".join(
        f"{package} {version}" for package, version in manifest["versions"].items()
    )
    ran = (
        {}
        if not results.has_run
        else {
            "samples": f"{count_between(results.samples, 'lane')} of each cell",
            "device": manifest["device"],
            "wall time": f"{manifest['wall_seconds']:.4g} s",
        }
    )
    values = known_or({}, lambda: setting_rows(study)) | ran
    values |= {"seed": str(study.config.seed), "versions": versions}
    rows = "".join(f"<dt>{key}</dt><dd>{escape(value)}</dd>" for key, value in values.items())
    certificates = known_or([], lambda: check.certificates(study.cells))
    body = (
        f"<dl>{rows}</dl>"
        + known_or("", lambda: networks.networks_html(study.cells))
        + folded_text(
            "The study, every default written out", (results.path / "study.yaml").read_text()
        )
        + folded_text(
            f"Certificates of {check.count(len(certificates), 'network')}",
            "\n\n".join(certificates),
        )
    )
    return Section("run", "What was run", body)


def summary_section(results: Results) -> Section:
    """Return the section with the table of all cells."""
    shown, constant = columns.split_constant(columns.summary_columns(results))
    notes = [*([constant] if constant else []), *tables.summary_notes(results, shown)]
    count = len(results.study.cells)
    if count > MOST_PAGE_ROWS:
        notes.append(f"the first {MOST_PAGE_ROWS:,} of {count:,} cells; all are in cells.csv")
    note = f"<p>{' '.join(f'{escape(sentence_case(each))}.' for each in notes)}</p>"
    magnitudes = cell_magnitudes(results)[:MOST_PAGE_ROWS]
    rows = pd.DataFrame({each.title: each.scaled()[:MOST_PAGE_ROWS] for each in shown})
    body = sortable_table(
        rows,
        ([cell] for cell in rows["cell"]),
        {
            each.title: magnitudes
            for each in shown
            if each.title.endswith("[m]") and each.key is None
        },
        {each.title: each.intervals() for each in shown if each.ends is not None},
    )
    return Section("summary", "Summary", note + body)


def sentence_case(words: str) -> str:
    """Return words with a capital first letter, unless a symbol comes first."""
    return words if words[:1] in "āϑδ" else words[:1].upper() + words[1:]


def ultimate_section(results: Results, found: list[Curve]) -> Section:
    """Return the section on the ultimate error against ā."""
    name = "Ultimate error δ̂(ā)"
    if reason := no_magnitudes(found):
        return Section("ultimate", name, f"<p>{escape(reason)}</p>")
    note = (
        "<p>Error over the tail against the attack's magnitude. Bounds of the worst vehicle (of the mean over"
        " vehicles for the mean error), where they say something. Cells with ā = 0 have no place on a log"
        " axis; a median far below ā stands on the axis.</p>"
    )
    if not any(curve.bounds for curve in found):
        note += (
            f"<p>No bounds.csv and no fit.csv: <code>{fit_command(results)}</code> writes them.</p>"
        )
    return Section(
        "ultimate", name, note + PLOT_PLACE + slopes_html(found), plots.ultimate_data(found)
    )


def slopes_html(found: Sequence[Curve]) -> str:
    """Return a table of errors per ā by group: worst found, fitted, and bounded."""
    rows = []
    for curve in found:
        row = {**label_columns(curve.group.labels), "worst found": curve.worst}
        s, low, high = curve.fit("tail_max") or (np.nan,) * 3
        s95, *_ = curve.fit("tail_max", 0.95) or (np.nan,)
        row |= {"least squares": s, "low": low, "high": high, "95 % of lanes": s95}
        for bound, name in BOUND_NAMES.items():
            row |= {
                name: curve.slope(bound, "worst"),
                f"{name}, fleet": curve.slope(bound, "fleet"),
            }
        rows.append(row)
    shown: Any = pd.DataFrame(rows)
    slopes = shown.columns.difference(list(label_columns(found[0].group.labels)))
    ones = np.ones(len(shown))
    about = [[cell.number for cell in curve.group.cells] for curve in found]
    same = [
        f"{name}, fleet"
        for name in BOUND_NAMES.values()
        if shown[name].equals(shown[f"{name}, fleet"])
    ]
    flat = (
        f" {sentence_case(NO_SLOPE)}." if any(curve.is_flat("tail_max") for curve in found) else ""
    )
    return (
        "<p>Slopes, greatest error of any vehicle per ā: the worst found at any ā, fitted ones, bounds of the"
        f" worst vehicle and of the fleet. A dash: the bound says nothing there.{flat}</p>"
        + sortable_table(
            shown.drop(columns=same).dropna(axis=1, how="all"), about, dict.fromkeys(slopes, ones)
        )
    )


def label_columns(labels: Mapping[str, object]) -> dict[str, object]:
    """Return swept values by the names of their keys; text is a name too, numbers sort as numbers."""
    return {
        quantity(key): value_alone(key, value) if isinstance(value, str) else value
        for key, value in labels.items()
    }


def bands_section(results: Results) -> Section | None:
    """Return the section on ẽ(t), or None if errors over time are not stored."""
    if not (results.path / "errors.zarr").exists():
        return None
    found = error_bands(results, results.study.cells)
    if not found:
        return None
    below = f"what is below {LOG_FLOOR:g} m is rounding and drawn there."
    name, what = "Error over time ẽ(t)", "Mean error of the fleet over time"
    if is_leaderless(results.study.cells):
        name, what = (
            "Spread over time",
            "Greatest distance of two vehicles that are not attacked over time",
        )
    note = f"<p>{what}; {below}</p>"
    return Section("bands", name, note + PLOT_PLACE, plots.bands_data(results.study.cells, found))


def vehicles_section(results: Results) -> Section | None:
    """Return the table of vehicles and their errors, or None if errors of vehicles are not stored."""
    if not (results.path / "vehicles.zarr").exists():
        return None
    found = vehicle_table(results, results.study.cells)
    if found.empty:
        return None
    shown = found.sort_values("median", ascending=False, kind="stable").head(MOST_LISTED)
    shown = shown.dropna(axis="columns", how="all")  # the share, without a threshold of recovery
    words = {
        "low": "5 % [m]",
        "median": "median [m]",
        "q95": "95 % [m]",
        "greatest": "greatest [m]",
    }
    words["unrecovered"] = "lanes off [%]"
    note = "<p>Mean error over the tail of each vehicle, over lanes, the greatest median first"
    left = f"; {len(shown)} of {len(found)}" if len(shown) < len(found) else ""
    table = sortable_table(shown.rename(columns=words), ([cell] for cell in shown["cell"]))
    return Section("vehicles", "Who tracks", f"{note}{left}.</p>{table}")


def answer_section(results: Results) -> Section | None:
    """Return the figure of what the study asks for, or None if no lane tells it."""
    cells, asked = results.study.cells, asked_quantity(results.study.config)
    found = quantity_of(results, cells, asked)
    if not found.known.size:
        return None
    axes = choose_axes(cells)
    over = f" against {key_name(axes.x)}" if axes.x else ""
    title = f"{found.words[0].upper()}{found.words[1:]}{over}"
    note = f"<p>{escape(sentence_case(found.notes))}.</p>"
    return Section("answer", escape(title), note + PLOT_PLACE, plots.curve_data(found, axes, cells))


def heat_section(results: Results) -> Section | None:
    """Return the section with heat maps, or None unless two swept keys have two values each."""
    name, tiles = "Heat map", tiling(results.study.cells)
    if tiles is None:
        return None
    drawn = plots.tiles_data(results, tiles)
    if not drawn["metrics"]:
        return Section("heat", name, "<p>No lane attacked with a fixed ā came to its end.</p>")
    note = (
        "<p>One scale of colours for all tables. Point at a tile, touch it, or go to it with Tab and arrow"
        " keys for its interval and lanes. * Some of its lanes failed; they are in no number.</p>"
    )
    return Section("heat", name, note + PLOT_PLACE, drawn)


def search_section(results: Results) -> Section | None:
    """Return the section on a search, random lanes and bounds, or None without a search."""
    asked = results.study.config.search
    if asked is None:
        return None
    name = "The worst that a search found"
    if not (results.path / "worst.csv").exists():
        return Section(
            "search", name, "<p>Not searched for yet: <code>jaxnet search CONFIG</code></p>"
        )
    rows = worst.worst_rows(results)
    chosen = ", ".join(f"<code>{escape(key)}</code>" for key in asked.over)
    bound = " the bound of theory where known," if "bound" in rows else ""
    note = (
        f"<p>{escape(worst.maximised_text(results))}, over {chosen}. Found: the choice at the horizon. Late:"
        f" the same choice at {worst.late_times(results)}, where what is transient has died away. Greatest:"
        f" any choice at the horizon. Then the greatest of as many random lanes,{bound} and the same choice"
        " from 10,000 other starts, and by the nonlinear engine. Below, the best until then, by lanes; Lanes"
        " in motion shows what was found.</p>"
        f"<p>{escape(sentence_case(worst.starts_text(results)))}.</p>"
    )
    drawn = plots.searches_data(
        search_courses(results, results.study.cells),
        worst.metric_with_unit(results),
    )
    return Section(
        "search",
        name,
        note + sortable_table(rows, ([cell] for cell in rows["cell"])) + PLOT_PLACE,
        drawn,
    )


def sensitivity_section(results: Results) -> Section | None:
    """Return the section on Sobol's indices, or None if there are none."""
    if "sensitivity" not in results.analyses:
        return None
    rows: Any = results.sensitivity.dropna(subset="first")
    labels = {key: quantity(key) for key in results.study.cells[0].labels}
    shown = pd.DataFrame(
        {"cell": rows["cell"]}
        | {name: rows[key] for key, name in labels.items()}
        | {"of": [each.replace("_", " ") for each in rows["metric"]]}
        | {"quantity drawn": [key_name(key) for key in rows["quantity"]]}
        | {order: rows[order] for order in ("first", "total")}
        | {"samples": rows["samples"]}
    )
    intervals = {
        order: [
            "" if np.isnan(low) else f"[{low:.2f}, {high:.2f}]"
            for low, high in zip(rows[f"{order}_low"], rows[f"{order}_high"], strict=True)
        ]
        for order in ("first", "total")
    }
    note = f"<p>Sobol's indices: {escape(SENSITIVITY_LEGEND)} A click on a header sorts.</p>"
    table = sortable_table(shown, ([cell] for cell in rows["cell"]), intervals=intervals)
    return Section("sensitivity", "What matters", note + table)


def rare_section(results: Results) -> Section | None:
    """Return the section on rare failures, or None if they were not counted."""
    if "rare" not in results.analyses:
        return None
    rows = results.rare.drop(columns=["points", "threshold"])
    note = (
        f"<p>The share of lanes {share_name(results.study.cells)} by subset simulation, with a 95 % interval"
        " over its repeats; plain lanes: the number of random lanes with an interval as narrow.</p>"
    )
    labels = {key: quantity(key) for key in results.study.cells[0].labels}
    shown = rows.rename(columns=labels | {"plain_lanes": "plain lanes"})
    return Section(
        "rare", "Rare failures", note + sortable_table(shown, ([cell] for cell in rows["cell"]))
    )


def lanes_section(results: Results) -> Section:
    """Return the section that animates lanes."""
    name, (found, many) = "Lanes in motion", trajectories.lanes_data(results)
    if many and not found:
        return Section("lanes", name, f"<p>{TOO_LARGE}</p>")
    if not found:
        ended = worst_of_cells(results, 1)
        if ended.empty:
            return Section("lanes", name, "<p>No lane is ok.</p>")
        row: Any = ended.loc[ended[judged_metric(results.study.cells)].idxmax()]
        command = escape(results.replay_command(int(row["cell"]), int(row["sample"])))
        return Section(
            "lanes", name, f"<p>No lane was replayed yet; the worst: <code>{command}</code></p>"
        )
    if results.in_memory:
        again, report = "results.replay(C, S)", "results.report(DIR)"
    else:
        report = escape(shlex.join(["jaxnet", "report", str(results.path)]))
        again = escape(results.replay_command(0, 0).removesuffix(" --cell 0 --sample 0"))
        again += " --cell C --sample S"
    note = (
        f"<p>{check.count(len(found), 'lane')} of the {many:,} whose trajectories are stored. Any other:"
        f" <code>{again}</code>, then <code>{report}</code>. {CHOICE_OF_LANES}</p>"
    )
    return Section("lanes", name, note + PLOT_PLACE, found)


TOO_LARGE = (
    "The page has no room for a lane of so large a fleet: see <code>jaxnet animate</code>, and"
    " <code>trajectories.zarr</code>."
)
CHOICE_OF_LANES = (
    f"The report simulates again the median and the worst lane of {MOST_REPLAYED} cells at most, spread"
    " evenly over the study, and the worst lanes of the study if it asks for recovery."
)


def violations_section(results: Results) -> Section:
    """Return the section on lanes above a bound that claims to hold for them."""
    name, file = "Violations of bounds", results.file("violations.csv")
    if not file.exists():
        return Section(
            "violations", name, f"<p>Not looked for yet: <code>{fit_command(results)}</code></p>"
        )
    rows = results.violations
    if not len(rows):
        words = "None: no lane is above a bound that claims to hold for it."
        if unchecked := unchecked_words(results.study.cells):
            words += f" No bound is known for {escape(unchecked)}."
        return Section("violations", name, f"<p>{words}</p>")
    return Section("violations", name, lanes_listed(rows.head(MOST_LISTED), len(rows)))


def failed_section(results: Results) -> Section:
    """Return the section on failed lanes."""
    name = "Failed lanes"
    count, shown = results.failed(MOST_LISTED)
    if not count:
        return Section("failed", name, "<p>None.</p>")
    places = zip(shown["cell"], shown["sample"], strict=True)
    commands = [results.replay_command(cell, sample) for cell, sample in places]
    return Section("failed", name, lanes_listed(shown.assign(command=commands), count))


def lanes_listed(rows: pd.DataFrame, count: int) -> str:
    """Return a table of lanes, and the number of all lanes."""
    note = f"; the first {len(rows)}:" if len(rows) < count else ":"
    return f"<p>{check.count(count, 'lane')}{note}</p>" + sortable_table(
        rows, ([cell] for cell in rows["cell"])
    )


def fit_command(results: Results) -> str:
    """Return the command that writes fits, bounds and violations, escaped for HTML."""
    if results.in_memory:
        return "results.fit()"
    return escape(shlex.join(["jaxnet", "fit", str(results.path)]))
