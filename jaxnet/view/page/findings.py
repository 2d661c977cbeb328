"""Findings about a results folder, in sentences: extreme errors, failures, recovery, bounds, certainty."""

from collections import Counter
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import is_leaderless, judged_metric
from jaxnet.config.naming import is_kind, key_name, labels_title, value_name
from jaxnet.model.wording import count, count_between, counted
from jaxnet.statistics import recovery
from jaxnet.statistics.curves import (
    BOUND_NAMES,
    Curve,
    cell_magnitudes,
    failed_kinds,
    unrecovered_shares,
)
from jaxnet.store.results import Results
from jaxnet.view.columns import ROUNDING_ERROR
from jaxnet.view.page.elements import error_text
from jaxnet.view.text.width import four_digits

UNSOUND_BOUND = (
    "lyapunov_printed"  # it is false in general (theorems.md O5), so it is no bound to be tight
)

AFTER_TRANSIENT = "; the bound holds once the transient is over"
MOST_COMPARED = 8  # values of a swept kind in one sentence


def finding_sentences(results: Results, found: Sequence[Curve], fit: str) -> list[str]:
    """Return each finding as HTML; `fit` is the command that computes the bounds."""
    alone = is_leaderless(results.study.cells)
    return [
        *unrecovered_sentences(results),
        extremes_sentence(results),
        *(outside_sentences(results) if alone else []),
        *kinds_sentences(results),
        failures_sentence(results),
        *([] if alone else [bounds_sentence(results, found, fit)]),
        certainty_sentence(results),
    ]


def errors_per_size(results: Results) -> tuple[pd.Series, str]:
    """Return mean tail errors by cell and their unit: per ā, or in metres if no ā is known.

    Without a navigator they are mean spreads in metres.
    """
    cells: Any = results.cells
    metric = judged_metric(results.study.cells)
    errors = pd.Series(cells[f"{metric}_mean"].to_numpy(dtype=float))
    known = cell_magnitudes(results)
    if np.isnan(known).all() or metric == "spread":
        return errors.dropna(), "m"
    return (errors / known).dropna(), "ā"


def where_words(results: Results, numbers: Sequence[int]) -> str:
    """Return the swept values of the first cell, and the number of further cells."""
    labels = results.study.cells[numbers[0]].labels
    if not labels:
        return "over all lanes"
    if len(numbers) == len(results.study.cells):
        return "in every cell"
    more = f" and {count(len(numbers) - 1, 'other cell')}" if len(numbers) > 1 else ""
    return f"with {escape(labels_title(labels))} (cell {numbers[0]}){more}"


def extremes_sentence(results: Results) -> str:
    """State the cells with the least and the greatest error."""
    errors, unit = errors_per_size(results)
    if errors.empty:
        ended = results.manifest["lanes"]["ok"]
        none = f"No lane came to its end: there is no {judged_word(results)}."
        return "No attacked lane came to its end." if ended else none
    asked = len(results.study.cells) if unit == "m" else int(np.sum(cell_magnitudes(results) > 0))
    attacked = "attacked " if unit == "ā" else ""
    left = asked - len(errors)
    without = f" {count(left, f'{attacked}cell')} without a lane that ended." if left else ""
    errors = (
        errors.where(errors.abs() >= ROUNDING_ERROR, ROUNDING_ERROR / 2) if unit == "m" else errors
    )
    least, most = (f"<b>{error_text(end)} {unit}</b>" for end in (errors.min(), errors.max()))
    head = f"The mean {judged_word(results)} over the tail"
    if least == most:  # as they are printed
        return f"{head} is {most} {where_words(results, errors.index.tolist())}.{without}"
    best, worst = (
        where_words(results, errors.index[errors == end].tolist())
        for end in (errors.min(), errors.max())
    )
    return f"{head} ranges from {least} {best} to {most} {worst}.{without}"


def judged_word(results: Results) -> str:
    """Return the word for what lanes are judged by."""
    return "spread" if is_leaderless(results.study.cells) else "error"


