"""Findings about a results folder, in sentences: extreme errors, failures, recovery, bounds, certainty."""

from collections import Counter
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.naming import labels_title
from jaxnet.model.wording import count, counted
from jaxnet.statistics import recovery
from jaxnet.statistics.curves import BOUND_NAMES, Curve, cell_magnitudes, failed_kinds, unrecovered_shares
from jaxnet.statistics.summary import NO_MEAN_INTERVAL
from jaxnet.store.results import Results
from jaxnet.view.page.elements import ROUNDING_ERROR, error_text
from jaxnet.view.text.width import four_digits

UNSOUND_BOUND = "lyapunov_printed"  # it is false in general (theorems.md O5), so it is no bound to be tight

AFTER_TRANSIENT = " (it is of what stays once the transient is over)"


def finding_sentences(results: Results, found: Sequence[Curve], fit: str) -> list[str]:
    """Return each finding as HTML; `fit` is the command that computes the bounds."""
    return [
        extremes_sentence(results),
        failures_sentence(results),
        *unrecovered_sentences(results),
        tightest_sentence(results, found, fit),
        certainty_sentence(results),
    ]


def errors_per_size(results: Results) -> tuple[pd.Series, str]:
    """Return mean tail errors by cell and their unit: per ā, or in metres if no ā is known."""
    cells: Any = results.cells
    errors = pd.Series(cells["tail_mean_mean"].to_numpy(dtype=float))
    known = cell_magnitudes(results)
    if np.isnan(known).all():
        return errors.dropna(), "m"
    return (errors / known).dropna(), "ā"


def cells_named_first(results: Results, numbers: Sequence[int]) -> str:
    """Return the name of the first cell, and the number of further cells."""
    labels = results.study.cells[numbers[0]].labels
    more = f" and {count(len(numbers) - 1, 'other')}" if len(numbers) > 1 else ""
    return f"{escape(labels_title(labels))} (cell {numbers[0]}){more}" if labels else "all lanes"


def extremes_sentence(results: Results) -> str:
    """State the cells with the least and the greatest error."""
    errors, unit = errors_per_size(results)
    if errors.empty:
        ended = results.manifest["lanes"]["ok"]
        return "No attacked lane came to its end." if ended else "No lane came to its end: there is no error."
    asked = len(results.study.cells) if unit == "m" else int(np.sum(cell_magnitudes(results) > 0))
    attacked = "attacked " if unit == "ā" else ""
    left = asked - len(errors)
    without = f" {count(left, f'{attacked}cell')} without a lane that ended." if left else ""
    least, most = f"{error_text(errors.min())} {unit}", f"{error_text(errors.max())} {unit}"
    head = f"The tail's mean error{', per ā,' if unit == 'ā' else ''} is"
    if errors.min() == errors.max() or len(errors) == 1:
        return f"{head} <b>{most}</b> in {cells_named_first(results, errors.index.tolist())}.{without}"
    best, worst = (
        cells_named_first(results, errors.index[errors == end].tolist())
        for end in (errors.min(), errors.max())
    )
    return f"{head} least, <b>{least}</b>, in {best}; greatest, <b>{most}</b>, in {worst}.{without}"


def failures_sentence(results: Results) -> str:
    """State the number of failed lanes, by the kind of failure."""
    lanes = results.manifest["lanes"]
    if not lanes["failed"]:
        return f"No lane failed, of {lanes['total']:,}."
    kinds = sum(failed_kinds(results).values(), Counter())
    return f"<b>{count(lanes['failed'], 'lane')} of {lanes['total']:,} failed</b>: {escape(counted(kinds))}."


def unrecovered_sentences(results: Results) -> list[str]:
    """State the least and the greatest share of lanes unrecovered, if the study asks for it."""
    found, asked = unrecovered_shares(results), results.study.config.recovery
    if found.empty:
        return [] if asked is None else ["No share unrecovered: no attacked lane came to its end."]
    confidence = 100 * recovery.confidence_told(results.study.config.samples)
    above = "" if asked is None else f" (tail mean error above {asked.tau:g} ā)"
    share: Any = found["unrecovered"]

    def at(end: float) -> str:
        numbers = [int(cell) for cell in share.index[share == end]]
        _, low, high = 100 * found.loc[numbers[0]]
        interval = f"{confidence:g} % interval {four_digits(low)} to {four_digits(high)} %"
        return f"<b>{four_digits(100 * end)} %</b> ({interval}) in {cells_named_first(results, numbers)}"

    head = f"The share of lanes unrecovered{above} is"
    if share.min() == share.max():
        return [f"{head} {at(share.max())}."]
    return [f"{head} least, {at(share.min())}; greatest, {at(share.max())}."]


def tightest_sentence(results: Results, found: Sequence[Curve], fit: str) -> str:
    """State the least ratio of a bound to the worst error found."""
    if not found:
        return "No bound to compare with: no cell has an attack of a fixed magnitude."
    if not results.file("bounds.csv").exists():
        return f"Bounds are not fitted yet: <code>{fit}</code>"
    over, of_rounding, silent = [], 0, 0
    for curve in found:
        limits = {name: s for name, s in curve.limits("tail_max").items() if name != UNSOUND_BOUND}
        if limits and curve.worst >= ROUNDING_ERROR:
            name = min(limits, key=lambda each: limits[each])
            over.append((limits[name] / curve.worst, name, limits[name], curve))
        elif curve.worst < ROUNDING_ERROR:
            of_rounding += 1
        else:
            silent += 1
    words = []
    if over:
        ratio, name, slope, curve = min(over, key=lambda each: each[0])
        where = f" in {escape(labels_title(curve.group.labels))}" if curve.group.labels else ""
        words.append(
            f"The tightest bound over the worst found is <b>{four_digits(ratio)}</b>{where}:"
            f" {BOUND_NAMES[name]}, {four_digits(slope)} ā, over {four_digits(curve.worst)} ā"
            f"{AFTER_TRANSIENT if ratio < 1 else ''}."
        )
    if of_rounding:
        words.append(f"In {count(of_rounding, 'group')} the worst found is 0 (rounding).")
    if silent:
        words.append(f"{count(silent, 'group')} with no lane, or no bound, to compare.")
    return " ".join([*words, *violated_sentences(results)])


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
    """State the number of samples, and the interval of the worst cell's mean."""
    samples = f"{count(results.manifest['samples'], 'sample')} of each cell"
    errors, _ = errors_per_size(results)
    if errors.empty:
        return f"{samples}."
    cells: Any = results.cells
    place: Any = errors.idxmax()
    worst, scale = cells.iloc[place], float(cell_magnitudes(results)[place])
    mean, low, high = (
        error_text(float(worst[f"tail_mean_{name}"]), scale) for name in ("mean", "low", "high")
    )
    where = "the mean of the worst cell per ā" if len(errors) > 1 else "the mean"
    lanes = count(int(worst["ok"]), "ok lane")
    if np.isnan(worst["tail_mean_high"]):
        least = "" if np.isnan(worst["tail_mean_low"]) else f", {low} m or more with 97.5 % confidence"
        return f"{samples}: {where} is {mean} m{least}, of {lanes}; {NO_MEAN_INTERVAL}."
    sure = 100 * recovery.confidence_told(results.study.config.samples)
    return f"{samples}: {where} is {mean} m, {sure:g} % interval {low} to {high} m, of {lanes}."
