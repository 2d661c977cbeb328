"""Findings about a results folder, in sentences."""

import functools
from collections import Counter
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import is_leaderless, judged_metric
from jaxnet.config.naming import NO_BREAK, labels_title, value_name
from jaxnet.kinds.metrics import AGREEMENT, CONTRACT, LANE_STATISTICS, WITH_DETECTOR, Metric
from jaxnet.kinds.metrics.min_separation import MIN_SEPARATION
from jaxnet.model.wording import count, counted, number_text
from jaxnet.statistics import curves
from jaxnet.statistics.amplitude import ROUNDING_ERROR
from jaxnet.statistics.groups import Label
from jaxnet.statistics.horizon import lost_cells
from jaxnet.statistics.intervals import ROUNDING_SPREAD
from jaxnet.statistics.isolation import isolated_lanes
from jaxnet.statistics.limits import at_once_words, unchecked_words
from jaxnet.statistics.quantities import meaning, stored_values
from jaxnet.statistics.recovery import (
    attacked_mask,
    confidence_told,
    share_name,
    threshold,
)
from jaxnet.statistics.separation import near_starts_words
from jaxnet.statistics.summary import share_names
from jaxnet.store import rows
from jaxnet.store.results import Results
from jaxnet.view.drawings.words import ROUNDED, error_text
from jaxnet.view.page.best import best_sentence
from jaxnet.view.page.decided import tests_html
from jaxnet.view.page.elements import Section, paragraph, sentence_case
from jaxnet.view.page.grid import grid_html, near_text
from jaxnet.view.page.judged import (
    criterion_text,
    held_word,
    is_negligible,
    judged_errors,
    judged_lanes,
    judged_word,
    known_shares,
    percent_text,
    separation_asked,
    settled,
)
from jaxnet.view.page.proved import ideal_sentence, outnumbered_sentence, proved_sentence
from jaxnet.view.page.where import MOST_TOLD, span_words, where_words
from jaxnet.view.text import worst
from jaxnet.view.text.check import AlikeCells
from jaxnet.view.text.tables import HELD_TOO_LONG, grave_warnings, held_words, other_warnings
from jaxnet.view.text.width import numbered_words

UNSOUND_BOUND = "lyapunov_printed"  # false in general (theorems.md O5), so no bound to be tight
MEDIAN_LANE = {  # by `judged_word`
    "error": "In the median lane{} the error (a mean over vehicles and the tail{})",
    "spread": "In the median lane{} the greatest spread over the tail{}",
}

AMONG = "groups of cells that differ in ā alone"
MOVED = 10  # times as far as without an attack


def findings_section(
    results: Results, found: Sequence[curves.Curve], fit: str, theory: Sequence[AlikeCells]
) -> Section:
    """Every finding; `fit` is the command that computes the bounds."""
    cells = results.study.cells
    alone = is_leaderless(cells)
    lanes = judged_lanes(results, range(len(cells)))
    separated = separation_sentence(results)
    grid, best = grid_html(results, lanes), best_sentence(results, lanes)
    first = [] if grid else [unrecovered_sentence(results), extremes_sentence(results)]
    searched = search_sentence(results)
    best += " These lanes are random; what a search finds is below." * bool(best and searched)
    sentences = [
        *first,
        searched,
        baseline_sentence(results),
        proved_sentence(results, theory),
        failed_sentence(results),
        isolated_sentence(results),
        *(f"<b>Warning:</b> {each}." for each in grave_warnings(results, cells)),
        outside_sentence(results) if alone else "",
        "" if alone else bounds_sentence(results, found, fit),
        separated,
        metrics_list(results, MIN_SEPARATION.name * bool(separated)),
        ideal_sentence(results),
        outnumbered_sentence(results),
        *(f"<b>Warning:</b> {each}." for each in other_warnings(results, cells)),
    ]
    body = paragraph(best) * bool(best) + grid + bullets(sentences) + tests_html(results, lanes)
    body = body.replace(" %", f"{NO_BREAK}%").replace(ROUNDED, "0")
    return Section("findings", "Findings", body)


def bullets(sentences: Iterable[str]) -> str:
    items = "".join(f"<li>{each}</li>" for each in sentences if each)
    return f"<ul>{items}</ul>" * bool(items)


def failed_sentence(results: Results) -> str:
    """How many lanes failed, where, and which cells no other finding is about."""
    lanes, there = results.manifest["lanes"], curves.failed_kinds(results)
    if not there:
        return ""
    kinds = escape(counted(sum(there.values(), Counter())))
    failed = f"<b>{count(lanes['failed'], 'lane')} of {lanes['total']:,} failed</b>: {kinds}"
    failed += f", {where_words(results, sorted(there))}".rstrip(", ")
    held = [results.study.cells[cell] for cell, each in there.items() if {*each} & {*HELD_TOO_LONG}]
    helps = f" {sentence_case(escape(held_words(held)))}." * bool(held)
    left = sorted(curves.mostly_failed(results))
    if not left or not lanes["ok"]:
        return f"{failed}.{helps}"
    where = "there" if left == sorted(there) else where_words(results, left)
    few = "Few lanes", "errors there are of these few"
    if not results.cells["ok"].iloc[left].to_numpy().any():
        few = "No lane", "these cells have no errors below"
    return f"{failed}. {few[0]} ended {where}".rstrip() + f": {few[1]}.{helps}"


