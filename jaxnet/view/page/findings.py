"""Findings about a results folder, in sentences."""

import functools
from collections import Counter
from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import is_leaderless, judged_metric
from jaxnet.config.naming import NO_BREAK, key_name, labels_title, value_name
from jaxnet.kinds.kind import vehicle_numbers
from jaxnet.kinds.metrics import AGREEMENT, CONTRACT, DETECTION, LANE_STATISTICS, Metric
from jaxnet.kinds.metrics.min_separation import MIN_SEPARATION
from jaxnet.model.wording import count, counted, number_text, ranges
from jaxnet.statistics import curves
from jaxnet.statistics.amplitude import ROUNDING_ERROR
from jaxnet.statistics.falling import falling_words
from jaxnet.statistics.horizon import errors_words
from jaxnet.statistics.limits import unchecked_words
from jaxnet.statistics.nominal import misfit_words
from jaxnet.statistics.quantities import VALUE_COLUMNS, meaning, stored_values
from jaxnet.statistics.recovery import (
    attacked_mask,
    confidence_told,
    criterion_words,
    lowered_words,
    share_name,
    threshold,
)
from jaxnet.statistics.separation import near_starts_words
from jaxnet.statistics.summary import share_names
from jaxnet.store import rows
from jaxnet.store.results import Results
from jaxnet.view.drawings.words import error_text
from jaxnet.view.page.compared import (
    P_WORDS,
    TestRows,
    compares_shares,
    judged_word,
    kinds_words,
    named,
    percent_text,
    swept_kinds,
    swept_texts,
    tested_words,
)
from jaxnet.view.page.elements import Section, notes_html, sentence_case, sortable_table
from jaxnet.view.page.where import MOST_TOLD, NEGLIGIBLE, above_text, span_words, where_words
from jaxnet.view.text import worst
from jaxnet.view.text.facts import attacked_at_once, starved_words

UNSOUND_BOUND = "lyapunov_printed"  # false in general (theorems.md O5), so no bound to be tight
MEDIAN_LANE = {  # by `judged_word`
    "error": "In the median lane of a cell the error, a mean over vehicles and the tail{},",
    "spread": "In the median lane of a cell the greatest spread over the tail{}",
}

MOVED = 10  # times as far as without an attack
NEARLY = 1.2  # times one another
MOST_TESTS = 200  # in the table of p values


def findings_section(results: Results, found: Sequence[curves.Curve], fit: str) -> Section:
    tests = TestRows()
    sentences = finding_sentences(results, found, fit, tests)
    told = [each.replace(" %", f"{NO_BREAK}%") for each in sentences]
    folded = ""
    if tests:
        table = pd.DataFrame(sorted(tests, key=lambda each: each["p"])[:MOST_TESTS])
        what = f"p values of {count(len(tests), 'comparison')}"
        body = sortable_table(table) + notes_html([P_WORDS])
        folded = f"<details><summary>{what}</summary>{body}</details>"
    return Section(
        "findings", "Findings", f"<ul>{''.join(f'<li>{each}</li>' for each in told)}</ul>{folded}"
    )


def finding_sentences(
    results: Results,
    found: Sequence[curves.Curve],
    fit: str,
    tests: TestRows,
) -> list[str]:
    """Each finding as HTML; `fit` is the command that computes the bounds.

    `tests` receives a row for each comparison of paired lanes.
    """
    cells = results.study.cells
    alone = is_leaderless(cells)
    warnings = [falling_words(results, cells), errors_words(results.study.config, cells)]
    warnings += [lowered_words(results, cells), *misfit_words(results, cells)]
    separated = separation_sentence(results, tests)
    sentences = [
        outnumbered_sentence(results),
        failed_sentence(results),
        outside_sentence(results) if alone else "",
        *(f"<b>{sentence_case(each)}</b>." for each in warnings if each),
        unrecovered_sentence(results, tests),
        extremes_sentence(results, found, tests),
        separated,
        metrics_list(results, MIN_SEPARATION.name * bool(separated)),
        search_sentence(results),
        "" if alone else bounds_sentence(results, found, fit),
    ]
    return [each for each in sentences if each]


