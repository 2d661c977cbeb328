"""Findings about a results folder, in sentences."""

import functools
import itertools
from collections import Counter
from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import is_leaderless, judged_metric
from jaxnet.config.keys import Sequential
from jaxnet.config.naming import MAGNITUDE, NO_BREAK, is_kind, key_name, labels_title, value_name
from jaxnet.kinds.metrics import AGREEMENT, CONTRACT
from jaxnet.model.wording import cells_named, count, count_between, counted, number_text
from jaxnet.statistics import curves
from jaxnet.statistics.falling import falling_words
from jaxnet.statistics.groups import swept_values_of
from jaxnet.statistics.intervals import CONFIDENCE
from jaxnet.statistics.limits import unchecked_words
from jaxnet.statistics.pairs import CellsCompared, compared_cells
from jaxnet.statistics.quantities import VALUE_COLUMNS, Quantity, quantity_of, stored_values
from jaxnet.statistics.recovery import (
    attacked_mask,
    confidence_told,
    criterion_words,
    share_name,
    threshold,
)
from jaxnet.statistics.summary import LANE_STATISTICS, share_names
from jaxnet.store import rows
from jaxnet.store.results import Results
from jaxnet.view.columns import ROUNDING_ERROR
from jaxnet.view.drawings.words import error_text
from jaxnet.view.page.elements import Section, sentence_case
from jaxnet.view.text import worst

UNSOUND_BOUND = "lyapunov_printed"  # false in general (theorems.md O5), so no bound to be tight
MEDIAN_WORDS = f", {LANE_STATISTICS['median'].words}"
MEDIAN_LANE = {  # by `judged_word`
    "error": "In the median lane of a cell the error, a mean over vehicles and the tail,",
    "spread": "In the median lane of a cell the greatest spread over the tail",
}
MOST_COMPARED, MOST_TOLD = 8, 3  # values of a swept key in one sentence, and of a few cells


def findings_section(results: Results, found: Sequence[curves.Curve], fit: str) -> Section:
    sentences = finding_sentences(results, found, fit)
    told = [each.replace(" %", f"{NO_BREAK}%") for each in sentences]
    return Section(
        "findings", "Findings", f"<ul>{''.join(f'<li>{each}</li>' for each in told)}</ul>"
    )


def finding_sentences(results: Results, found: Sequence[curves.Curve], fit: str) -> list[str]:
    """Each finding as HTML; `fit` is the command that computes the bounds."""
    alone = is_leaderless(results.study.cells)
    lanes, falling = results.manifest["lanes"], falling_words(results, results.study.cells)
    failed = f"All {count(lanes['total'], 'lane')} came to their end; none failed."
    if lanes["failed"]:
        there = curves.failed_kinds(results)
        kinds = escape(counted(sum(there.values(), Counter())))
        failed = f"<b>{count(lanes['failed'], 'lane')} of {lanes['total']:,} failed</b>: {kinds}"
        failed += f", {where_words(results, sorted(there))}".rstrip(", ") + "."
    sentences = [
        f"<b>{sentence_case(falling)}</b>." if falling else "",
        unrecovered_sentence(results),
        extremes_sentence(results),
        outside_sentence(results) if alone else "",
        *metric_sentences(results),
        search_sentence(results),
        failed,
        "" if alone else bounds_sentence(results, found, fit),
        f"Each cell has {count_between(results.samples, 'lane')}.",
    ]
    return [each for each in sentences if each]


def errors_per_size(results: Results) -> tuple[pd.DataFrame, str]:
    """Median errors of cells with intervals, and their unit: per ā, or in metres without ā."""
    metric = judged_metric(results.study.cells)
    names = [f"{metric}_{name}" for name in LANE_STATISTICS["median"].columns]
    errors = stored_values(results.cells.reset_index(drop=True), names)
    known = curves.cell_magnitudes(results)
    per_size = metric != "spread" and not np.isnan(known).all()
    found: Any = errors.div(known, axis="index") if per_size else errors
    return found.dropna(subset="value"), "ā" if per_size else "m"


def settled(results: Results, values: pd.DataFrame) -> tuple[pd.DataFrame, str]:
    """The values of cells whose errors do not fall any more, if there are any, and a sentence."""
    falls: Any = results.cells.reindex(columns=["falling"])["falling"]
    left: Any = values[falls[values.index] != 1]
    if left.empty or len(left) == len(values):
        return values, ""
    named = cells_named(sorted({*values.index} - {*left.index}))
    return left, f" Left out: {named}, whose {judged_word(results)} still falls."


