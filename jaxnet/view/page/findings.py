"""Findings about a results folder, in sentences."""

from collections import Counter
from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import is_leaderless, judged_metric
from jaxnet.config.keys import Sequential
from jaxnet.config.naming import NO_BREAK, is_kind, key_name, labels_title, value_name
from jaxnet.kinds.metrics import AGREEMENT, CONTRACT
from jaxnet.model.wording import cells_named, count, count_between, counted, number_text
from jaxnet.statistics import curves
from jaxnet.statistics.falling import falling_words
from jaxnet.statistics.groups import swept_values_of
from jaxnet.statistics.limits import unchecked_words
from jaxnet.statistics.pairs import worse_cells
from jaxnet.statistics.quantities import Quantity, quantity_of
from jaxnet.statistics.recovery import confidence_told, criterion_words, share_name, threshold
from jaxnet.statistics.summary import LANE_STATISTICS
from jaxnet.store import rows
from jaxnet.store.results import Results
from jaxnet.view.columns import ROUNDING_ERROR
from jaxnet.view.drawings.words import error_text
from jaxnet.view.page.elements import Section, sentence_case
from jaxnet.view.text import worst

UNSOUND_BOUND = "lyapunov_printed"  # false in general (theorems.md O5), so no bound to be tight
MEDIAN_WORDS = f", {LANE_STATISTICS['median'].words}"
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
        failed += f", {where_words(results, sorted(there))}."
    sentences = [
        f"<b>{sentence_case(falling)}</b>." if falling else "",
        unrecovered_sentence(results),
        extremes_sentence(results),
        outside_sentence(results) if alone else "",
        *metric_sentences(results),
        search_sentence(results),
        failed,
        "" if alone else bounds_sentence(results, found, fit),
        certainty_sentence(results),
    ]
    return [each for each in sentences if each]


def errors_per_size(results: Results) -> tuple[pd.Series, str]:
    """Mean tail errors by cell and unit: per ā, or in metres without ā; spreads if leaderless."""
    metric = judged_metric(results.study.cells)
    errors: Any = pd.Series(results.cells[f"{metric}_mean"].to_numpy(dtype=float))
    known = curves.cell_magnitudes(results)
    if np.isnan(known).all() or metric == "spread":
        return errors.dropna(), "m"
    return (errors / known).dropna(), "ā"


def settled(results: Results, values: pd.Series) -> tuple[pd.Series, str]:
    """The values of cells whose errors do not fall any more, if there are any, and a sentence."""
    falls: Any = results.cells.reindex(columns=["falling"])["falling"]
    left: Any = values[falls[values.index] != 1]
    if left.empty or len(left) == len(values):
        return values, ""
    named = cells_named(sorted({*values.index} - {*left.index}))
    return left, f" Left out: {named}, whose {judged_word(results)} still falls."


def where_words(results: Results, numbers: Sequence[int]) -> str:
    """The swept values that cells have, and no other cells; else those of the first cell."""
    cells = results.study.cells
    labels, many = cells[numbers[0]].labels, len(numbers)
    if not labels:
        return "over all lanes"
    if many == len(cells):
        return "in every cell"
    first = f"{escape(labels_title(labels))} (cell {numbers[0]})"
    if many == 1:
        return f"with {first}"
    mine, there = swept_values_of([cells[n] for n in numbers]), swept_values_of(cells)
    alike = [cell for cell in cells if all(cell.labels[key] in mine[key] for key in mine)]
    told = {key: values for key, values in mine.items() if len(values) < len(there[key])}
    if len(alike) > many or max(map(len, told.values())) > MOST_TOLD:
        return f"in {many} cells, such as {first}"
    words = (" or ".join(value_name(key, each) for each in told[key]) for key in told)
    return f"with {escape(', '.join(words))} ({many} cells)"


