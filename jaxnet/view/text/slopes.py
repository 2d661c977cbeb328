"""Output of `jaxnet fit`: the ultimate error per ā, simulated and fitted, beside its bounds."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnet.config.naming import worded
from jaxnet.model.wording import number_text
from jaxnet.statistics import horizon, intervals
from jaxnet.statistics.amplitude import without_rounding
from jaxnet.statistics.curves import BOUND_NAMES, Curve, curves, no_magnitudes
from jaxnet.statistics.falling import falling_words
from jaxnet.statistics.fits import ENVELOPE
from jaxnet.statistics.limits import at_once_words, unchecked, unchecked_words, unclipped_words
from jaxnet.statistics.quantities import unended_words
from jaxnet.statistics.recovery import lowered_words
from jaxnet.store.results import Results
from jaxnet.view.text.printer import fitted_columns, fitted_text
from jaxnet.view.text.width import cell_title, filled

MOST_VIOLATIONS = 20
MEAN, INTERVAL, WORST = "mean error", "95 % interval", "worst error"
BOUND_TITLES = {name: title for name, title in BOUND_NAMES.items() if name != "lyapunov_printed"}
DROP_ORDER = tuple((name,) for name in (*reversed([*BOUND_TITLES.values()][3:]), INTERVAL))
TITLE = (
    "errors over the tail, as multiples of ā. mean error: s of the best fit error = s ā, the mean"
    " of vehicles and lanes; worst error: of any vehicle in any lane"
)
BOUNDS_LEGEND = (
    "{}: bounds of theory for any vehicle, each of which holds for this attack; a dash: no bound is"
    " known"
)
LOST, FLAT, BENT, FAILED, ONE_MAGNITUDE = "lost", "flat", "bent", "all failed", "one ā: "
NO_INTERVAL, ALIKE = "[-]", "(alike)"
SLOPE_NOTES = {  # by a text of a table
    LOST: f"lost: the median error is over {horizon.LOST:,} times the sum of ā and the farthest"
    " start",
    FLAT: "flat: errors of greater ā are not greater",
    BENT: "bent: errors rise with ā, but not in proportion",
    ALIKE: "(alike): all lanes have the same error per ā",
    ONE_MAGNITUDE: "one ā: lanes ended at one magnitude alone; the error per ā there, no fit",
    NO_INTERVAL: "[-]: too few independent lanes for an interval",
}


def fit_text(results: Results) -> str:
    found, cells = curves(results), results.study.cells
    parts = [errors_text(found, horizon.lost_cells(results, "tail_mean_median"))]
    if results.file("violations.csv").exists():
        parts.append(violations_text(results))
    fitted = [cell for curve in found for cell in curve.group.cells]
    told = no_magnitudes(found), unended_words(results, fitted), falling_words(results, cells)
    told += (lowered_words(results, cells),)
    parts += map(filled, (at_once_words(cells), *told))
    return "\n\n".join(filter(None, parts))


def errors_text(found: Sequence[Curve], lost: Sequence[int] = ()) -> str:
    """The mean error, the worst error and its bounds for each group, with notes; `lost` cells."""
    if not any(curve.fits or curve.bounds for curve in found):
        return ""
    table, labels = group_columns([(curve, curve_texts(curve, lost)) for curve in found])
    unknown = [title for title in BOUND_TITLES.values() if {*table[title]} == {"-"}]
    table = {name: values for name, values in table.items() if name not in unknown}
    shown = fitted_columns(table, labels, DROP_ORDER)
    lines = [filled(TITLE), fitted_text(table, labels, DROP_ORDER, "fit.csv and bounds.csv")]
    told = [*map(str, shown[MEAN]), *map(str, shown.get(INTERVAL, ()))]
    lines += [filled(SLOPE_NOTES[text]) for text in SLOPE_NOTES if any(text in t for t in told)]
    if bounds := [title for title in BOUND_TITLES.values() if title in shown]:
        lines.append(filled(BOUNDS_LEGEND.format(", ".join(bounds))))
    return "\n".join(lines)


def curve_texts(curve: Curve, lost: Sequence[int] = ()) -> dict[str, str]:
    """A row of the table; without a bound, an error that is not proportional to ā is in metres."""
    mean, ends = slope_texts(curve, bool({*lost} & {*curve.group.attacked}))
    bounds = {title: size_text(curve.slope(name, "worst")) for name, title in BOUND_TITLES.items()}
    worst = size_text(curve.worst)
    if {*bounds.values()} == {"-"} and (curve.is_bent("tail_max") or curve.is_flat("tail_max")):
        worst = f"{number_text(np.fmax.reduce(curve.spread('tail_max', 'max')[0]))} m"
    return {MEAN: mean, INTERVAL: ends, WORST: worst} | bounds


def size_text(slope: float) -> str:
    """A multiple of ā; a dash if it is not finite."""
    return "-" if not np.isfinite(slope) else f"{number_text(without_rounding(slope, 1.0))} ā"


def slope_texts(curve: Curve, lost: bool = False) -> tuple[str, str]:
    """The slope of the mean error over ā, or a word for why it has none, and its interval."""
    why = {
        FAILED: not curve.ended.any(),
        LOST: lost,
        FLAT: curve.is_flat("tail_mean"),
        BENT: curve.is_bent("tail_mean"),
    }
    if any(why.values()):
        return next(word for word, is_so in why.items() if is_so), "-"
    alone = curve.fits and curve.ended.sum() == 1
    known = curve.fits.get(("tail_mean", None)) if alone else curve.fit("tail_mean")
    most = curve.fits.get(("tail_mean", ENVELOPE))
    if known is None:
        return "-", "-"
    low, high = (number_text(without_rounding(each, 1.0)) for each in known[1:])
    ends = f"[{low}, {high}]"
    if np.isnan(known[1]):
        several = curve.cells["ok"].to_numpy().max() > 1
        alike = several and most and most[0] - known[0] <= intervals.ROUNDING_SPREAD * most[0]
        ends = ALIKE if alike else NO_INTERVAL
    return ONE_MAGNITUDE * bool(alone) + size_text(known[0]), ends


def group_columns(
    rows: Sequence[tuple[Curve, dict[str, Any]]],
) -> tuple[dict[str, list[Any]], list[str]]:
    """Columns of a table of groups, and the names of swept keys; values read as in `show`."""
    named = [worded(curve.group.labels) for curve, _ in rows]
    whole = [labels | told for labels, (_, told) in zip(named, rows, strict=True)]
    return {name: [row[name] for row in whole] for name in whole[0]}, list(named[0])


def violations_text(results: Results) -> str:
    found: Any = results.violations
    cells = results.study.cells
    lines = [
        filled(f"ABOVE ITS BOUND: {cell_title(cells[row.cell])}, sample {row.sample}:") + "\n"
        f"  greatest error {row.tail_max:.6g} m, bound {row.limit:.6g} m ({row.bound})\n"
        f"  {row.command}"
        for row in found.head(MOST_VIOLATIONS).itertuples()
    ]
    if len(found) > MOST_VIOLATIONS:
        lines.append(f"… {len(found) - MOST_VIOLATIONS} more in {results.file('violations.csv')}")
    if results.missing:  # theory needs their code
        return "\n".join(lines)
    attacked = sum(cell.scenario.attack.present for cell in cells)
    if not lines and sum(map(len, unchecked(cells).values())) < attacked:
        lines.append("no lane with a bound is above it")
    if words := unchecked_words(cells):
        lines.append(filled(f"no bound is known for {words}"))
    if unclipped := unclipped_words(results):
        lines.append(filled(unclipped))
    return "\n".join(lines)