def outside_sentences(results: Results) -> list[str]:
    """State how far vehicles left the hull of their starts, in a study without a navigator."""
    cells: Any = results.cells
    ways: Any = pd.Series(cells["outside_max"].to_numpy(dtype=float)).dropna()
    if ways.empty:
        return []
    left = ways[ways >= ROUNDING_ERROR]
    whom = "vehicle that is not attacked"
    if left.empty:
        return [f"No {whom} left the convex hull of their starts, in any lane."]
    far = f"<b>{error_text(ways.max())} m</b> {where_words(results, ways.index[ways == ways.max()].tolist())}"
    inside = (
        f"; in {count(len(ways) - len(left), 'cell')} none left it" if len(left) < len(ways) else ""
    )
    return [
        f"The greatest way of a {whom} out of the convex hull of their starts is {far}{inside}."
    ]


def kinds_sentences(results: Results) -> list[str]:
    """Compare the values of each swept kind, setting by setting of the other swept keys."""
    compared, unit = compared_values(results)
    share = f"Lanes {recovery.share_name(results.study.cells)}"
    what = share if unit == "%" else f"Mean {judged_word(results)} over the tail"
    keys = list(results.study.cells[0].labels)
    swept = pd.DataFrame(
        [results.study.cells[n].labels for n in compared.index], compared.index, keys
    )
    swept = swept.map(str)
    return [
        kind_sentence(key, compared, swept, unit, what)
        for key in keys
        if is_kind(key) and len({*swept[key]}) > 1
    ]


def compared_values(results: Results) -> tuple[pd.DataFrame, str]:
    """Return what cells are compared by, with its ends, and its unit.

    The share unrecovered with its interval, else the mean tail error with three digits.
    """
    shares = 100 * unrecovered_shares(results).astype(float)
    if results.study.config.recovery is not None and len({*shares["unrecovered"]}) > 1:
        return shares.set_axis(["value", "low", "high"], axis=1), "%"
    errors, unit = errors_per_size(results)
    printed = errors.map(lambda error: float(f"{error:.3g}"))
    return pd.DataFrame({"value": errors, "low": printed, "high": printed}), unit


def kind_sentence(
    key: str, compared: pd.DataFrame, swept: pd.DataFrame, unit: str, what: str
) -> str:
    """Compare the values of one swept kind: the range, and the number of settings where a value is least.

    A setting is a combination of the other swept keys. A value is least where its interval begins no later
    than another ends, that of each other value.
    """
    others = [swept[other] for other in swept if other != key]
    settings = compared.groupby(others if others else np.zeros(len(compared)))
    least: Any = compared["low"] <= settings["high"].transform("min")
    rows = []
    for label, numbers in compared.groupby(swept[key], sort=False).groups.items():
        some: Any = compared.loc[numbers, "value"]
        rows.append(
            (
                -int(least[numbers].sum()),
                some.mean(),
                value_name(key, label),
                some.min(),
                some.max(),
            )
        )
    words = [
        f"{escape(name)} {range_words(low, high, unit)}" + f", least in {-many}" * bool(others)
        for many, _, name, low, high in sorted(rows, key=lambda row: row[:2])[:MOST_COMPARED]
    ]
    told = "; ".join(words + [count(len(rows) - len(words), "other")] * (len(rows) > len(words)))
    over = f" over {count(settings.ngroups, 'setting')}, least within intervals" if others else ""
    return f"{what} by {escape(key_name(key))}{over}: {told}."


def range_words(low: float, high: float, unit: str) -> str:
    """Return a range in words; one number if both ends are printed alike."""
    ends = list(dict.fromkeys(error_text(end) for end in (low, high)))
    return f"<b>{' to '.join(ends)} {unit}</b>"


def failures_sentence(results: Results) -> str:
    """State the number of failed lanes, by the kind of failure."""
    lanes = results.manifest["lanes"]
    if not lanes["failed"]:
        return f"All {count(lanes['total'], 'lane')} came to their end; none failed."
    kinds = sum(failed_kinds(results).values(), Counter())
    return f"<b>{count(lanes['failed'], 'lane')} of {lanes['total']:,} failed</b>: {escape(counted(kinds))}."


