"""Findings about a results folder, in sentences."""

import functools
import itertools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import Cell, is_leaderless, judged_metric
from jaxnet.config.keys import Sequential
from jaxnet.config.naming import NO_BREAK, is_kind, key_name, labels_title, value_alone, value_name
from jaxnet.kinds.kind import vehicle_numbers
from jaxnet.kinds.metrics import AGREEMENT, CONTRACT, DETECTION, LANE_STATISTICS, Metric
from jaxnet.kinds.metrics.min_separation import MIN_SEPARATION
from jaxnet.model.wording import cells_named, count, count_between, counted, number_text, ranges
from jaxnet.statistics import curves
from jaxnet.statistics.amplitude import ROUNDING_ERROR
from jaxnet.statistics.falling import falling_words
from jaxnet.statistics.groups import swept_values_of
from jaxnet.statistics.horizon import errors_words
from jaxnet.statistics.intervals import CONFIDENCE
from jaxnet.statistics.limits import unchecked_words
from jaxnet.statistics.nominal import misfit_words
from jaxnet.statistics.pairs import CellsCompared, compared_cells
from jaxnet.statistics.quantities import VALUE_COLUMNS, meaning, stored_values
from jaxnet.statistics.recovery import (
    attacked_mask,
    confidence_told,
    criterion_words,
    share_name,
    threshold,
)
from jaxnet.statistics.separation import near_starts_words
from jaxnet.statistics.summary import share_names
from jaxnet.store import rows
from jaxnet.store.results import Results
from jaxnet.view.drawings.words import ROUNDED, error_text
from jaxnet.view.page.elements import Section, notes_html, sentence_case, sortable_table
from jaxnet.view.text import worst
from jaxnet.view.text.facts import attacked_at_once

UNSOUND_BOUND = "lyapunov_printed"  # false in general (theorems.md O5), so no bound to be tight
MEDIAN_LANE = {  # by `judged_word`
    "error": "In the median lane of a cell the error, a mean over vehicles and the tail{},",
    "spread": "In the median lane of a cell the greatest spread over the tail{}",
}
BASELINE = " without an attack"
MOVED = 10  # times as far as without an attack
NEGLIGIBLE = 1e-3  # of the greatest value
TestRows = list[dict[str, Any]]  # of the table of p values
NO_DIFFERENCE = "no difference by"
MOST_TESTS = 200  # in the table of p values
MOST_COMPARED, MOST_TOLD = 8, 3  # values of a swept key in one sentence, and of a few cells


def findings_section(results: Results, found: Sequence[curves.Curve], fit: str) -> Section:
    tests = TestRows()
    sentences = finding_sentences(results, found, fit, tests)
    told = [each.replace(" %", f"{NO_BREAK}%") for each in sentences]
    folded = ""
    if tests:
        table = pd.DataFrame(sorted(tests, key=lambda each: each["p"])[:MOST_TESTS])
        what = f"p values of {count(len(tests), 'comparison')}"
        body = sortable_table(table) + notes_html([p_words(results)])
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
    lanes, alone = results.manifest["lanes"], is_leaderless(cells)
    warnings = [falling_words(results, cells), errors_words(results.study.config, cells)]
    warnings += misfit_words(results, cells)
    failed = ""
    if lanes["failed"]:
        there = curves.failed_kinds(results)
        kinds = escape(counted(sum(there.values(), Counter())))
        failed = f"<b>{count(lanes['failed'], 'lane')} of {lanes['total']:,} failed</b>: {kinds}"
        failed += f", {where_words(results, sorted(there))}".rstrip(", ") + "."
    separated = separation_sentence(results, tests)
    sentences = [
        outnumbered_sentence(results),
        outside_sentence(results) if alone else "",
        *(f"<b>{sentence_case(each)}</b>." for each in warnings if each),
        unrecovered_sentence(results, tests),
        extremes_sentence(results, tests),
        separated,
        metrics_list(results, MIN_SEPARATION.name * bool(separated)),
        search_sentence(results),
        failed,
        "" if alone else bounds_sentence(results, found, fit),
    ]
    return [each for each in sentences if each]


def outnumbered_sentence(results: Results) -> str:
    """Where vehicles hear more attacked sources than their defence is set for."""
    found: dict[str, list[int]] = {}
    most = 0
    for cell in results.study.cells:
        graph, attacked, trusted = attacked_at_once(cell.scenario)
        which = cell.scenario.defence.outnumbered(graph, attacked, trusted)
        if which.any():
            found.setdefault(ranges(vehicle_numbers(which)), []).append(cell.number)
            most = max(most, int(attacked[which].sum(axis=1).max()))
    if not found:
        return ""
    whom = (
        f"{'vehicle' if who.isdigit() else 'vehicles'} {who} {where_words(results, cells)}".rstrip()
        for who, cells in found.items()
    )
    return (
        f"<b>Outside the assumptions of the defence: {'; '.join(whom)}, with up to"
        f" {count(most, 'attacked source')} each, more than the defence can drop</b>."
    )