def outnumbered_sentence(results: Results) -> str:
    """Where vehicles hear more attacked sources than they can drop, or at some ticks too few."""
    found, starved = dict[tuple[str, str], list[int]](), dict[str, list[int]]()
    most = 0
    for cell in results.study.cells:
        defence, given = cell.scenario.defence, attacked_at_once(cell.scenario)
        (graph, attacked, trusted), which = given, defence.outnumbered(*given)
        drops = defence.may_drop(graph, trusted).links.any(axis=1)
        few = f"it drops nobody: the rule asks {defence.asks()}"
        for each, why in (which & drops, "more than it can drop"), (which & ~drops, few):
            if each.any():
                found.setdefault((ranges(vehicle_numbers(each)), why), []).append(cell.number)
                most = max(most, int(attacked[each].sum(axis=1).max()))
        if attacked.any() and (words := starved_words(cell.scenario)):
            starved.setdefault(words, []).append(cell.number)
    whom = (
        f"vehicle{'' if who.isdigit() else 's'} {who} {where_words(results, cells)}".rstrip()
        + f" ({why})"
        for (who, why), cells in found.items()
    )
    told = [f", with up to {count(most, 'attacked source')} each: {'; '.join(whom)}"] * bool(found)
    ticks = "; ".join(f"{w} {where_words(results, n)}".rstrip() for w, n in starved.items())
    told += [f" at some ticks: {ticks}"] * bool(ticks)
    return " ".join(f"<b>Outside the assumptions of the defence{each}</b>." for each in told)


def failed_sentence(results: Results) -> str:
    """How many lanes failed, where, and which cells no other finding is about."""
    lanes, there = results.manifest["lanes"], curves.failed_kinds(results)
    if not there:
        return ""
    kinds = escape(counted(sum(there.values(), Counter())))
    failed = f"<b>{count(lanes['failed'], 'lane')} of {lanes['total']:,} failed</b>: {kinds}"
    failed += f", {where_words(results, sorted(there))}".rstrip(", ")
    left = sorted(curves.mostly_failed(results))
    if not left or not lanes["ok"]:
        return f"{failed}."
    where = "these cells" if left == sorted(there) else f"the cells {where_words(results, left)}"
    return f"{failed}. Of {where} more lanes failed than ended: the errors below leave them out."


def errors_per_size(results: Results) -> tuple[pd.DataFrame, str]:
    """Median errors of cells with intervals, and their unit: per ā, or in metres without ā."""
    metric = judged_metric(results.study.cells)
    names = [f"{metric}_{name}" for name in LANE_STATISTICS["median"].columns]
    errors = stored_values(results.cells.reset_index(drop=True), names)
    known = curves.cell_magnitudes(results)
    per_size = metric != "spread" and not np.isnan(known).all()
    found: Any = errors.div(known, axis="index") if per_size else errors
    found = found.drop(index=curves.mostly_failed(results))
    return found.dropna(subset="value"), "ā" if per_size else "m"


def failed_cells(results: Results) -> list[int]:
    """The attacked cells among those of which more lanes failed than ended; all without attacks."""
    attacked, failed = attacked_mask(results.study.cells), curves.mostly_failed(results)
    return [cell for cell in failed if attacked[cell] or not attacked.any()]


def nothing_words(results: Results) -> str:
    """Why no cell has a number."""
    if not results.manifest["lanes"]["ok"]:
        return "no lane came to its end"
    return "no attacked cell has enough lanes that ended"


def settled(
    results: Results, values: pd.DataFrame, told: Callable[[float], str], unit: str
) -> tuple[pd.DataFrame, str]:
    """The values of cells whose errors do not fall any more, if there are any, and a sentence."""
    falls: Any = results.cells.reindex(columns=["falling"])["falling"]
    is_left: Any = falls[values.index] != 1
    if is_left.all() or not is_left.any():
        return values, ""
    left: Any = values[is_left]
    others: Any = values[~is_left]
    ends = dict.fromkeys(map(told, (others["value"].min(), others["value"].max())))
    where = where_words(results, others.index.tolist())
    now = f"{' to '.join(ends)}{unit} at the end of the run is no limit"
    return (
        left,
        f" {sentence_case(where)} the {judged_word(results)} still falls: {now}.",
    )