def isolated_sentence(results: Results) -> str:
    """In how many lanes that ended vehicles were cut off, or came to rest, and where."""
    told = []
    for words, lanes in isolated_lanes(results).items():
        many, of = map(sum, zip(*lanes.values(), strict=True))
        where = where_words(results, [cell for cell, (some, _) in lanes.items() if some])
        told.append(f"{words} in <b>{many:,} of {of:,} lanes</b> that ended, {where}".rstrip(", "))
    return f"{sentence_case('; '.join(told))}." * bool(told)


def nothing_words(results: Results) -> str:
    """Why no cell has a number."""
    if not results.manifest["lanes"]["ok"]:
        return "no lane came to its end"
    return "no attacked cell has enough lanes that ended"


def baseline_sentence(results: Results) -> str:
    """Errors without an attack, and where they alone are above what recovery allows."""
    cells, attacked = results.study.cells, attacked_mask(results.study.cells)
    medians: Any = results.cells[f"{judged_metric(cells)}_median"].reset_index(drop=True)
    usual = medians[~attacked].dropna()
    if usual.empty or not attacked.any():
        return ""

    def setting(number: int) -> tuple[Label, ...]:
        labels = cells[number].labels.items()
        return tuple(value for key, value in labels if not key.startswith("attack"))

    least, asked = dict[tuple[Label, ...], float](), results.study.config.recovery
    for number, error in usual.items():
        least[setting(number)] = min(error, least.get(setting(number), np.inf))
    above = [
        number
        for number in np.flatnonzero(attacked).tolist()
        if least.get(setting(number), 0.0) > threshold(cells[number], asked)
    ]
    ends = dict.fromkeys(near_text(end) for end in (usual.min(), usual.max()))
    word = judged_word(results)
    told = f"<b>Without an attack</b> the {word} of the median lane is <b>{' to '.join(ends)} m</b>"
    if not above:
        return f"{told}."
    among = np.flatnonzero(attacked).tolist()
    where = where_words(results, above, among)
    return f"{told}: {where} this alone is above what recovery allows, whatever the attack does."


def extremes_sentence(results: Results) -> str:
    """The cells with the least and the greatest error of the median lane."""
    word, errors = judged_word(results), judged_errors(results)
    if errors.values.empty:
        return f"No {word}: {nothing_words(results)}."
    formed = any(cell.scenario.formation.present for cell in results.study.cells)
    less = ", less the offsets of the formation" * formed
    held = without_lost(results, errors.values, f"{judged_metric(results.study.cells)}_median")
    among = [n for n in errors.among if n in held.index or n not in errors.values.index]
    which = [" that has settled"] * (len(errors.values) < len(errors.among))
    which += [" whose fleet is not lost"] * (len(held) < len(errors.values))
    of_cell = f" of a cell{' and'.join(which)}" * (len(results.study.cells) > 1)
    start = MEDIAN_LANE[word].format(of_cell, less)
    if is_negligible(results, errors):
        most = error_text(float(errors.values["value"].to_numpy().max()))
        return f"{start} is at most <b>{most} m</b>."
    span = span_words(results, held, error_text, f" {errors.unit}", among)
    return f"{start} {span}."


def without_lost(results: Results, values: Any, column: str) -> Any:
    """A frame or a series by cell, without cells that are lost by a column, unless all are."""
    held = values.drop(index=lost_cells(results, column), errors="ignore")
    return values if held.empty else held