def errors_per_size(results: Results) -> tuple[pd.DataFrame, str]:
    """Median errors of cells with intervals, and their unit: per ā, or in metres without ā."""
    metric = judged_metric(results.study.cells)
    names = [f"{metric}_{name}" for name in LANE_STATISTICS["median"].columns]
    errors = stored_values(results.cells.reset_index(drop=True), names)
    known = curves.cell_magnitudes(results)
    per_size = metric != "spread" and not np.isnan(known).all()
    found: Any = errors.div(known, axis="index") if per_size else errors
    return found.dropna(subset="value"), "ā" if per_size else "m"


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


def where_words(results: Results, numbers: Sequence[int], among: Sequence[int] = ()) -> str:
    """The swept values that some of the cells `among` have alone; else the number of cells."""
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
    words, alike = values_told(results, numbers, cells)
    if not words:
        return f"in {cells_named(numbers)}"
    if alike > many:
        return f"in {many} of {alike} cells with {words}"
    return f"with {words} ({many} cells)"


def values_told(results: Results, numbers: Sequence[int], among: Sequence[Cell]) -> tuple[str, int]:
    """The few swept values that these of the cells `among` have, and how many cells have them."""
    mine, there = (
        swept_values_of(each) for each in ([results.study.cells[n] for n in numbers], among)
    )
    alike = sum(all(cell.labels[key] in mine[key] for key in mine) for cell in among)
    told = {key: values for key, values in mine.items() if len(values) < len(there[key])}
    if max(map(len, told.values()), default=0) > MOST_TOLD:
        return "", alike
    words = (" or ".join(value_name(key, each) for each in told[key]) for key in told)
    return escape(", ".join(words)), alike


def span_words(
    results: Results,
    values: pd.DataFrame,
    told: Callable[[float], str],
    unit: str,
    among: Sequence[int],
    sure: float = CONFIDENCE,
) -> str:
    """The least and the greatest value, each with its interval and cells; one if they read alike.

    `values` have the columns value, low and high; `told` is the text of a number. Where the least
    are negligible beside the greatest, one number above them stands for them.
    """
    texts: Any = values["value"].map(told)

    def part(place: Any) -> str:
        alike: Any = values[texts == texts[place]]
        ends = [dict.fromkeys(map(told, alike[end].dropna())) for end in ("low", "high")]
        interval = ""
        if all(ends) and {*ends[0], *ends[1]} != {texts[place]}:
            within = "s within" * (max(map(len, ends)) > 1)
            low, high = told(alike["low"].min()), told(alike["high"].max())
            interval = f" ({100 * sure:g} % interval{within} {low} to {high}{unit})"
        where = where_words(results, alike.index.tolist(), among)
        return f"<b>{texts[place]}{unit}</b>{interval} {where}".rstrip()

    least, most = values["value"].idxmin(), values["value"].idxmax()
    if texts[least] == texts[most]:
        return f"is {part(most)}"
    above: Any = values["high"].fillna(values["value"])
    small: Any = above[above < NEGLIGIBLE * values["value"].max()]
    if small.empty or unit.strip() not in ("m", "ā"):
        return f"ranges from {part(least)} to {part(most)}"
    where = where_words(results, small.index.tolist(), among)
    return (
        f"is at most <b>{above_text(float(small.max()))}{unit}</b> {where}, and up to {part(most)}"
    )


def above_text(value: float) -> str:
    """A number of one digit that is not below a value, nor below rounding."""
    least = max(float(value), ROUNDING_ERROR)
    digit = 10.0 ** np.floor(np.log10(least))
    return number_text(digit * np.ceil(round(least / digit, 9)))


def judged_word(results: Results) -> str:
    """The word for what lanes are judged by."""
    return "spread" if is_leaderless(results.study.cells) else "error"