def extremes_sentence(results: Results, found: Sequence[curves.Curve], tests: TestRows) -> str:
    """The cells with the least and the greatest error of the median lane: per ā where it rises so.

    Errors that do not rise with ā, or not in proportion, are told in metres.
    """
    errors, unit = errors_per_size(results)
    word = judged_word(results)
    if errors.empty:
        return f"No {word}: {nothing_words(results)}."
    among, sizes = errors.index.tolist(), curves.cell_magnitudes(results)
    errors, falling = settled(results, errors, error_text, f" {unit}")
    groups = [[cell.number for cell in curve.group.cells] for curve in found]
    apart = [[n for n in group if n in errors.index] for group in groups if unit == "ā"]
    bent = [group for group in apart if group and not is_proportional(errors.loc[group])]
    metres: Any = errors.mul(sizes[errors.index], axis="index")
    metres = metres.where(errors.abs() >= ROUNDING_ERROR, 0.0)
    level: Any = metres["value"]
    flat = [n for group in bent if level[group].max() <= NEARLY * level[group].min() for n in group]
    odd = [n for group in bent for n in group if n not in flat]
    compared = kinds_words(results, errors, unit, tests, failed_cells(results), listed=not bent)
    unrecovered: Any = curves.unrecovered_shares(results)["unrecovered"]
    if len(unrecovered) and not unrecovered.any():  # below what is asked; p values are in the table
        compared = ""
    parts = []
    rising = errors.drop(index=[*flat, *odd])
    if not rising.empty:
        parts.append(span_words(results, rising, error_text, f" {unit}", among))
    for cells, words in ((flat, "does not rise with ā"), (odd, "is not proportional to ā")):
        if cells:
            where = f"{where_words(results, cells)} it " * bool(parts)
            span = span_words(results, metres.loc[cells], error_text, " m", cells)
            parts.append(f"{sentence_case(where)}{words}, and {span}")
    formed = any(cell.scenario.formation.present for cell in results.study.cells)
    less = ", less the offsets of the formation" * formed
    limits = [threshold(cell, results.study.config.recovery) for cell in results.study.cells]
    least = np.fmin.reduce(limits, initial=np.inf)
    if unit == "m" and errors["value"].max() < NEGLIGIBLE * least < np.inf:
        most = above_text(float(errors["value"].to_numpy().max()))
        parts, compared = [f"is at most <b>{most} m</b>"], ""
    return f"{MEDIAN_LANE[word].format(less)} {'. '.join(parts)}.{compared}{falling}"


def is_proportional(values: pd.DataFrame) -> bool:
    """Whether errors per ā are the same but for their intervals, or nearly so."""
    low, high = values["low"].fillna(values["value"]), values["high"].fillna(values["value"])
    return bool(low.max() <= high.min() or values["value"].max() <= NEARLY * values["value"].min())


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
    moved = [place for place in ways.index if is_left[place]] or ways.index.tolist()
    rest = ways.index.difference(moved).tolist()
    words = "Honest vehicles leave the convex hull of their starts"
    if is_left.any() and len(usual):
        words = "Liars move honest vehicles out of the convex hull of their starts"
        shares: Any = curves.unrecovered_shares(results)["unrecovered"].reindex(moved)
        if (shares < 0.5).all():
            words = "Honest vehicles agree, but on a place that liars move out of the hull"
        words = f"<b>{words}</b>"

    def share(places: Sequence[int]) -> str:
        left: Any = ways.loc[places].sort_values("in_hull").iloc[0]
        if np.isnan(left["in_hull"]):
            return "in some lanes"
        found, high, low = (percent_text(100 * (1 - left[name])) for name in names[2:])
        most = "up to " * (len(places) > 1)
        return f"in {most}{found} % of lanes (95 % interval {low} to {high} %)"

    longest = max(cell.scenario.horizon for cell in cells)
    medians = stored_values(ways.loc[moved], names[:1])
    span = span_words(results, medians, error_text, " m", moved)
    worst, least = (error_text(ways["outside_max"][each].max()) for each in (moved, rest))
    elsewhere = ""
    if rest:
        elsewhere = f" In the other cells they leave it {share(rest)}, by at most {least} m."
        if ways["outside_max"][rest].max() < ROUNDING_ERROR:
            elsewhere = " In the other cells nobody leaves it."
    for key in swept_kinds(results, ways.index):
        texts = swept_texts(results, ways.index.tolist())[key]
        told = [
            f"{error_text(ways['outside_max'][texts == label].max())} m with {named(key, label)}"
            for label in dict.fromkeys(texts)
        ]
        if len({each.split(" with ")[0] for each in told}) > 1:
            elsewhere += f" By {escape(key_name(key))} the worst lane goes {', '.join(told)}."
    return (
        f"{words} {where_words(results, moved)} within {longest:g} s, {share(moved)}. The way out"
        f" of the median lane {span}; that of the worst lane is {worst} m.{elsewhere}"
        " In a longer run they may go farther."
    )