def outside_sentence(results: Results) -> str:
    """How far honest vehicles leave the hull of their starts, and where, without a navigator."""
    cells, attacked = results.study.cells, attacked_mask(results.study.cells)
    names = ["outside_median", "outside_max", *share_names("in_hull")]
    ways: Any = results.cells.reindex(columns=names).reset_index(drop=True)
    ways = ways.dropna(subset=names[:2])
    if ways.empty:
        return ""
    if ways["outside_max"].max() < ROUNDING_ERROR:
        return "No honest vehicle left the convex hull of the honest starts, in any lane."
    # Without an attack to compare with, nobody knows who moved them
    usual: Any = ways["outside_median"][~attacked[ways.index]]
    is_left = attacked & (
        ways["outside_median"].reindex(range(len(cells))).to_numpy()
        > [np.fmax(MOVED * usual.max(), each.scenario.engine.accuracy) for each in cells]
    )
    some = is_left if is_left.any() else ways["outside_max"] >= ROUNDING_ERROR
    moved = [place for place in ways.index if some[place]]
    words = "Honest vehicles leave the convex hull of their starts"
    if is_left.any():
        words = f"In half of the lanes or more {words[0].lower()}{words[1:]}"
    if is_left.any() and len(usual):
        words = "Liars move honest vehicles out of the convex hull of their starts"
        shares: Any = curves.unrecovered_shares(results)["unrecovered"].reindex(moved)
        if (shares < 0.5).all():
            words = "Honest vehicles agree, but on a place that liars move out of the hull"
        words = f"<b>{words}</b>"

    longest = max(cell.scenario.horizon for cell in cells)
    told = f"{words} {where_words(results, moved)}".rstrip() + f" within {longest:g} s"
    if len(cells) == 1:  # else a table has the numbers
        (median,), (worst,) = ways[names[0]], ways[names[1]]
        found, high, low = (percent_text(100 * (1 - ways[name][0])) for name in names[2:])
        told += (
            f", in {found} % of lanes (95 % interval {low} to {high} %), in the median lane by"
            f" <b>{near_text(median)} m</b> and in the worst lane by <b>{near_text(worst)} m</b>"
        )
    return f"{told}. In a longer run they may go farther."


def share_words(results: Results) -> str:
    """The share of lanes that did not recover, as the subject of a sentence."""
    failed = "failed or " * bool(results.manifest["lanes"]["failed"])
    return f"The share of lanes that {failed}did not {held_word(results)}"


def unrecovered_sentence(results: Results) -> str:
    """The least and the greatest share of lanes unrecovered, if the study asks for it."""
    found: Any = curves.unrecovered_shares(results)
    asked = results.study.config.recovery
    cells, confidence = results.study.cells, confidence_told(results.study.config.samples)
    if asked is None and found.empty:
        return ""
    known = known_shares(results)
    share: Any = settled(results, known)
    if share.empty:
        return f"No share {share_name(cells)}: {nothing_words(results)}."
    alone = " in cells that have settled" * (len(share) < len(known))
    span = span_words(results, share, percent_text, " %", known.index.tolist(), confidence)
    return f"{share_words(results)}{criterion_text(results)}{alone} {span}."


def separation_sentence(results: Results) -> str:
    """How many lanes have a pair nearer than filters ask for."""
    cells, least = results.study.cells, dict[str, list[pd.Series]]()
    if (asked := separation_asked(results)) is None:
        return ""
    name, limit = asked
    each: Any
    for number, each in results.by_cell("sample", name, where=rows.OK):
        least.setdefault(str(cells[number].labels.get("filter", "")), []).append(each[name])
    told = []
    for label, each in least.items():
        found = np.concatenate(each)
        by = f" with {escape(value_name('filter', label))}" if label else ""
        many = f"in <b>{np.count_nonzero(found < limit)}</b> of {len(found)} lanes{by}"
        told.append(f"{many} (least distance {error_text(found.min())} m)")
    parts = [f"two vehicles come nearer than D = {limit:g} m {', '.join(told)}"]
    parts += dict.fromkeys(near_starts_words(results.study.config, cell.scenario) for cell in cells)
    return " ".join(f"{sentence_case(each)}." for each in parts if each)


def metrics_list(results: Results, without: str) -> str:
    """Medians, and the greatest lane, of each metric beside errors."""
    own = results.study.config.measured()[len(CONTRACT) :]
    asked = [each for each in own if each.name not in {*AGREEMENT, without}]
    watched = [each.number for each in results.study.cells if each.scenario.detector.present]

    def told(metric: Metric) -> str:
        names = (f"{metric.name}_{each}" for each in LANE_STATISTICS["median"].columns)
        medians: Any = stored_values(results.cells.reset_index(drop=True), [*names])
        medians = medians.drop(index=curves.mostly_failed(results)).dropna(subset="value")
        if metric.base in WITH_DETECTOR:
            medians = medians[medians.index.isin(watched)]
        if medians.empty:
            return ""
        endless: Any = medians.index[np.isinf(medians["value"])]
        medians = medians.drop(index=endless)
        unit = f" {metric.column_unit}".rstrip()
        number = functools.partial(error_text, scale=float(metric.column_unit == "m"))
        greatest: Any = results.cells[f"{metric.name}_max"].reset_index(drop=True)
        greatest = float(greatest[medians.index].max())
        parts = []
        if not medians.empty:
            among = medians.index.tolist() + endless.tolist()
            parts.append(span_words(results, medians, number, unit, among))
        if (
            metric.time != "min"
            and medians["value"].to_numpy().max(initial=0.0) < greatest < np.inf
        ):
            parts.append(f"the greatest lane has {number(greatest)}{unit}")
        if len(endless):
            where = where_words(results, endless.tolist())
            parts.append(f"is infinite (never reached) {where}".rstrip())
        return f"<li>{escape(sentence_case(meaning(metric)))} {'; '.join(parts)}.</li>"

    items = "".join(map(told, asked))
    return f"In the median lanes of cells:<ul>{items}</ul>" if items else ""