def extremes_sentence(results: Results, tests: TestRows) -> str:
    """The cells with the least and the greatest error of the median lane."""
    errors, unit = errors_per_size(results)
    word, per_size = judged_word(results), unit == "ā"
    if errors.empty:
        none = f"No lane came to its end, so no {word} is known."
        return "No attacked lane came to its end." if results.manifest["lanes"]["ok"] else none
    asked = (
        int(np.sum(curves.cell_magnitudes(results) > 0)) if per_size else len(results.study.cells)
    )
    left = count(asked - len(errors), "attacked cell" if per_size else "cell")
    without = f" No lane ended in {left}." if len(errors) < asked else ""
    among = errors.index.tolist()
    errors, falling = settled(results, errors, error_text, f" {unit}")
    compared = "" if compares_shares(results) else kinds_words(results, errors, unit, tests)
    span = span_words(results, errors, error_text, f" {unit}", among)
    formed = any(cell.scenario.formation.present for cell in results.study.cells)
    less = ", less the offsets of the formation" * formed
    limits = [threshold(cell, results.study.config.recovery) for cell in results.study.cells]
    least = np.fmin.reduce(limits, initial=np.inf)
    if not per_size and errors["value"].max() < NEGLIGIBLE * least < np.inf:
        most = above_text(float(errors["value"].to_numpy().max()))
        span, compared = f"is at most <b>{most} m</b>", ""
    return f"{MEDIAN_LANE[word].format(less)} {span}.{compared}{without}{falling}"


def outside_sentence(results: Results) -> str:
    """How far liars move honest vehicles out of the hull of their starts, without a navigator."""
    cells, attacked = results.study.cells, attacked_mask(results.study.cells)
    names = ["outside_median", "outside_max", *share_names("in_hull")]
    ways: Any = results.cells.reindex(columns=names).reset_index(drop=True)
    ways = ways.dropna(subset=names[:2])
    if ways.empty:
        return ""
    if ways["outside_max"].max() < ROUNDING_ERROR:
        return "No honest vehicle left the convex hull of the honest starts, in any lane."
    groups: dict[str, list[int]] = {}
    for place in sorted(ways.index, key=lambda place: not attacked[place]):
        label = cells[place].labels.get("defence")
        when = "" if label is None else f" with {escape(value_name('defence', label))}"
        groups.setdefault(when if attacked[place] else BASELINE, []).append(place)
    # Without an attack to compare with, nobody knows who moved them
    usual = ways["outside_median"][groups[BASELINE]].max() if BASELINE in groups else np.inf
    moved = [
        place
        for place in ways.index[attacked[ways.index]]
        if ways["outside_median"][place] > max(MOVED * usual, cells[place].scenario.engine.accuracy)
    ]
    shares: Any = curves.unrecovered_shares(results)["unrecovered"].reindex(moved)
    words = "Honest vehicles leave the convex hull of their starts"
    if moved:
        words = "Liars move honest vehicles out of the convex hull of their starts"
        if (shares < 0.5).all():
            words = "Honest vehicles agree, but on a place that liars move out of the hull"
        words = f"<b>{words}</b>"

    def told(when: str, each: list[int]) -> str:
        left: Any = ways.loc[each].sort_values("in_hull").iloc[0]
        share, high, low = (percent_text(100 * (1 - left[name])) for name in names[2:])
        most: Any = ways.loc[each].max()
        median, worst = (error_text(most[name], np.nan) for name in names[:2])
        if np.isnan(left["in_hull"]):
            return f"by {median} m in the median lane{when}, {worst} m in the worst"
        out = f"in {share} % of lanes{when} (95 % interval {low} to {high} %)"
        half = f"{median} m in the median lane and " * (median != ROUNDED)
        return f"{out}, by {half}{worst} m in the worst"

    longest = max(cell.scenario.horizon for cell in cells)
    return (
        f"{words} within {longest:g} s, and may go farther in a longer run. In the worst cells they"
        f" leave the hull {'; '.join(told(*each) for each in groups.items())}."
    )


def kinds_words(results: Results, estimates: pd.DataFrame, unit: str, tests: TestRows) -> str:
    """Sentences that compare the values of each swept kind; "" if none has two."""
    values: Any = estimates["value"]
    labels = [results.study.cells[n].labels for n in values.index]
    swept = pd.DataFrame(labels, values.index, list(results.study.cells[0].labels)).map(str)
    kinds = [
        str(key)
        for key in swept
        if len({*swept[key]}) > 1 and (is_kind(key) or all(isinstance(v[key], str) for v in labels))
    ]
    kinds = [key for key in kinds if key != "filter"]  # compared by `separation_sentence`
    found = [compared_words(results, key, values, swept, unit, tests) for key in kinds]
    return "".join(f" {sentence_case(each)}." for each in found if each)


