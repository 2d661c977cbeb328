"""Output of `jaxnet fit`: the ultimate error per ā, simulated and fitted, and its bounds."""

from collections.abc import Sequence
from functools import partial
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.naming import quantity, value_alone
from jaxnet.statistics.curves import (
    METRIC_NAMES,
    NO_SLOPE,
    Curve,
    curves,
    no_magnitudes,
    stored_table,
)
from jaxnet.statistics.fits import ENVELOPE, NO_CURVE_INTERVAL, whole_draws
from jaxnet.statistics.groups import Group, Label
from jaxnet.statistics.limits import unchecked_words
from jaxnet.statistics.recovery import below_greatest
from jaxnet.store.results import Results
from jaxnet.view.columns import without_rounding
from jaxnet.view.text.tables import lane_title
from jaxnet.view.text.width import MOST_ROWS, fit_terminal, table_notes, table_text, terminal_width

MOST_VIOLATIONS = 20
LEAST_UNRECOVERED = 1e-6  # of ā; less is a transient or rounding
SLOPE_QUANTILES = {"mean": None, "median": 0.5, "95 %": 0.95, "envelope": 1.0}
SLOPES_DROP_ORDER = (("p",), ("95 %",), ("median",), ("envelope",))
BOUNDS_DROP_ORDER = tuple(
    (name,) for name in ("printed fleet", "corrected fleet", "best fleet", "printed worst")
)
BOUNDS_DROP_ORDER += (("corrected worst",), ("star norm",), ("best worst",))
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


def fit_text(results: Results) -> str:
    """Return fits, bounds and violations, as far as they are stored."""
    undrawn = fill(no_magnitudes(curves(results)), terminal_width())
    parts = [slopes_text(results)]
    parts += [conservatism_text(results)] if (results.path / "bounds.csv").exists() else []
    parts += [violations_text(results)] if (results.path / "violations.csv").exists() else []
    return "\n\n".join(filter(None, [*parts, undrawn]))


def slopes_text(results: Results) -> str:
    """Return the slopes s of s·ā with 95 % intervals, and the exponent p of c·ā^p."""
    fits, found = stored_table(results, "fit"), curves(results)
    rows = [
        {**curve.group.labels, "metric": metric}
        | {
            name: slope_interval_text(curve.fit(metric, quantile))
            for name, quantile in SLOPE_QUANTILES.items()
        }
        | {"p": slope_interval_text(power_exponent(fits.of(curve.group.labels), metric))}
        for curve in found
        for metric in ("tail_mean", "tail_max")
    ]
    text = group_table(
        "ultimate error per ā: slopes s of s·ā with 95 % intervals, and the exponent p of c·ā^p",
        pd.DataFrame(rows),
        found[0].group,
        SLOPES_DROP_ORDER,
        "fit.csv",
    )
    if any(curve.is_flat(metric) for curve in found for metric in METRIC_NAMES):
        text += f"\n{fill(NO_SLOPE, terminal_width())}"
    told = (fits.rows["quantile"] != ENVELOPE) & (fits.rows["model"] != "constant")
    ends: Any = fits.rows.loc[told & fits.rows["estimate"].notna(), ["low", "high"]]
    if ends.isna().any(axis=None):
        text += f"\n{fill(NO_CURVE_INTERVAL, terminal_width())}"
    alone = results.study.config.draws == "random"
    draws = alone and min(whole_draws(results, curve.group) for curve in found)
    if draws and any(curve.fit(metric, ENVELOPE) for curve in found for metric in METRIC_NAMES):
        words = (
            f"envelope: with 95 % confidence at least {below_greatest(draws):.2%} of all draws stay"
            f" below it at every ā simulated ({draws} draws)"
        )
        text += f"\n{fill(words, terminal_width())}"
    return text


def group_table(
    title: str, table: pd.DataFrame, group: Group, least_wanted: Sequence[Sequence[str]], file: str
) -> str:
    """Return a titled table of groups, no wider than a terminal; swept values read as in `show`."""
    names = {key: quantity(key) for key in group.labels}
    worded: Any = table.assign(**{key: table[key].map(partial(shown_label, key)) for key in names})
    named = worded.rename(columns=names).head(MOST_ROWS)
    shown, left_out, is_cut = fit_terminal(named, list(names.values()), least_wanted)
    lines = [fill(title, terminal_width()), table_text(shown)]
    if len(table) > MOST_ROWS:
        lines.append(f"… {len(table) - MOST_ROWS} more lines; all are in {file}")
    return "\n".join([*lines, *table_notes(left_out, is_cut, file)])


def shown_label(key: str, label: Label) -> Label:
    """Return a swept value as tables show it: text in words, numbers as they are."""
    return value_alone(key, label) if isinstance(label, str) else label


def power_exponent(fits: pd.DataFrame, metric: str) -> tuple[float, float, float] | None:
    """Return the exponent p of the least-squares power law with its interval, or None."""
    mine: Any = fits[
        (fits["metric"] == metric) & (fits["parameter"] == "p") & fits["quantile"].isna()
    ]
    return tuple(mine[["estimate", "low", "high"]].iloc[0]) if len(mine) else None


def slope_interval_text(found: tuple[float, float, float] | None) -> str:
    """Return an estimate with its interval, or a dash for None."""
    if found is None:
        return "-"
    estimate, low, high = (without_rounding(each, 1.0) for each in found)
    if not np.isfinite(low):
        return f"{estimate:.4g}"
    return (
        f"{estimate:.4g} ({low:.4g} to {high:.4g})"
        if np.isfinite(high)
        else f"{estimate:.4g} ({low:.4g} -)"
    )


def bound_ratios(results: Results) -> pd.DataFrame:
    """Return, by group, the worst error per ā and the ratio of each bound to it.

    The ratios are NaN where all lanes recovered.
    """
    return pd.DataFrame([{**curve.group.labels} | group_ratios(curve) for curve in curves(results)])


def group_ratios(curve: Curve) -> dict[str, float]:
    """Return the worst error per ā of a group, and the ratio of each bound to it."""
    over = curve.worst if curve.worst > LEAST_UNRECOVERED else np.nan
    return {"worst error / ā": without_rounding(curve.worst, 1.0)} | {
        name: curve.slope(*bound) / over for name, bound in BOUND_COLUMNS.items()
    }


def conservatism_text(results: Results) -> str:
    """Return the ratios of bounds to the worst error found, as a table."""
    title = "each bound over the worst error found, of the worst vehicle or of the whole fleet"
    return group_table(
        title, bound_ratios(results), curves(results)[0].group, BOUNDS_DROP_ORDER, "bounds.csv"
    )


def violations_text(results: Results) -> str:
    """Return the lanes above a bound that claims to hold for them."""
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
        lines.append(fill(f"no bound is known for {unchecked}", terminal_width()))
    return "\n".join(lines)
