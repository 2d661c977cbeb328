"""A quantity of lanes for each cell, with its interval: a share, or a statistic of a metric.

Shares have the exact interval of Clopper and Pearson, quantiles the exact interval of order statistics, which
holds for every distribution (David and Nagaraja, Order Statistics, 2003, section 7.1). The interval of a mean
is that of `cells.csv`; it needs a bound on every lane, and is blank without one.
"""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import pandas as pd
from jaxtyping import Float
from scipy import stats

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.keys import Config
from jaxnet.kinds.metrics import DETECTION, Metric
from jaxnet.model.wording import count
from jaxnet.statistics.amplitude import amplitude_note
from jaxnet.statistics.curves import LOG_FLOOR, decades, unrecovered_shares
from jaxnet.statistics.hull import HULL_COLUMNS, HULL_WORDS, hull_definition, hull_share
from jaxnet.statistics.recovery import (
    CONFIDENCE,
    clopper_pearson,
    confidence_told,
    share_definition,
    share_name,
)
from jaxnet.statistics.summary import UNBOUNDED, independent_units, metric_statistics, ranges_of
from jaxnet.store import rows
from jaxnet.store.folder import FolderError
from jaxnet.store.results import Results

Statistic = Literal["median", "mean", "q05", "q95", "max"]
STATISTIC_WORDS = {
    "median": "median of lanes",
    "mean": "mean of lanes",
    "q05": "5 % quantile of lanes",
    "q95": "95 % quantile of lanes",
    "max": "greatest of lanes",
}
LEAST_RATIO_OF_LOG = 30.0  # of the greatest and the least value, for a log axis
LEAST_SHARE_OF_LOG = 1e-5  # of the greatest value, the least that a log axis shows
SPREAD_WORDS = "spread: greatest distance of two vehicles that are not attacked"
AGREEMENT_NOTES = {
    "spread": f"{SPREAD_WORDS}, over the tail",
    "outside": "outside: greatest way of such a vehicle out of the convex hull of their starts",
}
QUANTILES = {"q05": 0.05, "median": 0.5, "q95": 0.95}


class Quantity(NamedTuple):
    """A number of each cell with an interval, and its words.

    `values` has the columns value, low and high by number of the cell; an end that is not known is
    not-a-number.
    """

    name: str
    words: str
    unit: str
    share: bool  # in percent
    confidence: float
    values: pd.DataFrame
    note: str = ""  # what the words leave open
    lanes: int = 0  # of each cell, 0 if the cells differ

    @property
    def known(self) -> Float[np.ndarray, " known"]:
        """The values that are known."""
        values = self.values["value"].to_numpy(dtype=float)
        return values[~np.isnan(values)]

    @property
    def log(self) -> bool:
        """Whether values belong on a log axis: a metric without negative values over more than a decade."""
        if self.share or not self.known.size:
            return False
        least, greatest = self.known.min(), self.known.max()
        return bool(least >= 0 and greatest > LOG_FLOOR and greatest >= LEAST_RATIO_OF_LOG * least)

    @property
    def floor(self) -> float:
        """Least value that a log axis shows; what is below is drawn there."""
        return max(LOG_FLOOR, LEAST_SHARE_OF_LOG * float(self.known.max()))

    @property
    def ends(self) -> tuple[float, float]:
        """Ends of an axis that holds all values and intervals."""
        if self.share:
            return 0.0, 100.0
        known = self.values[["value", "low", "high"]].to_numpy(dtype=float)
        known = known[np.isfinite(known)]
        if self.log:
            return decades(max(self.floor, known.min()), known.max())
        if (
            self.unit == "m" and np.abs(known).max() < LOG_FLOOR
        ):  # rounding needs no scale of its own
            return 0.0, 1.0
        return min(0.0, float(known.min())), float(known.max())

    @property
    def notes(self) -> str:
        """What a figure of the quantity has to say below its title."""
        known = self.values[["low", "high"]].notna().to_numpy().any()
        bars = f"bars: {100 * self.confidence:g} % intervals" if known else "no interval is known"
        below = self.log and self.known.min() < self.floor
        cut = f"values below {self.floor:.1g} {self.unit} are drawn there" if below else ""
        lanes = f"{count(self.lanes, 'lane')} a point" if self.lanes else ""
        return "; ".join(filter(None, [self.note, lanes, bars, cut]))

    @property
    def axis(self) -> str:
        """Label of an axis."""
        return f"{self.words} [{self.unit}]" if self.unit else self.words