def share_words(results: Results) -> str:
    """The share of lanes that did not recover, as the subject of a sentence."""
    ended = "did not agree" if is_leaderless(results.study.cells) else "did not recover"
    return f"The share of lanes that {ended}"


def unrecovered_sentence(results: Results, tests: TestRows) -> str:
    """The least and the greatest share of lanes unrecovered, if the study asks for it."""
    found: Any = curves.unrecovered_shares(results)
    asked = results.study.config.recovery
    cells, confidence = results.study.cells, confidence_told(results.study.config.samples)
    if asked is None and found.empty:
        return ""
    known = 100 * found.astype(float).set_axis(VALUE_COLUMNS, axis="columns")
    known = known.drop(index=curves.mostly_failed(results), errors="ignore")
    if known.empty:
        return f"No share {share_name(cells)}: {nothing_words(results)}."
    share, falling = settled(results, known, percent_text, " %")
    compared = ""
    if compares_shares(results):
        compared = kinds_words(results, share, "%", tests, failed_cells(results))
    above = "" if asked is None else f" ({criterion_words(asked, cells)})"
    span = span_words(results, share, percent_text, " %", known.index.tolist(), confidence)
    told = f":{compared}".replace(": By", ": by") if compared else f" {span}."
    settled_alone = ", where it has settled" * bool(falling)
    return f"{share_words(results)}{above}{settled_alone}{told}{falling}"


def separation_sentence(results: Results, tests: TestRows) -> str:
    """How many lanes have a pair nearer than the distance that filters ask for, by filter."""
    cells, metrics = results.study.cells, results.study.config.metrics
    name = next((each.name for each in metrics if each.base == MIN_SEPARATION.name), None)
    limits = [each for cell in cells if (each := cell.scenario.filter.asks()) is not None]
    if name is None or not limits:
        return ""
    limit, lanes, least = max(limits), dict[int, pd.Series](), dict[str, list[pd.Series]]()
    each: Any
    for number, each in results.by_cell("sample", name, where=rows.OK):
        lanes[number] = -each.set_index("sample")[name]  # the farther apart the better
        least.setdefault(str(cells[number].labels.get("filter", "")), []).append(each[name])
    told = {}
    for label, each in least.items():
        found = np.concatenate(each)
        by = f" with {escape(value_name('filter', label))}" if label else ""
        many = f"in <b>{np.count_nonzero(found < limit)}</b> of {len(found)} lanes{by}"
        told[label] = f"{many} (least distance {error_text(found.min())} m)"
    found = [f"two vehicles come nearer than D = {limit:g} m {', '.join(told.values())}"]
    if len(told) > 1:
        swept = pd.DataFrame([cells[n].labels for n in lanes], [*lanes]).map(str)
        more = "in more lanes the least distance is greater"
        found.append(tested_words(results, "filter", [*told], swept, lanes, more, tests))
    found += dict.fromkeys(near_starts_words(results.study.config, cell.scenario) for cell in cells)
    return " ".join(f"{sentence_case(each)}." for each in found if each)


