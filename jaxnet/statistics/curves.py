"""Data of the figures and the page: δ̂(ā) with bounds and fits, and the share unrecovered.

`jaxnet fit` writes `bounds.csv` and `fit.csv`. Without these the data has no bounds or fits.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float

from jaxnet.config.cells import Cell
from jaxnet.kinds.fields import is_drawn
from jaxnet.kinds.metrics import LANE_STATISTICS
from jaxnet.model.wording import orders_in_words
from jaxnet.statistics.amplitude import LEAST_UNRECOVERED, attack_size
from jaxnet.statistics.groups import Group, attacked_groups, labels_without_magnitude
from jaxnet.store import rows
from jaxnet.store.results import Results
from jaxnet.store.tables import COLUMNS, read_table

MOST_PANELS = 24  # of one figure
LOG_FLOOR = 1e-9  # the least that a log axis shows: smaller errors [m], or per ā, are rounding
GREATEST_SHOWN = 1e100  # [m] end of a log axis, 1 over it the other end; beyond, the ticks overflow
SHARE_COLUMNS = ["unrecovered", "unrecovered_low", "unrecovered_high"]
METRIC_NAMES = {"tail_max": "greatest error of any vehicle", "tail_mean": "mean error of the fleet"}
NEARLY = 1.2  # times one another
BOUND_NAMES = {
    "static": "static",
    "harmonic": "harmonic",
    "peak_gain": "peak gain",
    "star_norm": "star norm",
    "lyapunov_best": "Lyapunov, best Q",
    "lyapunov_corrected": "Lyapunov, corrected",
    "lyapunov_printed": "Lyapunov, as printed (false)",
}
Fit = tuple[float, float, float]  # a parameter and the ends of its interval


class Curve(NamedTuple):
    """Errors of one group against ā > 0, with bounds and fits as lines s·ā.

    `cells` contains rows of `cells.csv`, indexed by ā.
    """

    group: Group
    cells: pd.DataFrame
    bounds: Mapping[tuple[str, str], float]  # slope by bound and vehicle (1 to m, worst, fleet)
    fits: Mapping[tuple[str, float | None], Fit]  # by metric and quantile (None: least squares)
    exponents: Mapping[str, Fit]  # p of c·ā^p by metric

    @property
    def sizes(self) -> Float[np.ndarray, " cells"]:
        """Magnitudes ā in ascending order [m]."""
        return self.cells.index.to_numpy(dtype=float)

    def spread(self, metric: str, *names: str) -> list[Float[np.ndarray, " cells"]]:
        return [self.cells[f"{metric}_{name}"].to_numpy(dtype=float) for name in names]

    @property
    def ended(self) -> Bool[np.ndarray, " cells"]:
        """The magnitudes at which any lane ended."""
        return np.isfinite(self.spread("tail_max", "max")[0])

    @property
    def worst(self) -> float:
        """Greatest error of any vehicle in any lane, per ā."""
        return float(np.fmax.reduce(self.spread("tail_max", "max")[0] / self.sizes))

    def slope(self, bound: str, vehicle: str) -> float:
        """A bound per ā; not-a-number where the bound says nothing."""
        return self.bounds.get((bound, vehicle), np.nan)

    def limits(self, metric: str) -> dict[str, float]:
        """Finite bounds per ā: on `tail_mean` of the mean over vehicles, else of the worst."""
        found = {}
        for bound in BOUND_NAMES:
            slopes = [self.slope(bound, "worst")]
            if metric == "tail_mean":
                each = self.bounds.items()
                slopes = [s for (name, of), s in each if name == bound and of.isdigit()]
            if slopes and np.isfinite(slopes).all():
                found[bound] = float(np.mean(slopes))
        return found

    def fit(self, metric: str, quantile: float | None = None) -> Fit | None:
        """Slope s and its ends by least squares or at a quantile; None where there is no slope.

        Errors that are not proportional to ā have none, nor has a single magnitude.
        """
        found = self.fits.get((metric, quantile))
        if found is None or np.isnan(found[0]) or self.is_bent(metric):
            return None
        return found if self.ended.sum() > 1 else None

    def is_flat(self, metric: str) -> bool:
        found = self.fits.get((metric, None))
        return found is not None and bool(np.isnan(found[0]))

    def is_bent(self, metric: str) -> bool:
        """Whether errors are not proportional to ā, so that no slope tells of them.

        The means decide if all have intervals, else the medians. Cells of which more lanes failed
        than ended do not count.
        """
        kept = self.ended & (self.cells["ok"] >= self.cells["failed"]).to_numpy()
        means, medians = (
            [each[kept] / self.sizes[kept] for each in self.spread(metric, *names.columns)]
            for names in (LANE_STATISTICS["mean"], LANE_STATISTICS["median"])
        )
        values = medians if np.isnan(means[1]).any() else means
        floored = (np.where(each < LEAST_UNRECOVERED, 0.0, each) for each in values)
        return kept.sum() > 1 and not is_proportional(*floored)


def is_proportional(values: Any, low: Any, high: Any) -> bool:
    """Whether errors per ā are the same but for their intervals, or nearly so."""
    low, high = (np.where(np.isnan(end), values, end) for end in (low, high))
    return bool(max(low) <= min(high) or max(values) <= NEARLY * min(values))


def curves(results: Results, of: Sequence[Cell] | None = None) -> list[Curve]:
    """Return a curve for each group of attacked cells whose ā is not drawn.

    `of` restricts the groups to some cells. Raises FolderError for an unfinished run.
    """
    cells, found = results.cells, []
    bounds, fits = rows_by_group(results, "bounds"), rows_by_group(results, "fit")
    for group in attacked_groups(results.study.cells if of is None else of):
        if not group.attacked:
            continue
        labels = canonical_values(group.labels.values())
        mine = cells.iloc[list(group.attacked)].set_axis(list(group.attacked.values()))
        slopes = {(row.bound, str(row.vehicle)): row.slope for row in bounds.get(labels, [])}
        fitted, exponents = {}, {}
        for row in fits.get(labels, []):
            fit = (row.estimate, row.low, row.high)
            quantile = None if np.isnan(row.quantile) else row.quantile
            if row.model == "proportional":
                fitted[row.metric, quantile] = fit
            elif (row.parameter, quantile) == ("p", None):
                exponents[row.metric] = fit
        found.append(Curve(group, mine, slopes, fitted, exponents))
    return found


def rows_by_group(results: Results, name: str) -> dict[tuple[str, ...], list[Any]]:
    """Rows of `bounds.csv` or `fit.csv` by the labels of their group; none without the file."""
    file, keys = results.file(f"{name}.csv"), [*labels_without_magnitude(results.study.cells[0])]
    if not file.exists():
        return {}
    table, columns = read_table(file, labels=keys), COLUMNS[file.name].split()
    labels = zip(*(table[key] for key in keys), strict=True) if keys else [()] * len(table)
    found: dict[tuple[str, ...], list[Any]] = {}
    for values, row in zip(labels, table[columns].itertuples(), strict=True):
        found.setdefault(canonical_values(values), []).append(row)
    return found


def canonical_values(values: Any) -> tuple[str, ...]:
    return tuple(map(canonical_value, values))


def canonical_value(value: Any) -> str:
    """A text that is equal for equal swept values, as 1, 1.0 and the text "1" of a CSV file are."""
    try:
        return repr(float(value))
    except (TypeError, ValueError):
        return str(value)


def log_ends(*values: Any) -> tuple[float, float]:
    """Powers of ten around all finite values, as a log axis shows them: its ends."""
    known = np.concatenate([np.ravel(np.asarray(each, dtype=float)) for each in values])
    shown = np.clip(known[np.isfinite(known)], LOG_FLOOR, GREATEST_SHOWN)
    least, most = (shown.min(), shown.max()) if shown.size else (LOG_FLOOR, LOG_FLOOR)
    first, last = np.floor(np.log10(least)), np.ceil(np.log10(most))
    return float(10.0**first), float(10.0 ** max(last, first + 1))


def no_magnitudes(found: Sequence[Curve]) -> str:
    """Say why there is no axis for ā; empty if there is one."""
    if not any(len(curve.cells) > 1 for curve in found):
        return "No two cells differ in ā > 0 alone: no curve δ̂(ā) of errors against ā is drawn."
    if not any(curve.ended.any() for curve in found):
        return "No attacked lane came to its end: no curve δ̂(ā) of errors against ā is drawn."
    sizes = np.concatenate([curve.sizes for curve in found])
    if sizes.min() < 1 / GREATEST_SHOWN or sizes.max() > GREATEST_SHOWN:
        ends = f"{sizes.min():.3g} to {sizes.max():.3g} m"
        room = f"{1 / GREATEST_SHOWN:g} to {GREATEST_SHOWN:g} m"
        return f"ā is {ends}: an axis has room for {room}, so δ̂(ā) is not drawn."
    return ""


def unrecovered_shares(results: Results) -> pd.DataFrame:
    """Share unrecovered and the ends of its interval, by number of the cell, where there is one."""
    return results.cells.reindex(columns=SHARE_COLUMNS).dropna()


def failed_kinds(results: Results) -> dict[int, Counter[str]]:
    if not results.manifest["lanes"]["failed"]:
        return {}
    found = results.by_cell("status", where=~rows.OK)
    return {number: Counter(map(str, failed["status"])) for number, failed in found}


def mostly_failed(results: Results) -> list[int]:
    """Cells of which more lanes failed than ended: few lanes stand for none of them."""
    table: Any = results.cells
    return np.flatnonzero(table["failed"] > table["ok"]).tolist()


def cell_magnitudes(results: Results) -> Float[np.ndarray, " cells"]:
    """ā of each cell [m]; not-a-number without an attack and where ā is drawn."""
    return np.array([attack_size(cell) for cell in results.study.cells])


def magnitude_words(cell: Cell) -> str:
    amount, sizes = cell.scenario.attack.amplitude(), cell.scenario.attack.by_order()
    if sizes is not None and amount:
        return f"ā = ({orders_in_words(sizes)})"
    if is_drawn(amount):
        return "ā drawn"
    return f"ā = {amount:.3g} m" if amount else "no attack"