def compared_words(
    results: Results,
    key: str,
    values: pd.Series,
    swept: pd.DataFrame,
    unit: str,
    tests: TestRows,
) -> str:
    """The range of each value of a swept kind, and which values are found better than which."""
    of_labels: Any = {label: values[swept[key] == label] for label in dict.fromkeys(swept[key])}
    parts: dict[str, str] = {}
    number = percent_text if unit == "%" else error_text
    for label, some in sorted(of_labels.items(), key=lambda each: each[1].mean()):
        ends = dict.fromkeys(map(number, (some.min(), some.max())))
        parts[str(label)] = f"<b>{' to '.join(ends)} {unit}</b>"
    lanes, word = judged_lanes(results, swept.index, unit), judged_word(results)
    subject, more = word, f"lanes more often have the smaller {word}"
    if unit == "%":
        subject, more = "share", f"more lanes {'agree' if word == 'spread' else 'recover'}"
    tested = tested_words(results, key, [*parts], swept, lanes, more, tests)
    texts, none = [*parts.values()], tested.startswith(NO_DIFFERENCE)
    if len({*texts}) == 1:
        if " to " in texts[0]:
            return "" if none else tested
        tested = f": {tested}" * (bool(tested) and not none)
        return f"the {subject} is {texts[0]} whatever the {escape(key_name(key))}{tested}"
    if unit != "%" and len(parts) == 2 and " to " not in "".join(texts):  # told in the span
        return tested
    names = (named(key, label) for label in parts)
    told = [f"{told} with {name}" for told, name in zip(texts, names, strict=True)][:MOST_COMPARED]
    told += [count(len(parts) - len(told), "other")] * (len(parts) > len(told))
    tested = f". {sentence_case(tested)}" * bool(tested)
    return f"by {escape(key_name(key))} the {subject} is {', '.join(told)}{tested}"


def named(key: str, label: str) -> str:
    """The value of a kind, or of another key that the sentence has named."""
    return escape(value_name(key, label) if is_kind(key) else value_alone(key, label))


def tested_words(
    results: Results,
    key: str,
    labels: Sequence[str],
    swept: pd.DataFrame,
    lanes: Mapping[int, pd.Series],
    more: str,
    rows: TestRows,
) -> str:
    """Which values of a swept kind are better than which, in which settings; `rows` get each p.

    `labels` are the values, the best first. `lanes` are numbers of each cell's lanes, the less the
    better; `more` says what lanes with smaller numbers do. A setting is a combination of the other
    swept keys. Lanes of a setting are compared in pairs of the same draw. Only found differences
    are told: of up to eight pairs all, of more those with the first value. There is no test of
    lanes that are not independent, and of a number of lanes that depends on them.
    """
    study, column = results.study.config, list(swept).index(key)
    label_of = {cell: str(swept.iat[at, column]) for at, cell in enumerate(swept.index.tolist())}
    others, groups = swept.drop(columns=key), dict[Any, list[int]]()
    for cell, rest in zip(swept.index.tolist(), others.to_numpy().tolist(), strict=True):
        groups.setdefault(tuple(rest), []).append(cell)
    settings = [cells for cells in groups.values() if len(cells) > 1]
    if study.draws != "random" or isinstance(study.samples, Sequential) or not settings:
        return ""
    tests = compared_cells(lanes, settings)
    of_pairs: dict[tuple[str, str], list[CellsCompared]] = {}
    for test in tests:
        pair = sorted((label_of[test.better], label_of[test.worse]), key=labels.index)
        of_pairs.setdefault((pair[0], pair[1]), []).append(test)
        ends = (value_name(key, label_of[cell]) for cell in (test.better, test.worse))
        mine = results.study.cells[test.better].labels
        setting = labels_title({name: mine[name] for name in others if len({*others[name]}) > 1})
        names = "compared", "better", "worse", "setting", "pairs", "p"
        told_of = key_name(key), *ends, setting, test.lanes, test.p
        rows.append(dict(zip(names, told_of, strict=True)))
    pairs = [pair for pair in itertools.combinations(labels, 2) if pair in of_pairs]
    if len(pairs) > MOST_COMPARED:
        pairs = [pair for pair in pairs if pair[0] == labels[0]][:MOST_COMPARED]
    told = []
    for pair in pairs:
        names = [named(key, each) for each in pair]
        for good, bad in ((0, 1), (1, 0)):
            some = [t for t in of_pairs[pair] if t.found and label_of[t.better] == pair[good]]
            words = f"{more} with {names[good]} than with {names[bad]}"
            told += settings_told(results, words, some, of_pairs[pair], others)
    many = f"with {count_between([test.lanes for test in tests], 'pair')} in a setting"
    none = f"{NO_DIFFERENCE} {escape(key_name(key))} is found {many}; a small one would not show"
    return "; ".join(told) or none