def unrecovered_sentences(results: Results) -> list[str]:
    """State the least and the greatest share of lanes unrecovered, if the study asks for it."""
    found, asked = unrecovered_shares(results), results.study.config.recovery
    if found.empty:
        name = recovery.share_name(results.study.cells)
        return [] if asked is None else [f"No share {name}: no attacked lane came to its end."]
    confidence = 100 * recovery.confidence_told(results.study.config.samples)
    above = "" if asked is None else f" ({recovery.criterion_words(asked, results.study.cells)})"
    share: Any = found["unrecovered"]

    def at(end: float) -> str:
        numbers = [int(cell) for cell in share.index[share == end]]
        _, low, high = 100 * found.loc[numbers[0]]
        interval = f"{confidence:g} % interval {four_digits(low)} to {four_digits(high)} %"
        return f"<b>{four_digits(100 * end)} %</b> ({interval}) {where_words(results, numbers)}"

    head = f"Lanes {recovery.share_name(results.study.cells)}{above}"
    if share.min() == share.max():
        return [f"{head}: {at(share.max())}."]
    return [f"{head}: from {at(share.min())} to {at(share.max())}."]


def bounds_sentence(results: Results, found: Sequence[Curve], fit: str) -> str:
    """State the least ratio of a bound to the worst error found."""
    if not found:
        return "Bounds of theory: none to compare with, for no cell has an attack of a fixed magnitude."
    if not results.file("bounds.csv").exists():
        return f"Bounds are not fitted yet: <code>{fit}</code>"
    over, of_rounding = [], 0
    for curve in found:
        limits = {name: s for name, s in curve.limits("tail_max").items() if name != UNSOUND_BOUND}
        if limits and curve.worst >= ROUNDING_ERROR:
            name = min(limits, key=lambda each: limits[each])
            over.append((limits[name] / curve.worst, name, limits[name], curve))
        of_rounding += curve.worst < ROUNDING_ERROR
    words = []
    if over:
        ratio, name, slope, curve = min(over, key=lambda each: each[0])
        where = f" with {escape(labels_title(curve.group.labels))}" if curve.group.labels else ""
        words.append(
            f"The tightest bound, {BOUND_NAMES[name]}, is <b>{four_digits(ratio)} times</b> the worst error"
            f" found: {four_digits(slope)} ā over {four_digits(curve.worst)} ā{where}"
            f"{AFTER_TRANSIENT if ratio < 1 else ''}."
        )
    if of_rounding:
        words.append(f"In {count(of_rounding, 'group')} of cells the worst error is 0 (rounding).")
    if silent := len(found) - len(over) - of_rounding:
        words.append(
            f"No bound of theory applies to {silent} of {count(len(found), 'group')} of cells."
        )
    return " ".join([*words, *(violated_sentences(results) if over or of_rounding else [])])


def violated_sentences(results: Results) -> list[str]:
    """State the number of lanes above a bound, if the bounds were checked."""
    if not results.file("violations.csv").exists():
        return []
    many = len(results.violations[["cell", "sample"]].drop_duplicates())
    return [
        f"<b>{count(many, 'lane')}</b> above a bound that claims to hold: see Violations."
        if many
        else "No lane is above a bound that claims to hold for it."
    ]


def certainty_sentence(results: Results) -> str:
    """State the number of lanes of a cell, and the interval of the greatest mean."""
    samples = f"Each cell has {count_between(results.samples, 'lane')}"
    cells: Any = results.cells
    metric = judged_metric(results.study.cells)
    means: Any = cells[f"{metric}_mean"].dropna()  # in metres: the greatest per ā is another
    if means.empty:
        return f"{samples}."
    place = means.idxmax()
    worst, scale = cells.iloc[place], float(cell_magnitudes(results)[place])
    mean, low, high = (
        error_text(float(worst[f"{metric}_{name}"]), scale) for name in ("mean", "low", "high")
    )
    where, of = ("The greatest mean", f" of cell {place}") if len(means) > 1 else ("The mean", "")
    lanes = f"{count(int(worst['ok']), 'ok lane')}{of}"
    if metric == "spread":
        return f"{samples}. {where} spread is {mean} m, over {lanes}."
    if np.isnan(worst["tail_mean_high"]):
        return f"{samples}. {where} is {mean} m, over {lanes}."
    sure = 100 * recovery.confidence_told(results.study.config.samples)
    return f"{samples}. {where} is {mean} m ({sure:g} % interval {low} to {high} m), over {lanes}."
