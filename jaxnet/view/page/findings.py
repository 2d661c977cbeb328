"""What a results folder says, in sentences: the errors' extremes, failures, recovery, bounds, how sure."""

from collections import Counter
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.naming import labels_title
from jaxnet.model.wording import count, counted
from jaxnet.statistics import recovery
from jaxnet.statistics.curves import BOUND_NAMES, Curve, failed_kinds, scales, shares
from jaxnet.statistics.summary import UNTOLD
from jaxnet.store.results import Results
from jaxnet.view.page.elements import ROUNDING, measured
from jaxnet.view.text.tables import number

UNSOUND = "lyapunov_printed"  # it is false in general (SCIENCE O5), so it is no bound to be tight

AFTER = " (it is of what stays once the transient is over)"


def sentences(results: Results, found: Sequence[Curve], fit: str) -> list[str]:
    """Each finding, as HTML; `fit` is the command that writes the bounds."""
    return [
        extremes(results),
        failures(results),
        *unrecovered(results),
        tightest(results, found, fit),
        certainty(results),
    ]


def errors_per_size(results: Results) -> tuple[pd.Series, str]:
    """Mean tail error of the cells that have one, per ā; in metres where no ā is known."""
    cells: Any = results.cells
    errors = pd.Series(cells["tail_mean_mean"].to_numpy(dtype=float))
    known = scales(results)
    if np.isnan(known).all():
        return errors.dropna(), "m"
    return (errors / known).dropna(), "ā"


def named(results: Results, numbers: Sequence[int]) -> str:
    """The first of these cells by what is swept, and how many more."""
    labels = results.study.cells[numbers[0]].labels
    more = f" and {count(len(numbers) - 1, 'other')}" if len(numbers) > 1 else ""
    return f"{escape(labels_title(labels))} (cell {numbers[0]}){more}" if labels else "all lanes"


def extremes(results: Results) -> str:
    """The best and the worst cell."""
    errors, unit = errors_per_size(results)
    if errors.empty:
        ended = results.manifest["lanes"]["ok"]
        return "No attacked lane came to its end." if ended else "No lane came to its end: there is no error."
    asked = len(results.study.cells) if unit == "m" else int(np.sum(scales(results) > 0))
    attacked = "attacked " if unit == "ā" else ""
    left = asked - len(errors)
    without = f" {count(left, f'{attacked}cell')} without a lane that ended." if left else ""
    least, most = f"{measured(errors.min())} {unit}", f"{measured(errors.max())} {unit}"
    head = f"The tail's mean error{', per ā,' if unit == 'ā' else ''} is"
    if errors.min() == errors.max() or len(errors) == 1:
        return f"{head} <b>{most}</b> in {named(results, errors.index.tolist())}.{without}"
    best, worst = (
        named(results, errors.index[errors == end].tolist()) for end in (errors.min(), errors.max())
    )
    return f"{head} least, <b>{least}</b>, in {best}; greatest, <b>{most}</b>, in {worst}.{without}"


def failures(results: Results) -> str:
    """How many lanes failed, and of what."""
    lanes = results.manifest["lanes"]
    if not lanes["failed"]:
        return f"No lane failed, of {lanes['total']:,}."
    kinds = sum(failed_kinds(results).values(), Counter())
    return f"<b>{count(lanes['failed'], 'lane')} of {lanes['total']:,} failed</b>: {escape(counted(kinds))}."


def unrecovered(results: Results) -> list[str]:
    """The least and the greatest share that does not recover, if it was asked for."""
    found, asked = shares(results), results.study.config.recovery
    if found.empty:
        return [] if asked is None else ["No share unrecovered: no attacked lane came to its end."]
    confidence = 100 * recovery.confidence_told(results.study.config.samples)
    above = "" if asked is None else f" (tail mean error above {asked.tau:g} ā)"
    share: Any = found["unrecovered"]

    def at(end: float) -> str:
        numbers = [int(cell) for cell in share.index[share == end]]
        _, low, high = 100 * found.loc[numbers[0]]
        interval = f"{confidence:g} % interval {number(low)} to {number(high)} %"
        return f"<b>{number(100 * end)} %</b> ({interval}) in {named(results, numbers)}"

    head = f"The share of lanes unrecovered{above} is"
    if share.min() == share.max():
        return [f"{head} {at(share.max())}."]
    return [f"{head} least, {at(share.min())}; greatest, {at(share.max())}."]


def tightest(results: Results, found: Sequence[Curve], fit: str) -> str:
    """How near the worst found is to the tightest bound."""
    if not found:
        return "No bound to compare with: no cell has an attack of a fixed magnitude."
    if not results.file("bounds.csv").exists():
        return f"Bounds are not fitted yet: <code>{fit}</code>"
    over, of_rounding, silent = [], 0, 0
    for curve in found:
        limits = {name: s for name, s in curve.limits("tail_max").items() if name != UNSOUND}
        if limits and curve.worst >= ROUNDING:
            name = min(limits, key=lambda each: limits[each])
            over.append((limits[name] / curve.worst, name, limits[name], curve))
        elif curve.worst < ROUNDING:
            of_rounding += 1
        else:
            silent += 1
    words = []
    if over:
        ratio, name, slope, curve = min(over, key=lambda each: each[0])
        where = f" in {escape(labels_title(curve.group.labels))}" if curve.group.labels else ""
        words.append(
            f"The tightest bound over the worst found is <b>{number(ratio)}</b>{where}: {BOUND_NAMES[name]},"
            f" {number(slope)} ā, over {number(curve.worst)} ā"
            f"{AFTER if ratio < 1 else ''}."
        )
    if of_rounding:
        words.append(f"In {count(of_rounding, 'group')} the worst found is 0 (rounding).")
    if silent:
        words.append(f"{count(silent, 'group')} with no lane, or no bound, to compare.")
    return " ".join([*words, *violated(results)])


def violated(results: Results) -> list[str]:
    """How many lanes are above a bound, if that was looked for."""
    if not results.file("violations.csv").exists():
        return []
    many = len(results.violations[["cell", "sample"]].drop_duplicates())
    return [
        f"<b>{count(many, 'lane')}</b> above a bound that claims to hold: see Violations."
        if many
        else "No lane is above a bound that claims to hold for it."
    ]


def certainty(results: Results) -> str:
    """How many samples there are, and the interval of the worst cell's mean."""
    samples = f"{count(results.manifest['samples'], 'sample')} of each cell"
    errors, _ = errors_per_size(results)
    if errors.empty:
        return f"{samples}."
    cells: Any = results.cells
    place: Any = errors.idxmax()
    worst, scale = cells.iloc[place], float(scales(results)[place])
    mean, low, high = (measured(float(worst[f"tail_mean_{name}"]), scale) for name in ("mean", "low", "high"))
    where = "the mean of the worst cell per ā" if len(errors) > 1 else "the mean"
    lanes = count(int(worst["ok"]), "ok lane")
    if np.isnan(worst["tail_mean_high"]):
        least = "" if np.isnan(worst["tail_mean_low"]) else f", {low} m or more with 97.5 % confidence"
        return f"{samples}: {where} is {mean} m{least}, of {lanes}; {UNTOLD}."
    sure = 100 * recovery.confidence_told(results.study.config.samples)
    return f"{samples}: {where} is {mean} m, {sure:g} % interval {low} to {high} m, of {lanes}."
