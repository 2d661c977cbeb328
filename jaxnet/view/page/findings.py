"""Findings about a results folder, in sentences."""

from collections import Counter
from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import is_leaderless, judged_metric
from jaxnet.config.naming import is_kind, key_name, labels_title, value_name
from jaxnet.model.wording import count, count_between, counted
from jaxnet.statistics import curves
from jaxnet.statistics.falling import falling_words
from jaxnet.statistics.recovery import confidence_told, criterion_words, share_name
from jaxnet.store.results import Results
from jaxnet.view.columns import ROUNDING_ERROR
from jaxnet.view.drawings.words import error_text
from jaxnet.view.page.elements import Section
from jaxnet.view.text.width import four_digits

UNSOUND_BOUND = "lyapunov_printed"  # false in general (theorems.md O5), so no bound to be tight
MOST_COMPARED = 8  # values of a swept kind in one sentence


def findings_section(results: Results, found: Sequence[curves.Curve], fit: str) -> Section:
    told = finding_sentences(results, found, fit)
    return Section(
        "findings", "Findings", f"<ul>{''.join(f'<li>{each}</li>' for each in told)}</ul>"
    )


def finding_sentences(results: Results, found: Sequence[curves.Curve], fit: str) -> list[str]:
    """Each finding as HTML; `fit` is the command that computes the bounds."""
    alone = is_leaderless(results.study.cells)
    lanes, falling = results.manifest["lanes"], falling_words(results, results.study.cells)
    failed = f"All {count(lanes['total'], 'lane')} came to their end; none failed."
    if lanes["failed"]:
        kinds = escape(counted(sum(curves.failed_kinds(results).values(), Counter())))
        failed = f"<b>{count(lanes['failed'], 'lane')} of {lanes['total']:,} failed</b>: {kinds}."
    sentences = [
        f"<b>{falling}</b>." if falling else "",
        unrecovered_sentence(results),
        extremes_sentence(results),
        outside_sentence(results) if alone else "",
        *kinds_sentences(results),
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


def where_words(results: Results, numbers: Sequence[int]) -> str:
    """The swept values of the first cell, and the number of further cells."""
    labels = results.study.cells[numbers[0]].labels
    if not labels:
        return "over all lanes"
    if len(numbers) == len(results.study.cells):
        return "in every cell"
    more = f" and {count(len(numbers) - 1, 'other cell')}" if len(numbers) > 1 else ""
    return f"with {escape(labels_title(labels))} (cell {numbers[0]}){more}"


def at_ends(results: Results, values: pd.Series, words: Callable[[float, int], str]) -> list[str]:
    """The least and the greatest value in words, each with its cells; one if they read alike."""
    ends = {}
    for end in (values.min(), values.max()):
        numbers = [int(cell) for cell in values.index[values == end]]
        ends.setdefault(words(end, numbers[0]), numbers)
    if len(ends) == 1:
        everywhere = [int(cell) for cell in values.index]
        ends = dict.fromkeys(ends, everywhere)
    return [f"{told} {where_words(results, numbers)}" for told, numbers in ends.items()]


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
    if not per_size:
        errors = errors.where(errors.abs() >= ROUNDING_ERROR, ROUNDING_ERROR / 2)
    ends = at_ends(results, errors, lambda end, _: f"<b>{error_text(end)} {unit}</b>")
    span = f"ranges from {' to '.join(ends)}" if len(ends) > 1 else f"is {ends[0]}"
    return f"The mean {word} over the tail {span}.{without}"


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


def kinds_sentences(results: Results) -> list[str]:
    """Compare the values of each swept kind, setting by setting of the other swept keys.

    Cells are compared by the share unrecovered with its interval where shares differ, else by the
    mean tail error with three digits.
    """
    compared, unit = 100 * curves.unrecovered_shares(results).astype(float), "%"
    compared.columns = ["value", "low", "high"]
    what = f"Lanes {share_name(results.study.cells)}"
    if results.study.config.recovery is None or len({*compared["value"]}) < 2:
        errors, unit = errors_per_size(results)
        printed = errors.map(lambda error: float(f"{error:.3g}"))
        compared = pd.DataFrame({"value": errors, "low": printed, "high": printed})
        what = f"Mean {judged_word(results)} over the tail"
    labels = [results.study.cells[n].labels for n in compared.index]
    swept = pd.DataFrame(labels, compared.index, list(results.study.cells[0].labels)).map(str)
    kinds = [str(key) for key in swept if is_kind(key) and len({*swept[key]}) > 1]
    return [f"{what} by {compared_words(key, compared, swept, unit)}." for key in kinds]


def compared_words(key: str, compared: pd.DataFrame, swept: pd.DataFrame, unit: str) -> str:
    """Compare the values of one swept kind: the range, and in how many settings a value is least.

    A setting is a combination of the other swept keys. A value is least where its interval begins
    no later than that of each other value ends.
    """
    others = [swept[other] for other in swept if other != key]
    settings = compared.groupby(others if others else np.zeros(len(compared)))
    least: Any = compared["low"] <= settings["high"].transform("min")
    rows = []
    for label, numbers in compared.groupby(swept[key], sort=False).groups.items():
        some: Any = compared.loc[numbers, "value"]
        ends = dict.fromkeys(error_text(end) for end in (some.min(), some.max()))
        words = f"{escape(value_name(key, label))} <b>{' to '.join(ends)} {unit}</b>"
        many = int(least[numbers].sum())
        rows.append((-many, some.mean(), words + f", least in {many}" * bool(others)))
    told = [words for *_, words in sorted(rows, key=lambda row: row[:2])[:MOST_COMPARED]]
    if len(rows) > len(told):
        told.append(count(len(rows) - len(told), "other"))
    over = f" over {count(settings.ngroups, 'setting')}, least within intervals" if others else ""
    return f"{escape(key_name(key))}{over}: {'; '.join(told)}"


def unrecovered_sentence(results: Results) -> str:
    """The least and the greatest share of lanes unrecovered, if the study asks for it."""
    found, asked = curves.unrecovered_shares(results), results.study.config.recovery
    cells, confidence = results.study.cells, confidence_told(results.study.config.samples)
    if asked is None and found.empty:
        return ""
    if found.empty:
        return f"No share {share_name(cells)}: no attacked lane came to its end."

    def words(share: float, cell: int) -> str:
        low, high = (four_digits(100 * end) for end in found.loc[cell].iloc[1:])
        interval = f"{100 * confidence:g} % interval {low} to {high} %"
        return f"<b>{four_digits(100 * share)} %</b> ({interval})"

    share: Any = found["unrecovered"]
    ends = at_ends(results, share, words)
    above = "" if asked is None else f" ({criterion_words(asked, cells)})"
    span = f"from {' to '.join(ends)}" if len(ends) > 1 else ends[0]
    return f"Lanes {share_name(cells)}{above}: {span}."


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
    words = []
    if tightest:
        ratio, name, slope, curve = min(tightest, key=lambda each: each[0])
        where = f" with {escape(labels_title(curve.group.labels))}" if curve.group.labels else ""
        after = "; the bound holds once the transient is over" if ratio < 1 else ""
        words.append(
            f"The tightest bound, {curves.BOUND_NAMES[name]}, is <b>{four_digits(ratio)} times</b>"
            f" the worst error found: {four_digits(slope)} ā over"
            f" {four_digits(curve.worst)} ā{where}{after}."
        )
    if of_rounding := len(found) - len(lasting):
        words.append(f"In {count(of_rounding, 'group')} of cells the worst error is 0 (rounding).")
    if silent := len(lasting) - len(tightest):
        groups = f"{count(len(found), 'group')} of cells"
        words.append(f"No bound of theory applies to {silent} of {groups}.")
    if (tightest or of_rounding) and results.file("violations.csv").exists():
        many = len(results.violations[["cell", "sample"]].drop_duplicates())
        told = f"<b>{count(many, 'lane')}</b> above a bound that claims to hold: see Violations."
        words.append(told if many else "No lane is above a bound that claims to hold for it.")
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
    worst: Any = results.cells.iloc[place]
    scale, ends = float(curves.cell_magnitudes(results)[place]), ("mean", "low", "high")
    mean, low, high = (error_text(float(worst[f"{metric}_{end}"]), scale) for end in ends)
    where, of = ("The greatest mean", f" of cell {place}") if len(means) > 1 else ("The mean", "")
    lanes = f"over {count(int(worst['ok']), 'ok lane')}{of}"
    if metric == "spread":
        return f"{samples} {where} spread is {mean} m, {lanes}."
    sure = 100 * confidence_told(results.study.config.samples)
    known = not np.isnan(worst["tail_mean_high"])
    interval = f" ({sure:g} % interval {low} to {high} m)" if known else ""
    return f"{samples} {where} is {mean} m{interval}, {lanes}."