def asked_quantity(study: Config) -> str:
    """Return the quantity that a study asks for: lanes unrecovered, its first own metric, or the tail's mean
    error.

    Shares of alarms, which every study with a detector has, are not asked for.
    """
    if study.recovery is not None:
        return "unrecovered"
    own = (metric.name for metric in study.metrics if metric.name not in DETECTION)
    return next(own, "tail_mean")


def known_quantities(study: Config) -> list[str]:
    """Return the names of quantities; a metric's name may end in a statistic."""
    shares = ["failed"] if study.recovery is None else ["unrecovered", "failed"]
    shares += ["in_hull"] * study.leaderless
    return [*shares, *(metric.name for metric in study.measured())]


def quantity_of(results: Results, cells: Sequence[Cell], name: str) -> Quantity:
    """Return a quantity of each of these cells.

    Parameters
    ----------
    results
        Results of a finished run.
    cells
        Cells of the study.
    name
        `unrecovered`, `failed`, `in_hull`, a metric (its median over the lanes that ended), or
        METRIC_STATISTIC with a statistic of median, mean, q05, q95 and max.

    Returns
    -------
    Quantity
        Shares in percent, metrics in their unit, each with its interval.

    Raises
    ------
    FolderError
        The name is unknown.
    """
    study = results.study.config
    confidence = confidence_told(study.samples)
    if name == "unrecovered" and study.recovery is not None:
        shares = unrecovered_shares(results, cells).reindex([cell.number for cell in cells])
        found: Any = 100 * shares.astype(float)
        table = found.set_axis(["value", "low", "high"], axis=1)
        reduced = amplitude_note(cells) if study.recovery.of == "magnitude" else ""
        note = "; ".join(filter(None, [share_definition(study.recovery, cells), reduced]))
        told = Quantity(name, f"lanes {share_name(cells)}", "%", True, confidence, table, note)
        return told._replace(lanes=lanes_of_each(results, table, "ok"))
    if name == "failed":
        table = failed_table(results, cells)
        told = Quantity(name, "lanes failed", "%", True, CONFIDENCE, table)
        return told._replace(lanes=lanes_of_each(results, table, "lanes"))
    if name == "in_hull" and any(cell.scenario.leaderless for cell in cells):
        table = hull_table(results, cells, confidence)
        told = Quantity(
            name, f"lanes {HULL_WORDS}", "%", True, confidence, table, hull_definition(cells)
        )
        return told._replace(lanes=lanes_of_each(results, table, "ok"))
    metric, statistic = metric_and_statistic(study, name)
    words = f"{metric.words or metric.name.replace('_', ' ')}, {STATISTIC_WORDS[statistic]}"
    if metric.over == "tail":
        words = f"{words.partition(',')[0]} over the tail,{words.partition(',')[2]}"
    table = statistic_table(results, cells, metric, statistic)
    note = AGREEMENT_NOTES.get(metric.name, "") if is_leaderless(cells) else ""
    told = Quantity(name, words, metric.column_unit, False, CONFIDENCE, table, note)
    return told._replace(lanes=lanes_of_each(results, table, "ok"))