def span_words(results: Results, values: pd.Series, words: Callable[[float, int], str]) -> str:
    """What a value is: the least and the greatest, each with its cells; one if they read alike."""
    ends = {}
    for end in (values.min(), values.max()):
        numbers = [int(cell) for cell in values.index[values == end]]
        ends.setdefault(words(end, numbers[0]), numbers)
    if len(ends) == 1:
        everywhere = [int(cell) for cell in values.index]
        ends = dict.fromkeys(ends, everywhere)
    told = [f"{words} {where_words(results, numbers)}" for words, numbers in ends.items()]
    return f"ranges from {' to '.join(told)}" if len(told) > 1 else f"is {told[0]}"


def judged_word(results: Results) -> str:
    """The word for what lanes are judged by."""
    return "spread" if is_leaderless(results.study.cells) else "error"


def extremes_sentence(results: Results) -> str:
    """The cells with the least and the greatest error."""
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
    if not per_size:
        errors = errors.where(errors.abs() >= ROUNDING_ERROR, ROUNDING_ERROR / 2)
    span = span_words(results, errors, lambda end, _: f"<b>{error_text(end)} {unit}</b>")
    offsets = any(cell.scenario.formation.present for cell in results.study.cells)
    less = ", less the offsets of the formation," * offsets
    return f"The mean {word} over the tail and over lanes{less} {span}.{compared}{without}{falling}"


def outside_sentence(results: Results) -> str:
    """How far vehicles left the hull of their starts, in a study without a navigator."""
    ways: Any = pd.Series(results.cells["outside_max"].to_numpy(dtype=float)).dropna()
    left, whom = ways[ways >= ROUNDING_ERROR], "vehicle that is not attacked"
    if ways.empty:
        return ""
    if left.empty:
        return f"No {whom} left the convex hull of their starts, in any lane."
    where = where_words(results, ways.index[ways == ways.max()].tolist())
    stayed = count(len(ways) - len(left), "cell")
    inside = f"; in {stayed} none left it" if len(left) < len(ways) else ""
    return (
        f"The greatest way of a {whom} out of the convex hull of their starts is"
        f" <b>{error_text(ways.max())} m</b> {where}{inside}."
    )


def kinds_words(results: Results, values: pd.Series, unit: str) -> str:
    """Sentences that compare the values of each swept kind; "" with fewer than three cells."""
    if len(values) < 3:  # whose two ends the sentence before has
        return ""
    labels = [results.study.cells[n].labels for n in values.index]
    swept = pd.DataFrame(labels, values.index, list(results.study.cells[0].labels)).map(str)
    kinds = [str(key) for key in swept if is_kind(key) and len({*swept[key]}) > 1]
    return "".join(f" {compared_words(results, key, values, swept, unit)}." for key in kinds)


def compared_words(
    results: Results, key: str, values: pd.Series, swept: pd.DataFrame, unit: str
) -> str:
    """The range of each value of a swept kind, and which values are not found worse."""
    parts: list[tuple[str, str]] = []
    of_labels: Any = [values[swept[key] == label] for label in dict.fromkeys(swept[key])]
    for some in sorted(of_labels, key=lambda some: some.mean()):
        label = swept[key][some.index[0]]
        ends = dict.fromkeys(map(error_text, (some.min(), some.max())))
        parts.append((f"<b>{' to '.join(ends)} {unit}</b>", escape(value_name(key, label))))
    if len({told for told, _ in parts}) == 1:
        return f"It is {parts[0][0]} whatever the {escape(key_name(key))}"
    told = [f"{told} with {name}" for told, name in parts[:MOST_COMPARED]]
    told += [count(len(parts) - len(told), "other")] * (len(parts) > len(told))
    tested = tested_words(results, key, swept, unit)
    return f"By {escape(key_name(key))} it is {', '.join(told)}{tested}"


