"""Output of `jaxnet fit`: the ultimate error per ā, simulated and fitted, and its bounds."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.naming import quantity, value_alone
from jaxnet.statistics.curves import NO_SLOPE, Curve, curves, no_magnitudes, stored_table
from jaxnet.statistics.fits import NO_CURVE_INTERVAL, whole_draws
from jaxnet.statistics.groups import Group
from jaxnet.statistics.intervals import below_greatest
from jaxnet.statistics.limits import unchecked_words
from jaxnet.statistics.regression import ENVELOPE
from jaxnet.statistics.summary import SUMMARISED
from jaxnet.store.results import Results
from jaxnet.view.columns import without_rounding
from jaxnet.view.text.printer import Narrowing, fitted_text
from jaxnet.view.text.tables import lane_title
from jaxnet.view.text.width import MOST_ROWS, filled, left_out_note

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
    parts = [slopes_text(results)]
    parts += [conservatism_text(results)] if (results.path / "bounds.csv").exists() else []
    parts += [violations_text(results)] if (results.path / "violations.csv").exists() else []
    parts += [filled(no_magnitudes(curves(results)))]
    return "\n\n".join(filter(None, parts))


def slopes_text(results: Results) -> str:
    """Slopes s of s·ā with 95 % intervals, and the exponent p of c·ā^p."""
    fits, found = stored_table(results, "fit"), curves(results)
    rows = []
    for curve in found:
        for metric in SUMMARISED:
            slopes = {
                name: slope_interval_text(curve.fit(metric, quantile))
                for name, quantile in SLOPE_QUANTILES.items()
            }
            exponent = power_exponent(fits.of(curve.group.labels), metric)
            told = {"metric": metric, **slopes, "p": slope_interval_text(exponent)}
            rows.append({**curve.group.labels, **told})
    title = "ultimate error per ā: slopes s of s·ā with 95 % intervals, and the exponent p of c·ā^p"
    lines = [group_table(title, pd.DataFrame(rows), found[0].group, SLOPES_DROP_ORDER, "fit.csv")]
    if any(curve.is_flat(metric) for curve in found for metric in SUMMARISED):
        lines.append(filled(NO_SLOPE))
    told = fits.rows["model"].eq("proportional") & fits.rows["quantile"].ne(ENVELOPE)
    ends: Any = fits.rows.loc[told & fits.rows["estimate"].notna(), ["low", "high"]]
    if ends.isna().any(axis=None):
        lines.append(filled(NO_CURVE_INTERVAL))
    alone = results.study.config.draws == "random"
    draws = alone and min(whole_draws(results, curve.group) for curve in found)
    if draws and any(curve.fit(metric, ENVELOPE) for curve in found for metric in SUMMARISED):
        words = (
            f"envelope: with 95 % confidence at least {below_greatest(draws):.2%} of all draws stay"
            f" below it at every ā simulated ({draws} draws)"
        )
        lines.append(filled(words))
    return "\n".join(lines)


def group_table(
    title: str, table: pd.DataFrame, group: Group, steps: Sequence[Narrowing], file: str
) -> str:
    """Titled table of groups, no wider than a terminal; swept values read as in `show`."""
    names = {key: quantity(key) for key in group.labels}
    worded = {
        key: [value_alone(key, each) if isinstance(each, str) else each for each in table[key]]
        for key in names
    }
    named = table.assign(**worded).rename(columns=names).head(MOST_ROWS)
    text, left_out = fitted_text(named, list(names.values()), steps)
    lines = [filled(title), text]
    if len(table) > MOST_ROWS:
        lines.append(f"… {len(table) - MOST_ROWS} more lines; all are in {file}")
    return "\n".join([*lines, *left_out_note(left_out, file)])


def power_exponent(fits: pd.DataFrame, metric: str) -> tuple[float, float, float] | None:
    """Exponent p of the least-squares power law with its interval, or None."""
    mine: Any = fits[
        (fits["metric"] == metric) & (fits["parameter"] == "p") & fits["quantile"].isna()
    ]
    return tuple(mine[["estimate", "low", "high"]].iloc[0]) if len(mine) else None


def slope_interval_text(found: tuple[float, float, float] | None) -> str:
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


def conservatism_text(results: Results) -> str:
    title = "each bound over the worst error found, of the worst vehicle or of the whole fleet"
    found = curves(results)
    rows = pd.DataFrame([curve.group.labels | group_ratios(curve) for curve in found])
    return group_table(title, rows, found[0].group, BOUNDS_DROP_ORDER, "bounds.csv")


def violations_text(results: Results) -> str:
    found: Any = results.violations
    lines = [
        f"VIOLATION: {lane_title(results, row)}:\n"
        f"  tail_max {row.tail_max:.6g} m is over {row.bound}, {row.limit:.6g} m\n  {row.command}"
        for row in found.head(MOST_VIOLATIONS).itertuples()
    ]
    if len(found) > MOST_VIOLATIONS:
        lines.append(f"… {len(found) - MOST_VIOLATIONS} more in {results.file('violations.csv')}")
    lines = lines or ["no lane is above a bound that claims to hold for it"]
    if unchecked := unchecked_words(results.study.cells):
        lines.append(filled(f"no bound is known for {unchecked}"))
    return "\n".join(lines)
