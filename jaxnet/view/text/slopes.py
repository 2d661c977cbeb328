"""What `jaxnet fit` prints: the ultimate error per ā as simulated and fitted, and what theory allows."""

from collections.abc import Sequence
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.model.wording import cells_named
from jaxnet.statistics.curves import Curve, curves, group_rows, no_magnitudes, stored_table
from jaxnet.statistics.fits import ENVELOPE, NO_CURVE_INTERVAL, whole_draws
from jaxnet.statistics.groups import Group
from jaxnet.statistics.limits import UNCHECKED, unchecked_cells
from jaxnet.statistics.recovery import below_greatest
from jaxnet.store.results import Results
from jaxnet.view.text.tables import lane_named
from jaxnet.view.text.width import MOST_ROWS, WIDTH, as_lines, narrow, notes

MOST_VIOLATIONS = 20
RECOVERED = 1e-6  # of ā; less is a transient or rounding
QUANTILES = {"mean": None, "median": 0.5, "95 %": 0.95, "envelope": 1.0}
LEAST_SLOPES = (("p",), ("95 %",), ("median",), ("envelope",))
LEAST_BOUNDS = tuple((name,) for name in ("printed fleet", "corrected fleet", "best fleet", "printed worst"))
LEAST_BOUNDS += (("corrected worst",), ("star norm",), ("best worst",))
# Of one vehicle, the worst; of the fleet, the norm of all vehicles' errors.
BOUNDS = {
    "static": ("static", "worst"),
    "peak gain": ("peak_gain", "worst"),
    "star norm": ("star_norm", "worst"),
    **{
        f"{kind} {vehicle}": (f"lyapunov_{kind}", vehicle)
        for kind in ("printed", "corrected", "best")
        for vehicle in ("worst", "fleet")
    },
}


def text(results: Results) -> str:
    """All of it that there is."""
    undrawn = fill(no_magnitudes(curves(results)), WIDTH)
    parts = [slopes(results)]
    parts += [conservatism(results)] if (results.path / "bounds.csv").exists() else []
    parts += [violations(results)] if (results.path / "violations.csv").exists() else []
    return "\n\n".join(filter(None, [*parts, undrawn]))


def slopes(results: Results) -> str:
    """Slopes of s·ā with their 95 % intervals, and how straight the line is."""
    fits, found = stored_table(results, "fit"), curves(results)
    rows = [
        {**curve.group.labels, "metric": metric}
        | {name: interval(curve.fit(metric, quantile)) for name, quantile in QUANTILES.items()}
        | {"p": interval(exponent(group_rows(fits, curve.group.labels), metric))}
        for curve in found
        for metric in ("tail_mean", "tail_max")
    ]
    text = fitting(
        "ultimate error per ā: slopes s of s·ā with 95 % intervals, and the exponent p of c·ā^p",
        pd.DataFrame(rows),
        found[0].group,
        LEAST_SLOPES,
        "fit.csv",
    )
    if pd.isna(fits[["low", "high"]]).loc[fits["quantile"] != ENVELOPE].any(axis=None):
        text += f"\n{fill(NO_CURVE_INTERVAL, WIDTH)}"
    alone = results.study.config.draws == "random"
    draws = alone and min(whole_draws(results, curve.group) for curve in found)
    if draws:
        words = (
            f"envelope: with 95 % confidence at least {below_greatest(draws):.2%} of all draws stay"
            f" below it at every ā simulated ({draws} draws)"
        )
        text += f"\n{fill(words, WIDTH)}"
    return text


def fitting(
    title: str, table: pd.DataFrame, group: Group, least_wanted: Sequence[Sequence[str]], file: str
) -> str:
    """A table of groups with its title, no wider than a terminal."""
    shown, left_out, is_cut = narrow(table.head(MOST_ROWS), list(group.labels), least_wanted)
    lines = [fill(title, WIDTH), as_lines(shown)]
    if len(table) > MOST_ROWS:
        lines.append(f"… {len(table) - MOST_ROWS} more lines; all are in {file}")
    return "\n".join([*lines, *notes(left_out, is_cut, file)])


def exponent(fits: pd.DataFrame, metric: str) -> tuple[float, float, float] | None:
    """The power law's p by least squares, with its interval."""
    mine: Any = fits[(fits["metric"] == metric) & (fits["parameter"] == "p") & fits["quantile"].isna()]
    return tuple(mine[["estimate", "low", "high"]].iloc[0]) if len(mine) else None


def interval(found: tuple[float, float, float] | None) -> str:
    """An estimate with its interval, if there is one."""
    if found is None:
        return "-"
    estimate, low, high = found
    if not np.isfinite(low):
        return f"{estimate:.4g}"
    return (
        f"{estimate:.4g} ({low:.4g} to {high:.4g})" if np.isfinite(high) else f"{estimate:.4g} ({low:.4g} -)"
    )


def ratios(results: Results) -> pd.DataFrame:
    """Of each group the worst error found per ā, and each bound over it, blank where all lanes recovered."""
    return pd.DataFrame([{**curve.group.labels} | ratio_row(curve) for curve in curves(results)])


def ratio_row(curve: Curve) -> dict[str, float]:
    """Of one group."""
    over = curve.worst if curve.worst > RECOVERED else np.nan
    return {"worst error / ā": curve.worst} | {
        name: curve.slope(*bound) / over for name, bound in BOUNDS.items()
    }


def conservatism(results: Results) -> str:
    """The same as text."""
    title = "each bound over the worst error found, of the worst vehicle or of the whole fleet"
    return fitting(title, ratios(results), curves(results)[0].group, LEAST_BOUNDS, "bounds.csv")


def violations(results: Results) -> str:
    """Lanes above a bound that claims to hold for them."""
    found: Any = results.violations
    lines = [
        f"VIOLATION: {lane_named(results, row)}:\n"
        f"  tail_max {row.tail_max:.6g} m is over {row.bound}, {row.limit:.6g} m\n  {row.command}"
        for row in found.head(MOST_VIOLATIONS).itertuples()
    ]
    if len(found) > MOST_VIOLATIONS:
        lines.append(f"… {len(found) - MOST_VIOLATIONS} more in {results.file('violations.csv')}")
    lines = lines or ["no lane is above a bound that claims to hold for it"]
    skipped = unchecked_cells(results.study.cells)
    if skipped:
        lines.append(fill(f"not held to any bound: {cells_named(skipped)}, for {UNCHECKED}", WIDTH))
    return "\n".join(lines)