def search_sentence(results: Results) -> str:
    """The worst that a search found, beside as many random lanes; "" without a search."""
    if results.study.config.search is None:
        return ""
    if not (results.path / "worst.csv").exists():
        return "The search is still to be run: <code>jaxnet search CONFIG</code>"
    rows: Any = worst.worst_rows(results).set_index("cell").dropna(subset=worst.LENGTHS["greatest"])
    if rows.empty:
        return ""
    unit = " ā" if worst.is_per_size(results) else ""
    found, random = rows[worst.LENGTHS["greatest"]], rows[worst.LENGTHS["random"]].max()
    found = found.to_frame("value").assign(low=np.nan, high=np.nan)
    span = span_words(results, found, error_text, unit, found.index.tolist())
    lanes = count(int(rows[worst.SEARCH_LANES].max()), "lane")
    return (
        f"By search the {escape(worst.metric_words(results))} {span}, in {lanes} of a cell at most;"
        f" as many random lanes reach {error_text(random)}{unit}."
    )


def bounds_sentence(results: Results, found: Sequence[curves.Curve], fit: str) -> str:
    """The least ratio of a bound to the worst error found."""
    if not found:
        return "Errors have no bound beside them: no cell has an attack of a fixed magnitude."
    told = worst_words(results)
    if not results.file("bounds.csv").exists():
        return f"{told}Bounds are not fitted yet: <code>{fit}</code>"
    bounded = [curve for curve in found if sound_limits(curve)]
    shares = [share for share in map(share_of_bound, bounded) if not np.isnan(share)]
    if len(shares) > MOST_TOLD:
        ends = f"<b>{percent_text(min(shares))} to {percent_text(max(shares))} %</b>"
        some = "cells" if all(len(curve.cells) == 1 for curve in found) else AMONG
        told += f"In {len(shares)} {some} the worst error is {ends} of the least bound. "
    elif bounded:
        told += f"Per ā the worst error is {'; '.join(map(bound_words, bounded))}. "
    if bounded and results.file("violations.csv").exists():
        many = len(results.violations[["cell", "sample"]].drop_duplicates())
        above = f'<b>{count(many, "lane")}</b> above a bound: see <a href="#violations">below</a>. '
        told += above if many else "No lane is above its bound. "
    named = functools.partial(numbered_words, cells=results.study.cells)
    if unchecked := unchecked_words(results.study.cells, named):
        told += f"No bound is known for {escape(unchecked)}. "
    if at_once := at_once_words(results.study.cells):
        told += f"{at_once.capitalize()}."
    return told.strip()


def worst_words(results: Results) -> str:
    """The greatest error of a vehicle in any lane, and its cell; "" if no lane ended."""
    worst: Any = results.cells["tail_max_max"].reset_index(drop=True).dropna()
    if worst.empty:
        return ""
    held = without_lost(results, worst, "tail_max_max")
    alike = held.index[held >= (1 - ROUNDING_SPREAD) * held.max()].tolist()
    where = where_words(results, alike)
    lanes = "Of random lanes the" if results.file("worst.csv").exists() else "The"
    lanes = "Where no lane is lost, the" if len(held) < len(worst) else lanes
    told = f"{lanes} worst error of a vehicle is <b>{error_text(held.max())} m</b> {where}"
    return f"{told.rstrip()}. "


def sound_limits(curve: curves.Curve) -> list[tuple[float, str]]:
    """Bounds on the greatest error per ā that hold, the least first, with their names."""
    limits = curve.limits("tail_max").items()
    return sorted((slope, name) for name, slope in limits if name != UNSOUND_BOUND)


def share_of_bound(curve: curves.Curve) -> float:
    """The worst error over the least bound [%]; not-a-number without a bound above 0."""
    worst = curve.worst if curve.worst >= ROUNDING_ERROR else 0.0
    least = min((slope for slope, _ in sound_limits(curve)), default=0.0)
    return 100 * worst / least if least else np.nan


def bound_words(curve: curves.Curve) -> str:
    """The worst error of a group of cells, and its least bound."""
    where = f" with {escape(labels_title(curve.group.labels))}" if curve.group.labels else ""
    slope, name = sound_limits(curve)[0]
    bound = f"{curves.BOUND_NAMES[name]} {number_text(slope)} ā"
    bound += ", once the transient is over" * (slope < curve.worst)
    return f"<b>{error_text(curve.worst, 1.0)} ā</b>{where} (least bound: {bound})"