def where_words(results: Results, numbers: Sequence[int], among: Sequence[int] = ()) -> str:
    """The swept values that some of the cells `among` have alone; else those of the first cell."""
    cells = [results.study.cells[n] for n in among or range(len(results.study.cells))]
    labels, many = results.study.cells[numbers[0]].labels, len(numbers)
    if not labels:
        return ""
    if many == len(cells) > 1:
        attacked = len(cells) < len(results.study.cells)
        return f"in {f'all {many}' if attacked else 'every'} cell{'s' * attacked}"
    varied = (
        key for key, values in swept_values_of(results.study.cells).items() if len(values) > 1
    )
    first = escape(labels_title({key: labels[key] for key in varied}) or labels_title(labels))
    if many == 1:
        return f"with {first} (cell {numbers[0]})"
    mine = swept_values_of([results.study.cells[n] for n in numbers])
    there = swept_values_of(cells)
    alike = [cell for cell in cells if all(cell.labels[key] in mine[key] for key in mine)]
    told = {key: values for key, values in mine.items() if len(values) < len(there[key])}
    if len(alike) > many or max(map(len, told.values())) > MOST_TOLD:
        return f"in {many} cells (such as cell {numbers[0]}: {first})"
    words = (" or ".join(value_name(key, each) for each in told[key]) for key in told)
    return f"with {escape(', '.join(words))} ({many} cells)"


def span_words(
    results: Results,
    values: pd.DataFrame,
    told: Callable[[float], str],
    unit: str,
    sure: float = CONFIDENCE,
) -> str:
    """The least and the greatest value, each with its interval and cells; one if they read alike.

    `values` have the columns value, low and high; `told` is the text of a number.
    """
    texts: Any = values["value"].map(told)
    parts = {}
    for place in (values["value"].idxmin(), values["value"].idxmax()):
        alike: Any = values[texts == texts[place]]
        ends = [dict.fromkeys(map(told, alike[end].dropna())) for end in ("low", "high")]
        interval = ""
        if all(ends) and {*ends[0], *ends[1]} != {texts[place]}:
            within = "s within" * (max(map(len, ends)) > 1)
            low, high = told(alike["low"].min()), told(alike["high"].max())
            interval = f" ({100 * sure:g} % interval{within} {low} to {high}{unit})"
        where = where_words(results, alike.index.tolist(), values.index.tolist())
        parts[texts[place]] = f"<b>{texts[place]}{unit}</b>{interval} {where}".rstrip()
    span = " to ".join(parts.values())
    return f"ranges from {span}" if len(parts) > 1 else f"is {span}"


def judged_word(results: Results) -> str:
    """The word for what lanes are judged by."""
    return "spread" if is_leaderless(results.study.cells) else "error"


def extremes_sentence(results: Results) -> str:
    """The cells with the least and the greatest error of the median lane."""
    errors, unit = errors_per_size(results)
    word, per_size = judged_word(results), unit == "ā"
    if errors.empty:
        none = f"No lane came to its end: there is no {word}."
        return "No attacked lane came to its end." if results.manifest["lanes"]["ok"] else none
    asked = (
        int(np.sum(curves.cell_magnitudes(results) > 0)) if per_size else len(results.study.cells)
    )
    left = count(asked - len(errors), "attacked cell" if per_size else "cell")
    without = f" {left} without a lane that ended." if len(errors) < asked else ""
    errors, falling = settled(results, errors)
    compared = "" if compares_shares(results) else kinds_words(results, errors, unit)
    span = span_words(results, errors, error_text, f" {unit}")
    offsets = any(cell.scenario.formation.present for cell in results.study.cells)
    less = ", less the offsets of the formation," * offsets
    return f"{MEDIAN_LANE[word]}{less} {span}.{compared}{without}{falling}"


def outside_sentence(results: Results) -> str:
    """How far vehicles left the hull of their starts, in a study without a navigator."""
    ways: Any = pd.Series(results.cells["outside_max"].to_numpy(dtype=float)).dropna()
    left, whom = ways[ways >= ROUNDING_ERROR], "vehicle that is not attacked"
    if ways.empty:
        return ""
    if left.empty:
        return f"No {whom} left the convex hull of their starts, in any lane."
    where = where_words(results, ways.index[ways == ways.max()].tolist())
    longest = max(cell.scenario.horizon for cell in results.study.cells)
    return (
        f"{' '.join(filter(None, ['In some lane', where]))} a {whom} was"
        f" <b>{error_text(ways.max())} m</b> outside the convex hull of their starts within the"
        f" {longest:g} s of the run. This is no limit: a longer run may take it farther."
        f"{hull_words(results)}"
    )


