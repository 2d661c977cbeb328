"""Output of `jaxnet fit`: the ultimate error per ā, simulated and fitted, and its bounds."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnet.config.naming import quantity, value_alone
from jaxnet.statistics.curves import NO_SLOPE, Curve, Fit, curves, no_magnitudes
from jaxnet.statistics.falling import falling_words
from jaxnet.statistics.fits import ENVELOPE, NO_SLOPE_INTERVAL, whole_draws
from jaxnet.statistics.intervals import below_greatest
from jaxnet.statistics.limits import unchecked_words
from jaxnet.statistics.summary import SUMMARISED
from jaxnet.store.results import Results
from jaxnet.view.columns import without_rounding
from jaxnet.view.text.printer import fitted_text
from jaxnet.view.text.tables import lane_title
from jaxnet.view.text.width import filled

MOST_VIOLATIONS = 20
LEAST_UNRECOVERED = 1e-6  # of ā; less is a transient or rounding
SLOPE_QUANTILES = {"mean": None, "median": 0.5, "95 %": 0.95, "envelope": ENVELOPE}
SLOPES_DROP_ORDER = (("p",), ("95 %",), ("median",), ("envelope",))
# Of one vehicle, the worst; of the fleet, the norm of all vehicles' errors.
BOUND_COLUMNS = {
    "static": ("static", "worst"),
    "peak gain": ("peak_gain", "worst"),
    "star norm": ("star_norm", "worst"),
    **{
        f"{kind} {vehicle}": (f"lyapunov_{kind}", vehicle)
        for kind in ("printed", "corrected", "best")
        for vehicle in ("worst", "fleet")
    },
}
BOUNDS_DROP_ORDER = tuple(
    (name,)
    for name in (
        *("printed fleet", "corrected fleet", "best fleet", "printed worst"),
        *("corrected worst", "star norm", "best worst"),
    )
)


def fit_text(results: Results) -> str:
    found = curves(results)
    parts = [slopes_text(results, found)]
    if results.file("bounds.csv").exists():
        title = "each bound over the worst error found, of the worst vehicle or of the whole fleet"
        rows = [(curve, group_ratios(curve)) for curve in found]
        parts.append(group_table(title, rows, BOUNDS_DROP_ORDER, "bounds.csv"))
    if results.file("violations.csv").exists():
        parts.append(violations_text(results))
    parts += map(filled, (no_magnitudes(found), falling_words(results, results.study.cells)))
    return "\n\n".join(filter(None, parts))


def slopes_text(results: Results, found: Sequence[Curve]) -> str:
    """Slopes s of s·ā with 95 % intervals, the exponent p of c·ā^p, and notes on blanks."""
    told, rows = [], []
    for curve in found:
        for metric in SUMMARISED:
            fits = {name: curve.fit(metric, each) for name, each in SLOPE_QUANTILES.items()}
            told += [(name, fit) for name, fit in fits.items() if fit is not None]
            texts = {name: slope_interval_text(fit) for name, fit in fits.items()}
            texts["p"] = slope_interval_text(curve.exponents.get(metric))
            rows.append((curve, {"metric": metric} | texts))
    title = "ultimate error per ā: slopes s of s·ā with 95 % intervals, and the exponent p of c·ā^p"
    lines = [group_table(title, rows, SLOPES_DROP_ORDER, "fit.csv")]
    if any(curve.is_flat(metric) for curve in found for metric in SUMMARISED):
        lines.append(filled(NO_SLOPE))
    if any(name != "envelope" and np.isnan(fit[1:]).any() for name, fit in told):
        lines.append(filled(NO_SLOPE_INTERVAL))
    independent = results.study.config.draws == "random"
    draws = independent and min(whole_draws(results, curve.group) for curve in found)
    if draws and any(name == "envelope" for name, _ in told):
        words = (
            f"envelope: with 95 % confidence at least {below_greatest(draws):.2%} of all draws stay"
            f" below it at every ā simulated ({draws} draws)"
        )
        lines.append(filled(words))
    return "\n".join(lines)


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


def slope_interval_text(found: Fit | None) -> str:
    """An estimate with its interval, or a dash for None."""
    if found is None:
        return "-"
    estimate, low, high = (without_rounding(each, 1.0) for each in found)
    ends = f" ({low:.4g} to {high:.4g})" if np.isfinite(low) else ""
    return f"{estimate:.4g}{ends}"


def group_ratios(curve: Curve) -> dict[str, float]:
    """The worst error per ā, and the ratio of each bound to it: NaN where all lanes recovered."""
    over = curve.worst if curve.worst > LEAST_UNRECOVERED else np.nan
    return {"worst error / ā": without_rounding(curve.worst, 1.0)} | {
        name: curve.slope(*bound) / over for name, bound in BOUND_COLUMNS.items()
    }


def violations_text(results: Results) -> str:
    found: Any = results.violations
    lines = [
        f"VIOLATION: {lane_title(results, row.cell, row.sample)}:\n"
        f"  tail_max {row.tail_max:.6g} m is over {row.bound}, {row.limit:.6g} m\n  {row.command}"
        for row in found.head(MOST_VIOLATIONS).itertuples()
    ]
    if len(found) > MOST_VIOLATIONS:
        lines.append(f"… {len(found) - MOST_VIOLATIONS} more in {results.file('violations.csv')}")
    lines = lines or ["no lane is above a bound that claims to hold for it"]
    if unchecked := unchecked_words(results.study.cells):
        lines.append(filled(f"no bound is known for {unchecked}"))
    return "\n".join(lines)
