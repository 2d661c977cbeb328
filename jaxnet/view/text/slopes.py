"""Output of `jaxnet fit`: the ultimate error per ā, simulated and fitted, and its bounds."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnet.config.naming import quantity, value_alone
from jaxnet.model.wording import number_text
from jaxnet.statistics.curves import BOUND_NAMES, NO_SLOPE, Curve, Fit, curves, no_magnitudes
from jaxnet.statistics.falling import falling_words
from jaxnet.statistics.fits import ENVELOPE, NO_SLOPE_INTERVAL, whole_draws
from jaxnet.statistics.intervals import below_greatest
from jaxnet.statistics.limits import unchecked_words, unclipped_words
from jaxnet.statistics.summary import SUMMARISED
from jaxnet.store.results import Results
from jaxnet.view.columns import without_rounding
from jaxnet.view.text.printer import fitted_text
from jaxnet.view.text.tables import lane_title
from jaxnet.view.text.width import filled

MOST_VIOLATIONS = 20
LEAST_UNRECOVERED = 1e-6  # of ā; less is a transient or rounding
QUANTILE_COLUMNS = {"half of the lanes below": 0.5, "95 % below": 0.95, "all below": ENVELOPE}
ERROR_NAMES = {"tail_mean": "mean error", "tail_max": "greatest error"}
POWER = "power p of c ā^p"
SLOPES_DROP_ORDER = tuple((name,) for name in (POWER, *QUANTILE_COLUMNS))
BOUND_COLUMNS = {name: (bound, "worst") for bound, name in BOUND_NAMES.items()}
BOUND_COLUMNS |= {
    f"{name}, fleet": (bound, "fleet") for bound, name in BOUND_NAMES.items() if "lyapunov" in bound
}
BOUNDS_DROP_ORDER = tuple((name,) for name in reversed(BOUND_COLUMNS))
BOUNDS_LEGEND = (
    "bounds of any one vehicle; fleet: of all vehicles' errors together; as printed: with the"
    " paper's constant, which is false in general; a dash: no bound is known, or the error is 0"
)


def fit_text(results: Results) -> str:
    found = curves(results)
    parts = [slopes_text(results, found)]
    if results.file("bounds.csv").exists():
        title = "bounds of theory, as multiples of the worst error found"
        rows = [(curve, group_ratios(curve)) for curve in found]
        if any(np.isfinite(row[name]) for _, row in rows for name in BOUND_COLUMNS):
            table = group_table(title, rows, BOUNDS_DROP_ORDER, "bounds.csv")
            parts.append(f"{table}\n{filled(BOUNDS_LEGEND)}")
    if results.file("violations.csv").exists():
        parts.append(violations_text(results))
    parts += map(filled, (no_magnitudes(found), falling_words(results, results.study.cells)))
    return "\n\n".join(filter(None, parts))


def slopes_text(results: Results, found: Sequence[Curve]) -> str:
    """The error as a multiple of ā, what share of lanes is below which multiple, and notes."""
    told, rows = [], []
    for curve in found:
        for metric in SUMMARISED:
            fits = {name: curve.fit(metric, each) for name, each in QUANTILE_COLUMNS.items()}
            told += [(name, fit) for name, fit in fits.items() if fit is not None]
            texts = {"": ERROR_NAMES[metric], "mean of the lanes": law_text(curve, metric)}
            texts |= {name: estimate_text(fit, " ā") for name, fit in fits.items()}
            texts[POWER] = estimate_text(curve.exponents.get(metric))
            rows.append((curve, texts))
    if not any(curve.fits for curve in found):
        return ""
    title = (
        "how errors over the tail depend on ā: the mean of the fleet, the greatest of any vehicle;"
        " in brackets 95 % intervals"
    )
    lines = [group_table(title, rows, SLOPES_DROP_ORDER, "fit.csv")]
    if any(curve.is_flat(metric) for curve in found for metric in SUMMARISED):
        lines.append(filled(NO_SLOPE))
    if any(QUANTILE_COLUMNS[name] != ENVELOPE and np.isnan(fit[1:]).any() for name, fit in told):
        lines.append(filled(NO_SLOPE_INTERVAL))
    independent = results.study.config.draws == "random"
    draws = independent and min(whole_draws(results, curve.group) for curve in found)
    if draws and any(QUANTILE_COLUMNS[name] == ENVELOPE for name, _ in told):
        share = number_text(100 * below_greatest(draws), whole=100.0)
        words = (
            f"all below: the {draws} lanes of each ā are; at least {share} % of all possible lanes,"
        )
        words += " with 95 % confidence"
        lines.append(filled(words))
    return "\n".join(lines)


def law_text(curve: Curve, metric: str) -> str:
    """How the mean error depends on ā, in words."""
    if curve.is_flat(metric):
        return "no effect of ā"
    if curve.is_bent(metric):
        return "not proportional to ā"
    if len(curve.cells) == 1:  # one ā is no fit
        return f"error / ā = {estimate_text(curve.fit(metric))}"
    told = estimate_text(curve.fit(metric), " ā").replace(" (", ", 95 % ").rstrip(")")
    return told if told == "-" else f"error = {told}"


def group_table(
    title: str,
    rows: Sequence[tuple[Curve, dict[str, Any]]],
    steps: Sequence[Sequence[str]],
    file: str,
) -> str:
    """Titled table of groups, no wider than a terminal; swept values read as in `show`."""
    named = [
        {
            quantity(key): value_alone(key, value) if isinstance(value, str) else value
            for key, value in curve.group.labels.items()
        }
        for curve, _ in rows
    ]
    whole = [labels | told for labels, (_, told) in zip(named, rows, strict=True)]
    table = {name: [row[name] for row in whole] for name in whole[0]}
    return f"{filled(title)}\n{fitted_text(table, list(named[0]), steps, file)}"


def estimate_text(found: Fit | None, unit: str = "") -> str:
    """An estimate with its interval, or a dash for None."""
    if found is None:
        return "-"
    estimate, low, high = (number_text(without_rounding(each, 1.0)) for each in found)
    return f"{estimate}{unit}" + (f" ({low} to {high})" if np.isfinite(found[1]) else "")


def group_ratios(curve: Curve) -> dict[str, float]:
    """The worst error per ā, and the ratio of each bound to it: NaN where all lanes recovered."""
    over = curve.worst if curve.worst > LEAST_UNRECOVERED else np.nan
    return {"worst error / ā": without_rounding(curve.worst, 1.0)} | {
        name: curve.slope(*bound) / over for name, bound in BOUND_COLUMNS.items()
    }


def violations_text(results: Results) -> str:
    found: Any = results.violations
    lines = [
        f"ABOVE ITS BOUND: {lane_title(results, row.cell, row.sample)}:\n"
        f"  greatest error {row.tail_max:.6g} m, bound {row.limit:.6g} m ({row.bound})\n"
        f"  {row.command}"
        for row in found.head(MOST_VIOLATIONS).itertuples()
    ]
    if len(found) > MOST_VIOLATIONS:
        lines.append(f"… {len(found) - MOST_VIOLATIONS} more in {results.file('violations.csv')}")
    lines = lines or ["no lane is above its bound of theory"]
    if unchecked := unchecked_words(results.study.cells):
        lines.append(filled(f"no bound is known for {unchecked}"))
    if unclipped := unclipped_words(results):
        lines.append(filled(unclipped))
    return "\n".join(lines)