def hull_words(results: Results) -> str:
    """The shares of lanes in the hull: without an attack, and with one."""
    shares = 100 * stored_values(results.cells.reset_index(drop=True), share_names("in_hull"))
    shares, attacked = shares.dropna(subset="value"), attacked_mask(results.study.cells)
    words = []
    for is_attacked, when in ((False, "without attack"), (True, "with an attack")):
        some: Any = shares[attacked[shares.index] == is_attacked]
        what = "it" if words else "the share of lanes in which all these vehicles stay inside"
        if len(some):
            words.append(f"{when} {what} {span_words(results, some, percent_text, ' %')}")
    return f" {sentence_case('; '.join(words))}." if words else ""


def kinds_words(results: Results, estimates: pd.DataFrame, unit: str) -> str:
    """Sentences that compare the values of each swept kind; "" if none has two."""
    values: Any = estimates["value"]
    labels = [results.study.cells[n].labels for n in values.index]
    swept = pd.DataFrame(labels, values.index, list(results.study.cells[0].labels)).map(str)
    kinds = [str(key) for key in swept if is_kind(key) and len({*swept[key]}) > 1]
    sentences = (compared_words(results, key, values, swept, unit) for key in kinds)
    return "".join(f" {each}." for each in sentences if each)


def compared_words(
    results: Results, key: str, values: pd.Series, swept: pd.DataFrame, unit: str
) -> str:
    """The range of each value of a swept kind, and which values are found better than which."""
    of_labels: Any = {label: values[swept[key] == label] for label in dict.fromkeys(swept[key])}
    parts: dict[str, str] = {}
    for label, some in sorted(of_labels.items(), key=lambda each: each[1].mean()):
        ends = dict.fromkeys(map(error_text, (some.min(), some.max())))
        parts[str(label)] = f"<b>{' to '.join(ends)} {unit}</b>"
    tested, texts = tested_words(results, key, [*parts], swept, unit), [*parts.values()]
    if len({*texts}) == 1:
        tested = f": {tested}" * bool(tested)
        return f"It is {texts[0]} whatever the {escape(key_name(key))}{tested}"
    if len(parts) == 2 and not any(
        " to " in told for told in texts
    ):  # the sentence before has them
        return sentence_case(tested)
    names = (escape(value_name(key, label)) for label in parts)
    told = [f"{told} with {name}" for told, name in zip(texts, names, strict=True)][:MOST_COMPARED]
    told += [count(len(parts) - len(told), "other")] * (len(parts) > len(told))
    tested = f". {sentence_case(tested)}" * bool(tested)
    return f"By {escape(key_name(key))} it is {', '.join(told)}{tested}"


def tested_words(
    results: Results, key: str, labels: Sequence[str], swept: pd.DataFrame, unit: str
) -> str:
    """Which values of a swept kind are better than which, in which settings, with p.

    `labels` are the values, the best first. A setting is a combination of the other swept keys.
    Lanes of a setting are compared in pairs of the same draw. All pairs of up to three values are
    told, of more those with the first. There is no test of lanes that are not independent, and of a
    number of lanes that depends on them.
    """
    study, column = results.study.config, list(swept).index(key)
    label_of = {cell: str(swept.iat[at, column]) for at, cell in enumerate(swept.index.tolist())}
    others, groups = swept.drop(columns=key), dict[Any, list[int]]()
    for cell, rest in zip(swept.index.tolist(), others.to_numpy().tolist(), strict=True):
        groups.setdefault(tuple(rest), []).append(cell)
    settings = [cells for cells in groups.values() if len(cells) > 1]
    if study.draws != "random" or isinstance(study.samples, Sequential) or not settings:
        return ""
    tests = compared_cells(judged_lanes(results, swept.index, unit), settings)
    of_pairs: dict[tuple[str, str], list[CellsCompared]] = {}
    for test in tests:
        pair = sorted((label_of[test.better], label_of[test.worse]), key=labels.index)
        of_pairs.setdefault((pair[0], pair[1]), []).append(test)
    every = len(labels) <= MOST_TOLD
    pairs = [pair for pair in itertools.combinations(labels, 2) if pair in of_pairs]
    pairs = [pair for pair in pairs if every or pair[0] == labels[0]][:MOST_COMPARED]
    more = "lanes more often have the smaller spread" if is_leaderless(results.study.cells) else ""
    more = more or "lanes more often have the smaller error"
    if unit == "%":
        more = f"more lanes {'agree' if is_leaderless(results.study.cells) else 'recover'}"
    told = []
    for pair in pairs:
        names = [escape(value_name(key, each)) for each in pair]
        for good, bad in ((0, 1), (1, 0)):
            some = [t for t in of_pairs[pair] if t.found and label_of[t.better] == pair[good]]
            words = f"{more} with {names[good]} than with {names[bad]}"
            told += settings_told(results, words, some, of_pairs[pair], others)
        some = [test for test in of_pairs[pair] if not test.found]
        words = f"no difference is found between {names[0]} and {names[1]}"
        told += settings_told(results, words, some, of_pairs[pair], others)
    name = "McNemar's exact test" if unit == "%" else "the sign test"
    holm = sum(test.can_tell for test in tests)
    adjusted = f", adjusted by Holm for {count(holm, 'test')}" * (holm > 1)
    return f"{'; '.join(told)}. P values are of {name} on paired lanes{adjusted}"


