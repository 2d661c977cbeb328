"""Output of `jaxnet fit`: the ultimate error per ā, simulated and fitted, and its bounds."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnet.config.naming import worded
from jaxnet.model.wording import count_between, number_text
from jaxnet.statistics import intervals
from jaxnet.statistics.amplitude import LEAST_UNRECOVERED, without_rounding
from jaxnet.statistics.curves import BOUND_NAMES, Curve, Fit, curves, no_magnitudes
from jaxnet.statistics.falling import falling_words
from jaxnet.statistics.fits import ENVELOPE, FEWEST, FEWEST_BEYOND, whole_draws
from jaxnet.statistics.limits import at_once_words, unchecked, unchecked_words, unclipped_words
from jaxnet.statistics.recovery import lowered_words
from jaxnet.statistics.summary import SUMMARISED
from jaxnet.store.results import Results
from jaxnet.view.text.printer import fitted_columns, fitted_text
from jaxnet.view.text.width import cell_title, filled

MOST_VIOLATIONS = 20
WORST_LANE = "worst lane"
QUANTILE_COLUMNS = {"half of the lanes below": 0.5, "95 % below": 0.95, WORST_LANE: ENVELOPE}
ERROR_NAMES = {"tail_mean": "mean", "tail_max": "greatest"}
SLOPE = "mean of the lanes"
POWER = "power p of c ā^p"
SLOPES_TITLE = (
    "slope s of error = s ā over the tail, with its 95 % interval; mean: of the fleet's vehicles;"
    " greatest: of any vehicle"
)
NO_EFFECT, NOT_PROPORTIONAL, ONE_MAGNITUDE = "does not rise", "not proportional", "one ā: "
NO_INTERVAL, OF_SEQUENCES = "[-]", "[-]: no interval is known for draws of Sobol's sequences"
ALIKE, TOO_FEW = "(alike)", "[-]: no interval, as there are too few lanes: "
LANES_NEEDED = {  # by column, for an interval
    SLOPE: f"the mean takes {intervals.LANES_FOR_MEAN}, G: skewness of their errors",
    "half of the lanes below": f"half of the lanes below takes {FEWEST_BEYOND / 0.5:.0f}",
    "95 % below": f"95 % below takes {FEWEST_BEYOND / 0.05:.0f}",
    POWER: f"the power takes {FEWEST} that make up its variance",
}
SLOPE_NOTES = {
    NO_EFFECT: "does not rise: errors of greater ā are not greater",
    NOT_PROPORTIONAL: "not proportional: errors rise with ā, but not as s ā",
    ALIKE: "(alike): all lanes have the same error per ā",
    ONE_MAGNITUDE: "one ā: lanes ended at one magnitude alone; the error per ā there, no slope",
}
SLOPES_DROP_ORDER = tuple((name,) for name in (POWER, *QUANTILE_COLUMNS))
BOUND_COLUMNS = {name: (bound, "worst") for bound, name in BOUND_NAMES.items()}
BOUND_COLUMNS |= {
    f"{name}, fleet": (bound, "fleet") for bound, name in BOUND_NAMES.items() if "lyapunov" in bound
}
BOUNDS_DROP_ORDER = tuple((name,) for name in reversed(BOUND_COLUMNS))
BOUNDS_LEGEND = (
    "bounds of any one vehicle; fleet: of all vehicles' errors together; as printed: with the"
    " paper's constant, which is false in general; a dash: no bound is known, or no lane ended;"
    " 0: the bound itself is 0; inf: the error is 0, the bound is not"
)


def fit_text(results: Results) -> str:
    found = curves(results)
    parts = [slopes_text(results, found)]
    if results.file("bounds.csv").exists():
        title = "bounds of theory, as multiples of the worst error found"
        rows = [(curve, group_ratios(curve)) for curve in found]
        told = [name for name in BOUND_COLUMNS if any(row[name] == row[name] for _, row in rows)]
        if told:
            table, labels = group_columns(rows)
            table = {
                name: table[name] for name in table if name in told or name not in BOUND_COLUMNS
            }
            text = fitted_text(table, labels, BOUNDS_DROP_ORDER, "bounds.csv")
            parts.append("\n".join([filled(title), text, filled(BOUNDS_LEGEND)]))
    if results.file("violations.csv").exists():
        parts.append(violations_text(results))
    cells = results.study.cells
    told = no_magnitudes(found), falling_words(results, cells), lowered_words(results, cells)
    parts += map(filled, (at_once_words(cells), *told))
    return "\n\n".join(filter(None, parts))


def slopes_text(results: Results, found: Sequence[Curve]) -> str:
    """The error as a multiple of ā, what share of lanes is below which multiple, and notes."""
    if not any(curve.fits for curve in found):
        return ""
    rows = []
    for curve in found:
        for metric in SUMMARISED:
            texts = {"error": ERROR_NAMES[metric], SLOPE: slope_text(curve, metric)}
            for name, each in QUANTILE_COLUMNS.items():
                texts[name] = estimate_text(curve.fit(metric, each), name != WORST_LANE)
            texts[POWER] = estimate_text(curve.exponents.get(metric))
            rows.append((curve, texts))
    table, labels = group_columns(rows)
    shown = fitted_columns(table, labels, SLOPES_DROP_ORDER)
    lines = [filled(SLOPES_TITLE), fitted_text(table, labels, SLOPES_DROP_ORDER, "fit.csv")]
    told = [str(text) for values in shown.values() for text in values]
    independent = results.study.config.draws == "random"
    needed = (
        words
        for name, words in LANES_NEEDED.items()
        if any(NO_INTERVAL in str(text) for text in shown.get(name, ()))
    )
    missing = TOO_FEW + "; ".join(needed) if independent else OF_SEQUENCES
    notes = SLOPE_NOTES | {NO_INTERVAL: missing}
    lines += [filled(note) for text, note in notes.items() if any(text in t for t in told)]
    draws = [whole_draws(results, curve.group) for curve in found]
    if independent and all(draws) and {*shown.get(WORST_LANE, ())} - {"-"}:
        share = number_text(100 * intervals.below_greatest(min(draws)), whole=100.0)
        words = f"{WORST_LANE}: of the {count_between(draws, 'lane')} of each ā"
        below = f"at least {share} % of all possible lanes are below, with 95 % confidence"
        lines.append(filled(f"{words}; {below}"))
    return "\n".join(lines)


def slope_text(curve: Curve, metric: str) -> str:
    """How the mean error depends on ā: its slope, or why it has none."""
    if not curve.ended.any():
        return "all lanes failed"
    if curve.is_flat(metric):
        return NO_EFFECT
    if curve.is_bent(metric):
        return NOT_PROPORTIONAL
    alone = curve.fits and curve.ended.sum() == 1
    known = curve.fits.get((metric, None)) if alone else curve.fit(metric)
    told, most = estimate_text(known), curve.fits.get((metric, ENVELOPE))
    if known and most and most[0] - known[0] <= intervals.ROUNDING_SPREAD * most[0]:
        told = told.replace(NO_INTERVAL, ALIKE)
    return ONE_MAGNITUDE * bool(alone) + told


def group_columns(
    rows: Sequence[tuple[Curve, dict[str, Any]]],
) -> tuple[dict[str, list[Any]], list[str]]:
    """Columns of a table of groups, and the names of swept keys; values read as in `show`."""
    named = [worded(curve.group.labels) for curve, _ in rows]
    whole = [labels | told for labels, (_, told) in zip(named, rows, strict=True)]
    return {name: [row[name] for row in whole] for name in whole[0]}, list(named[0])


def estimate_text(found: Fit | None, has_ends: bool = True) -> str:
    """An estimate with its interval, [-] if it could have one but has none; or a dash for None."""
    if found is None:
        return "-"
    estimate, low, high = (number_text(without_rounding(each, 1.0)) for each in found)
    ends = f" [{low}, {high}]" if np.isfinite(found[1]) else f" {NO_INTERVAL}"
    return estimate + ends * has_ends


def group_ratios(curve: Curve) -> dict[str, float]:
    """The worst error per ā, and each bound over it: of a bound of 0, which proves that, 0."""
    over = 0.0 if curve.worst <= LEAST_UNRECOVERED else curve.worst
    slopes = {name: curve.slope(*bound) for name, bound in BOUND_COLUMNS.items()}
    ratios = {k: each and (each / over if over else each * np.inf) for k, each in slopes.items()}
    return {"worst error / ā": without_rounding(curve.worst, 1.0)} | ratios


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
    attacked = sum(cell.scenario.attack.present for cell in cells)
    if not lines and sum(map(len, unchecked(cells).values())) < attacked:
        lines.append("no lane is above its bound of theory")
    if words := unchecked_words(cells):
        lines.append(filled(f"no bound is known for {words}"))
    if unclipped := unclipped_words(results):
        lines.append(filled(unclipped))
    return "\n".join(lines)
