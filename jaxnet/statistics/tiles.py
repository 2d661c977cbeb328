"""Data of heat maps: the cells over two swept keys, with statistics of their lanes."""

from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Int

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.naming import NO_BREAK
from jaxnet.kinds.fields import is_drawn
from jaxnet.model.wording import count_between, counted, number_text
from jaxnet.statistics.amplitude import attack_size, without_rounding
from jaxnet.statistics.axes import Axes, choose_axes, numeric, ordered_values, panels_of
from jaxnet.statistics.curves import SHARE_COLUMNS, cell_magnitudes, failed_kinds
from jaxnet.statistics.groups import Label
from jaxnet.statistics.intervals import clopper_pearson
from jaxnet.statistics.recovery import confidence_told, share_definition, share_name
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results

NO_CELL = -1
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
SHORT_ERRORS = 0.01, 1e5  # between which a tile has room for them without their power of ten


class Tiling(NamedTuple):
    """Two swept keys with their values, and a panel for each combination of the other labels.

    Columns are from the left, rows from the top.
    """

    column: str
    row: str
    columns: list[Label]
    rows: list[Label]
    panels: list[dict[str, Label]]
    cells: Int[np.ndarray, "panels rows columns"]  # numbers of cells, NO_CELL for none


def tiling(cells: Sequence[Cell], axes: Axes | None = None) -> Tiling | None:
    """Lay cells out by two swept keys; None without a second key of two values.

    `axes` has the columns as x, the rows as hue.
    """
    axes = axes or choose_axes(cells, most_hues=len(cells))
    if axes.x is None or axes.hue is None:
        return None
    columns, rows = ordered_values(cells, axes.x), ordered_values(cells, axes.hue)
    rows = rows[::-1] if numeric(rows) else rows  # numbers rise upwards, as on an axis
    groups = panels_of(cells, axes)
    numbers = np.full((len(groups), len(rows), len(columns)), NO_CELL)
    for place, (_, mine) in enumerate(groups):
        for cell in mine:
            at = rows.index(cell.labels[axes.hue]), columns.index(cell.labels[axes.x])
            numbers[place][at] = cell.number
    return Tiling(axes.x, axes.hue, columns, rows, [labels for labels, _ in groups], numbers)


def tile_table(results: Results) -> pd.DataFrame:
    """Share failed or unrecovered of all lanes, its interval [%], worst tail error per ā, by cell.

    Without a navigator the greatest spread [m] stands in place of the error per ā. Further columns
    are the `size` beside which it may be rounding, the interval as text, the numbers of ok and
    failed lanes, and the reason for a tile without numbers.
    """
    cells: Any = results.cells
    sizes = cell_magnitudes(results)
    worst, size = cells["tail_max_max"] / sizes, np.ones(len(sizes))
    if is_leaderless(results.study.cells):
        worst, size = cells["spread_max"], sizes
    found = 100 * share_lost(results)
    found = found.assign(worst=worst, size=size, ok=cells["ok"], failed=cells["failed"])
    ends = zip(found["unrecovered_low"], found["unrecovered_high"], strict=True)
    found["interval"] = [
        "–".join(number_text(end, whole=100.0) for end in pair) if pair[0] < pair[1] else ""
        for pair in ends
    ]
    pairs = zip(results.study.cells, cells["ok"], strict=True)
    found["blank"] = [blank_reason(cell, ok) for cell, ok in pairs]
    return found


def lost_name(results: Results) -> str:
    """Name lanes that did not hold: failed ones too, where any failed."""
    return "failed or " * bool(results.manifest["lanes"]["failed"]) + share_name(
        results.study.cells
    )


def share_lost(results: Results) -> pd.DataFrame:
    """Share unrecovered, low and high; lanes that failed count as unrecovered."""
    cells: Any = results.cells
    found = cells.reindex(columns=SHARE_COLUMNS).astype(float)
    sizes = [known_or(1.0, lambda cell=cell: attack_size(cell)) for cell in results.study.cells]
    attacked = np.isfinite(sizes)
    fell = (cells["failed"] > 0) & attacked & ("unrecovered" in cells)
    failed, ok = cells.loc[fell, ["failed", "ok"]].to_numpy().T
    lost = failed + np.rint(found.loc[fell, "unrecovered"].fillna(0.0) * ok).astype(int)
    ends = clopper_pearson(lost, failed + ok, confidence_told(results.study.config.samples))
    found.loc[fell, SHARE_COLUMNS] = np.stack([lost / (failed + ok), *ends], axis=1)
    return found


def blank_reason(cell: Cell, ok: int) -> str:
    """Say why a cell has no share and no number per ā; empty if it has them."""
    if np.isnan(attack_size(cell)):
        return "ā is drawn" if is_drawn(cell.scenario.attack.amplitude()) else "no attack"
    return "" if ok else "no lane ended"


def blank_reasons(found: pd.DataFrame, numbers: Int[np.ndarray, "..."], metric: str) -> list[str]:
    some = found["blank"].where(found[metric].isna()).reindex(numbers.ravel())
    reasons = filter(None, some.dropna().unique())
    return [*reasons, *["not run"] * bool((numbers == NO_CELL).any())]


def tile_notes(results: Results, numbers: Int[np.ndarray, "..."], metric: str) -> list[str]:
    """Notes below a heat map: lanes per tile, width of the intervals, and failed lanes."""
    cells, kinds, found = set(numbers.ravel().tolist()), failed_kinds(results), tile_table(results)
    known: Any = found[found.index.isin(cells) & found[metric].notna()]
    lanes = known["ok"] + known["failed"] * (metric == "unrecovered")
    words = [f"{count_between(lanes.astype(int).tolist(), 'lane')} a tile"]
    if metric == "unrecovered":
        if asked := results.study.config.recovery:
            words.insert(0, share_definition(asked, results.study.cells))
        middle, low, high = (known[name] for name in SHARE_COLUMNS)
        sure = 100 * confidence_told(results.study.config.samples)
        reach = max((high - middle).max(), (middle - low).max())
        most = f"at most {number_text(reach)} percentage points from the value"
        words.append(f"{sure:g} % intervals reach {most}")
    if failed := sum((kinds[cell] for cell in cells & kinds.keys()), Counter()):
        whether = "with" if metric == "unrecovered" else "without"
        words.append(f"*{NO_BREAK}{whether} lanes that failed: {counted(failed)}")
    return words


def tile_text(metric: str, value: float, size: float = 1.0) -> str:
    """A value as in tables, only all lanes are 100 %, and errors of many digits are powers of ten.

    What is rounding beside an attack of this size is 0.
    """
    if metric == "unrecovered":
        return number_text(value, whole=100.0)
    if SHORT_ERRORS[0] <= value < SHORT_ERRORS[1]:
        return number_text(value)
    value = without_rounding(value, size)
    if not 0 < value < np.inf:
        return f"{value:g}"
    digits, power = f"{value:.1e}".split("e")
    return f"{digits}×10{str(int(power)).translate(SUPERSCRIPTS)}"