def tested_words(results: Results, key: str, swept: pd.DataFrame, unit: str) -> str:
    """In how many settings each value of a swept kind is not found worse than another.

    A setting is a combination of the other swept keys. Lanes of a setting are compared in pairs of
    the same draw. Of attacks the most harmful one is the best. There is no test of lanes that are
    not independent, and of a number of lanes that depends on them.
    """
    study = results.study.config
    others, groups = swept.drop(columns=key), dict[Any, list[int]]()
    for cell, labels in zip(swept.index.tolist(), others.to_numpy().tolist(), strict=True):
        groups.setdefault(tuple(labels), []).append(cell)
    settings = [cells for cells in groups.values() if len(cells) > 1]
    if study.draws != "random" or isinstance(study.samples, Sequential) or not settings:
        return ""
    worse, tests = worse_cells(judged_lanes(results, swept.index, unit), settings)
    name = "McNemar's exact test" if unit == "%" else "sign test"
    test = f"{name} of paired lanes, at 5 % by Holm over {count(tests, 'comparison')}"
    if not worse:
        return "; no difference is found" + f" ({test})" * bool(tests)
    harms = key.startswith("attack")
    beaten = {pair[harms] for pair in worse}
    good = Counter(str(swept[key][n]) for cells in settings for n in cells if n not in beaten)
    best = [f"{escape(value_name(key, each))} in {n}" for each, n in good.most_common()]
    than = "less harmful" if harms else "worse"
    among = f" of {count(len(settings), 'setting')}{' of the other keys' * bool(others.size)}"
    return f"; not found {than} than another ({test}): {', '.join(best[:MOST_COMPARED])}{among}"


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
    """Whether kinds are compared by the share unrecovered, not by the mean error."""
    shares = {*curves.unrecovered_shares(results)["unrecovered"]}
    return results.study.config.recovery is not None and len(shares) > 1


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

    def words(share: float, cell: int) -> str:
        told, low, high = (number_text(100 * end, whole=100.0) for end in found.loc[cell])
        return f"<b>{told} %</b> ({100 * confidence:g} % interval {low} to {high} %)"

    share, falling = settled(results, found["unrecovered"].astype(float))
    compared = kinds_words(results, 100 * share, "%") if compares_shares(results) else ""
    above = "" if asked is None else f" ({criterion_words(asked, cells)})"
    return f"{share_words(results)}{above} {span_words(results, share, words)}.{compared}{falling}"


def metric_sentences(results: Results) -> list[str]:
    """The least and the greatest median of each metric of the study's own, and of alarms."""
    own = (each.name for each in results.study.config.measured()[len(CONTRACT) :])
    asked = [name for name in own if name not in AGREEMENT]
    found = [quantity_of(results, results.study.cells, name) for name in asked]

    def told(of: Quantity) -> str:
        values: Any = of.values["value"].dropna()
        unit, scale = f" {of.unit}".rstrip(), float(of.unit == "m")

        def words(end: float, cell: int) -> str:
            low, high = of.values.loc[cell, ["low", "high"]]
            ends = f"{error_text(low, scale)} to {error_text(high, scale)}{unit}"
            has_interval = np.isfinite(low + high) and low < high
            sure = f" ({100 * of.confidence:g} % interval {ends})" * bool(has_interval)
            return f"<b>{error_text(end, scale)}{unit}</b>{sure}"

        span = span_words(results, values, words)
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
    span = span_words(results, found, lambda end, _: f"<b>{error_text(end)}{unit}</b>")
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


def certainty_sentence(results: Results) -> str:
    """The number of lanes of a cell, and the interval of the greatest mean."""
    samples = f"Each cell has {count_between(results.samples, 'lane')}."
    metric = judged_metric(results.study.cells)
    # in metres: the greatest per ā is another
    means: Any = results.cells[f"{metric}_mean"].dropna()
    if means.empty:
        return samples
    place = int(means.idxmax())
    row: Any = results.cells.iloc[place]
    scale, ends = float(curves.cell_magnitudes(results)[place]), ("mean", "low", "high")
    mean, low, high = (error_text(float(row[f"{metric}_{end}"]), scale) for end in ends)
    known = metric != "spread" and not np.isnan(row["tail_mean_high"])
    if metric == "spread" or (len(means) == 1 and not known):  # the extremes tell it
        return samples
    sure = 100 * confidence_told(results.study.config.samples)
    interval = f" ({sure:g} % interval {low} to {high} m)" if known else ""
    where = f", in cell {place}" if len(means) > 1 else ""
    what = f"{'greatest ' * (len(means) > 1)}mean {judged_word(results)} over the tail"
    return f"{samples} The {what} is {mean} m{interval}{where}."