def lanes_of_each(results: Results, table: pd.DataFrame, which: str) -> int:
    """Return the number of lanes behind each known value, 0 if the numbers differ."""
    known = table["value"].dropna().index.tolist()
    counts = set(results.cells.loc[known, which].tolist())
    return int(counts.pop()) if len(counts) == 1 else 0


def metric_and_statistic(study: Config, name: str) -> tuple[Metric, Statistic]:
    """Return the metric and the statistic of a name; raise FolderError if the study has no such metric."""
    metrics = {metric.name: metric for metric in study.measured()}
    if name in metrics:
        return metrics[name], "median"
    stem, _, statistic = name.rpartition("_")
    if stem in metrics and statistic in get_args(Statistic):
        return metrics[stem], statistic  # pyright: ignore[reportReturnType]
    raise FolderError(
        f"y: must be one of {', '.join(known_quantities(study))}, or a metric with _median, _mean, _q05, _q95"
        f" or _max (got {name})"
    )


def hull_table(results: Results, cells: Sequence[Cell], confidence: float) -> pd.DataFrame:
    """Return the share of lanes in the hull with its interval [%]."""
    wanted = {cell.number: cell for cell in cells}
    found = {
        number: hull_share(wanted[number], lanes["outside"].to_numpy(dtype=float), confidence)
        for number, lanes in results.by_cell("outside", where=rows.OK, cells=wanted)
    }
    table = pd.DataFrame.from_dict(found, orient="index", columns=HULL_COLUMNS, dtype=float)
    return 100 * table.set_axis(["value", "low", "high"], axis=1)


def failed_table(results: Results, cells: Sequence[Cell]) -> pd.DataFrame:
    """Return the share of failed lanes with its interval [%]."""
    table: Any = results.cells.loc[[cell.number for cell in cells]]
    failed, lanes = table["failed"].to_numpy(), table["lanes"].to_numpy()
    low, high = clopper_pearson(failed, lanes, CONFIDENCE)
    shares = {"value": failed / lanes, "low": low, "high": high}
    return 100 * pd.DataFrame(shares, index=table.index)


def statistic_table(
    results: Results, cells: Sequence[Cell], metric: Metric, statistic: Statistic
) -> pd.DataFrame:
    """Return a statistic of a metric over the lanes that ended, with its interval."""
    study, found = results.study.config, {}
    wanted = {cell.number: cell for cell in cells}
    for number, lanes in results.by_cell("sample", metric.name, where=rows.OK, cells=wanted):
        values, samples = lanes[metric.name].to_numpy(dtype=float), lanes["sample"].to_numpy()
        units = independent_units(study, samples)
        if statistic in QUANTILES:
            ends = (np.nan, np.nan)
            if units is None:
                ends = quantile_interval(values, QUANTILES[statistic], CONFIDENCE)
            found[number] = (np.quantile(values, QUANTILES[statistic]), *ends)
        elif statistic == "mean":
            within = ranges_of(study, wanted[number], samples.tolist()).get(metric.name, UNBOUNDED)
            told = metric_statistics(values, within, units)
            found[number] = told["mean"], told["low"], told["high"]
        else:
            found[number] = values.max(), np.nan, np.nan
    return pd.DataFrame.from_dict(
        found, orient="index", columns=["value", "low", "high"], dtype=float
    )


def quantile_interval(
    values: Float[np.ndarray, " n"], quantile: float, confidence: float
) -> tuple[float, float]:
    """Return an interval of a quantile from independent values, for every distribution.

    The ends are order statistics. An end is not-a-number if there are too few values for it.

    Examples
    --------
    >>> quantile_interval(np.arange(10.0), 0.5, 0.95)
    (1.0, 8.0)
    """
    ordered, tail = np.sort(values), (1.0 - confidence) / 2
    low, high = stats.binom.ppf([tail, 1.0 - tail], len(ordered), quantile).astype(int)
    return (
        float(ordered[low - 1]) if low >= 1 else np.nan,
        float(ordered[high]) if high < len(ordered) else np.nan,
    )