def metrics_list(results: Results, without: str) -> str:
    """Medians, and the greatest lane, of each metric of the study's own but shares of alarms."""
    own = results.study.config.measured()[len(CONTRACT) :]
    asked = [each for each in own if each.name not in {*AGREEMENT, *DETECTION, without}]

    def told(metric: Metric) -> str:
        names = (f"{metric.name}_{each}" for each in LANE_STATISTICS["median"].columns)
        medians = stored_values(results.cells.reset_index(drop=True), [*names])
        medians = medians.dropna(subset="value")
        if medians.empty:
            return ""
        endless: Any = medians.index[np.isinf(medians["value"])]
        medians = medians.drop(index=endless)
        unit = f" {metric.column_unit}".rstrip()
        number = functools.partial(error_text, scale=float(metric.column_unit == "m"))
        greatest = float(results.cells[f"{metric.name}_max"].to_numpy().max())
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
            parts.append(f"is infinite {where_words(results, endless.tolist())}".rstrip())
        return f"<li>{escape(sentence_case(meaning(metric)))} {'; '.join(parts)}.</li>"

    items = "".join(map(told, asked))
    return f"In the median lanes of cells:<ul>{items}</ul>" if items else ""


def search_sentence(results: Results) -> str:
    """The worst that a search found, beside as many random lanes; "" without a search."""
    if results.study.config.search is None:
        return ""
    if not (results.path / "worst.csv").exists():
        return "The search is still to be run: <code>jaxnet search CONFIG</code>"
    rows: Any = worst.worst_rows(results).set_index("cell").dropna(subset=worst.LENGTHS["found"])
    if rows.empty:
        return ""
    unit = " ā" if worst.is_per_size(results) else ""
    found, random = rows[worst.LENGTHS["found"]], rows[worst.LENGTHS["random"]].max()
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
    if not results.file("bounds.csv").exists():
        return f"{worst_words(results)}Bounds are not fitted yet: <code>{fit}</code>"
    bounded = [curve for curve in found if sound_limits(curve)]
    beside = "; ".join(map(bound_words, bounded))
    if len(bounded) > MOST_TOLD:
        shares = [100 * curve.worst / sound_limits(curve)[0][0] for curve in bounded]
        ends = f"{number_text(min(shares))} to {number_text(max(shares))} %"
        beside = f"<b>{ends}</b> of its least bound in {len(bounded)} groups of cells (table below)"
    searched = "Of random lanes the" if results.file("worst.csv").exists() else "The"
    words = [f"{searched} worst error of a vehicle is {beside}."]
    if not bounded:
        words = [worst_words(results).strip()]
    if bounded and results.file("violations.csv").exists():
        many = len(results.violations[["cell", "sample"]].drop_duplicates())
        above = f'<b>{count(many, "lane")}</b> above a bound: see <a href="#violations">below</a>.'
        words.append(above if many else "No lane is above its bound.")
    if unchecked := unchecked_words(results.study.cells):
        words.append(f"No bound is known for {escape(unchecked)}.")
    return " ".join(words)


def worst_words(results: Results) -> str:
    """The greatest error of a vehicle in any lane, and its cell; "" if no lane ended."""
    worst: Any = results.cells["tail_max_max"].reset_index(drop=True).dropna()
    if worst.empty:
        return ""
    values, numbers = worst.to_numpy(float), worst.index.tolist()
    where = where_words(results, [numbers[values.argmax()]])
    told = f"The worst error of a vehicle is <b>{error_text(values.max())} m</b> {where}".rstrip()
    return f"{told}. "


def sound_limits(curve: curves.Curve) -> list[tuple[float, str]]:
    """Bounds on the greatest error per ā that hold, the least first, with their names."""
    limits = curve.limits("tail_max").items()
    return sorted((slope, name) for name, slope in limits if name != UNSOUND_BOUND)


def bound_words(curve: curves.Curve) -> str:
    """The worst error of a group of cells, and its least bound."""
    where = f" with {escape(labels_title(curve.group.labels))}" if curve.group.labels else ""
    slope, name = sound_limits(curve)[0]
    bound = f"{curves.BOUND_NAMES[name]} {number_text(slope)} ā"
    bound += ", once the transient is over" * (slope < curve.worst)
    return f"<b>{error_text(curve.worst, 1.0)} ā</b>{where} (least bound: {bound})"