def settings_told(
    results: Results,
    words: str,
    some: Sequence[CellsCompared],
    every: Sequence[CellsCompared],
    others: pd.DataFrame,
) -> list[str]:
    """The words with the settings of some tests, their p and number of lanes; [] of none."""
    if not some:
        return []
    ends = [min(test.p for test in some), max(test.p for test in some)]
    sign = "=" if f"{ends[0]:.2g}" == f"{ends[1]:.2g}" else "≤" if some[0].found else "≥"
    p = f"p {sign} {ends[sign == '≤']:.2g}"
    lanes = count_between([test.lanes for test in some], "pair")
    cells = results.study.cells
    names = [name for name in others if len({*others[name]}) > 1]
    where = f" in {len(some)} of {len(every)} settings of the other keys"
    if len(every) == 1:
        where = ""
    elif len(names) == 1:
        key = str(names[0])
        values = (value_name(key, cells[test.better].labels[key]) for test in sorted(some))
        where = f" {'with' if is_kind(key) else 'at'} {' or '.join(map(escape, values))}"
        if len(some) == len(every):
            where = f" at every {'ā' if key == MAGNITUDE else escape(key_name(key))}"
    elif len(some) == len(every):
        where = f" in all {len(every)} settings of the other keys"
    return [f"{words}{where} ({p}, {lanes}{' each' * (len(some) > 1)})"]


def judged_lanes(results: Results, numbers: pd.Index, unit: str) -> dict[int, pd.Series]:
    """Errors of lanes that ended, by sample, or with "%" whether they are over the threshold."""
    found, cells = {}, results.study.cells
    metric, sizes = judged_metric(cells), curves.cell_magnitudes(results)
    for cell, lanes in results.by_cell("sample", metric, where=rows.OK, cells={*numbers}):
        errors: Any = lanes.set_index("sample")[metric]
        if unit == "%":
            found[cell] = errors > threshold(cells[cell], results.study.config.recovery)
        else:
            errors = errors / (sizes[cell] if unit == "ā" else 1.0)
            found[cell] = errors.where(errors.abs() >= ROUNDING_ERROR, 0.0)
    return found


def compares_shares(results: Results) -> bool:
    """Whether kinds are compared by the share unrecovered, not by the error."""
    shares = {*curves.unrecovered_shares(results)["unrecovered"]}
    return results.study.config.recovery is not None and len(shares) > 1


def percent_text(share: float) -> str:
    return number_text(share, whole=100.0)


def share_words(results: Results) -> str:
    """The share of lanes that did not recover, as the subject of a sentence."""
    ended = "did not agree" if is_leaderless(results.study.cells) else "did not recover"
    return f"The share of lanes that {ended}"