def p_words(results: Results) -> str:
    """What the p values of findings are."""
    name = "McNemar's exact test" if compares_shares(results) else "the exact sign test"
    return (
        f"test: {name} on paired lanes, adjusted by Holm over the comparisons of a key in which"
        " enough lanes differ"
    )


def settings_told(
    results: Results,
    words: str,
    some: Sequence[CellsCompared],
    every: Sequence[CellsCompared],
    others: pd.DataFrame,
) -> list[str]:
    """The words with the settings of some tests; [] of none."""
    if not some:
        return []
    names = [name for name in others if len({*others[name]}) > 1]
    if len(some) == len(every):
        return [words + f" in all {len(every)} settings of the other keys" * (len(every) > 1)]
    mine, among = (
        sorted({cell for test in tests for cell in (test.better, test.worse)})
        for tests in (some, every)
    )
    where, alike = values_told(results, mine, [results.study.cells[n] for n in among])
    where = where if alike == len(mine) else ""
    if not where and len(some) <= MOST_TOLD:
        labels = (results.study.cells[test.better].labels for test in sorted(some))
        told = (escape(labels_title({key: each[key] for key in names})) for each in labels)
        where = "; ".join(told)
    told_of = f"in {len(some)} of {len(every)} settings of the other keys"
    return [f"{words} {f'({where})' if where else told_of}"]


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


def unrecovered_sentence(results: Results, tests: TestRows) -> str:
    """The least and the greatest share of lanes unrecovered, if the study asks for it."""
    found: Any = curves.unrecovered_shares(results)
    asked = results.study.config.recovery
    cells, confidence = results.study.cells, confidence_told(results.study.config.samples)
    if asked is None and found.empty:
        return ""
    if found.empty:
        return f"No share {share_name(cells)}: no attacked lane came to its end."
    known = 100 * found.astype(float).set_axis(VALUE_COLUMNS, axis="columns")
    share, falling = settled(results, known, percent_text, " %")
    compared = kinds_words(results, share, "%", tests) if compares_shares(results) else ""
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
        more = "lanes more often keep the greater least distance"
        found.append(tested_words(results, "filter", [*told], swept, lanes, more, tests))
    found += dict.fromkeys(near_starts_words(results.study.config, cell.scenario) for cell in cells)
    return " ".join(f"{sentence_case(each)}." for each in found if each)


def metrics_list(results: Results, without: str) -> str:
    """Medians, and the greatest lane, of each metric of the study's own but shares of alarms."""
    own = results.study.config.measured()[len(CONTRACT) :]
    asked = [each for each in own if each.name not in {*AGREEMENT, *DETECTION, without}]

    def told(metric: Metric) -> str:
        medians: Any = results.cells[f"{metric.name}_median"].dropna()
        values, unit = medians[np.isfinite(medians)], f" {metric.column_unit}".rstrip()
        if medians.empty:
            return ""
        if values.empty:
            return f"<li>{escape(meaning(metric))}: <b>infinite</b> in every cell</li>"
        number = functools.partial(error_text, scale=float(metric.column_unit == "m"))
        ends = dict.fromkeys(map(number, (values.min(), values.max())))
        endless = len(medians) - len(values)
        apart = f"; infinite in {count(endless, 'cell')}" * bool(endless)
        greatest = float(results.cells[f"{metric.name}_max"].to_numpy().max())
        least = metric.time == "min" or not np.isfinite(greatest)
        most = "" if least else f", greatest lane {number(greatest)}{unit}"
        return f"<li>{escape(meaning(metric))}: <b>{' to '.join(ends)}{unit}</b>{most}{apart}</li>"

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
        return f"Bounds are not fitted yet: <code>{fit}</code>"
    bounded = [curve for curve in found if sound_limits(curve)]
    beside = "; ".join(map(bound_words, bounded))
    if len(bounded) > MOST_TOLD:
        shares = [100 * curve.worst / sound_limits(curve)[0][0] for curve in bounded]
        ends = f"{number_text(min(shares))} to {number_text(max(shares))} %"
        beside = f"<b>{ends}</b> of its least bound in {len(bounded)} groups of cells (table below)"
    words = [f"The worst error of a vehicle is {beside}."] * bool(bounded)
    if bounded and results.file("violations.csv").exists():
        many = len(results.violations[["cell", "sample"]].drop_duplicates())
        above = f'<b>{count(many, "lane")}</b> above a bound: see <a href="#violations">below</a>.'
        words.append(above if many else "No lane is above its bound.")
    if unchecked := unchecked_words(results.study.cells):
        words.append(f"No bound is known for {escape(unchecked)}.")
    return " ".join(words)


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