def unrecovered_sentence(results: Results) -> str:
    """The least and the greatest share of lanes unrecovered, if the study asks for it."""
    found: Any = curves.unrecovered_shares(results)
    asked = results.study.config.recovery
    cells, confidence = results.study.cells, confidence_told(results.study.config.samples)
    if asked is None and found.empty:
        return ""
    if found.empty:
        return f"No share {share_name(cells)}: no attacked lane came to its end."
    known = 100 * found.astype(float).set_axis(VALUE_COLUMNS, axis="columns")
    share, falling = settled(results, known)
    compared = kinds_words(results, share, "%") if compares_shares(results) else ""
    above = "" if asked is None else f" ({criterion_words(asked, cells)})"
    span = span_words(results, share, percent_text, " %", confidence)
    return f"{share_words(results)}{above} {span}.{compared}{falling}"


def metric_sentences(results: Results) -> list[str]:
    """The least and the greatest median of each metric of the study's own, and of alarms."""
    own = (each.name for each in results.study.config.measured()[len(CONTRACT) :])
    asked = [name for name in own if name not in AGREEMENT]
    found = [quantity_of(results, results.study.cells, name) for name in asked]

    def told(of: Quantity) -> str:
        values: Any = of.values.dropna(subset="value")
        unit, scale = f" {of.unit}".rstrip(), float(of.unit == "m")
        number = functools.partial(error_text, scale=scale)
        span = span_words(results, values, number, unit, of.confidence)
        endless = len(of.values) - len(values)
        apart = f" {sentence_case(count(endless, 'cell'))} has no such median." * (endless == 1)
        apart = apart or f" {endless} cells have no such median." * (endless > 1)
        stem = escape(sentence_case(of.words.removesuffix(MEDIAN_WORDS)))
        return f"{stem}: the median over lanes {span}.{apart}"

    return [told(each) for each in found if each.known.size]


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
    span = span_words(results, found, error_text, unit)
    lanes = count(int(rows[worst.SEARCH_LANES].max()), "lane")
    return (
        f"By search the {escape(worst.metric_words(results))} {span}, in {lanes} of a cell at most;"
        f" as many random lanes reach {error_text(random)}{unit}."
    )


def bounds_sentence(results: Results, found: Sequence[curves.Curve], fit: str) -> str:
    """The least ratio of a bound to the worst error found."""
    if not found:
        none = "none to compare with, for no cell has an attack of a fixed magnitude"
        return f"Bounds of theory: {none}."
    if not results.file("bounds.csv").exists():
        return f"Bounds are not fitted yet: <code>{fit}</code>"
    lasting = [curve for curve in found if curve.worst >= ROUNDING_ERROR]
    tightest = []
    for curve in lasting:
        limits = curve.limits("tail_max")
        sound = [(slope, name) for name, slope in limits.items() if name != UNSOUND_BOUND]
        if sound:
            slope, name = min(sound, key=lambda each: each[0])
            tightest.append((slope / curve.worst, name, slope, curve))
    none = [curve for ratio, *_, curve in tightest if ratio == 0]
    tightest = [each for each in tightest if each[0] > 0]
    words = []
    if tightest:
        ratio, name, slope, curve = min(tightest, key=lambda each: each[0])
        where = f" with {escape(labels_title(curve.group.labels))}" if curve.group.labels else ""
        after = "; the bound holds once the transient is over" if ratio < 1 else ""
        words.append(
            f"The tightest bound of theory, {curves.BOUND_NAMES[name]}, is"
            f" <b>{number_text(ratio)} times</b> the worst error found: {number_text(slope)} ā"
            f" against {number_text(curve.worst)} ā{where}{after}."
        )
    if of_rounding := sum(curve.worst < ROUNDING_ERROR for curve in found):
        words.append(f"In {count(of_rounding, 'group')} of cells the worst error is 0 (rounding).")
    if none:
        worst = number_text(max(curve.worst for curve in none))
        where = f"in {count(len(none), 'group')} of cells"
        if len(none) == 1 and none[0].group.labels:
            where = f"with {escape(labels_title(none[0].group.labels))}"
        words.append(f"By theory no error lasts {where}; the worst found there is {worst} ā.")
    if silent := len(lasting) - len(tightest) - len(none):
        groups = f" to {silent} of {count(len(found), 'group')} of cells"
        words.append(f"No bound of theory applies{groups * (silent < len(found))}.")
    if (tightest or of_rounding) and results.file("violations.csv").exists():
        many = len(results.violations[["cell", "sample"]].drop_duplicates())
        told = f'<b>{count(many, "lane")}</b> above its bound: see <a href="#violations">below</a>.'
        words.append(told if many else "No lane is above its bound.")
        if unchecked := unchecked_words(results.study.cells):
            words.append(f"No bound is known for {escape(unchecked)}.")
    return " ".join(words)
