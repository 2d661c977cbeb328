"""A quantity of lanes for each cell, with its interval: a share, or a statistic of a metric.

Figures and the page draw a `Quantity`. `intervals` says which intervals there are.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.keys import Config
from jaxnet.kinds.metrics import DETECTION, Metric
from jaxnet.model.wording import count
from jaxnet.statistics.curves import LOG_FLOOR, decades
from jaxnet.statistics.intervals import (
    CONFIDENCE,
    UNKNOWN,
    clopper_pearson,
    mean_interval,
    quantile_interval,
)
from jaxnet.statistics.recovery import confidence_told
from jaxnet.statistics.shares import LANE_SHARES, share_names, shares_of
from jaxnet.statistics.summary import QUANTILES, independent_units, quantile_of
from jaxnet.store import rows
from jaxnet.store.folder import FolderError
from jaxnet.store.results import Results

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
VALUE_COLUMNS = ["value", "low", "high"]


class Quantity(NamedTuple):
    """A number of each cell with an interval, and its words.

    `values` has the columns value, low and high by cell; an end that is not known is not-a-number.
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
        return self.values["value"].dropna().to_numpy(dtype=float)

    @property
    def log(self) -> bool:
        """Whether values belong on a log axis: none is negative, and they span over a decade."""
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
        known = self.values[VALUE_COLUMNS].to_numpy(dtype=float)
        known = known[np.isfinite(known)]
        if self.log:
            return decades(max(self.floor, known.min()), known.max())
        if self.unit == "m" and np.abs(known).max() < LOG_FLOOR:  # rounding needs no own scale
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
        return f"{self.words} [{self.unit}]" if self.unit else self.words


def asked_quantity(study: Config) -> str:
    """The quantity that a study asks for: a recovery, its first own metric, or the mean tail error.

    Shares of alarms, which every study with a detector has, are not asked for.
    """
    if study.recovery is not None:
        return "unrecovered"
    own = (metric.name for metric in study.metrics if metric.name not in DETECTION)
    return next(own, "tail_mean")


def known_quantities(study: Config) -> list[str]:
    """Names of quantities; a metric's name may end in a statistic."""
    shares = ["failed"] if study.recovery is None else ["unrecovered", "failed"]
    shares += ["in_hull"] * study.leaderless
    return [*shares, *(metric.name for metric in study.measured())]


def quantity_of(results: Results, cells: Sequence[Cell], name: str) -> Quantity:
    """Return a quantity of each cell: shares in percent, metrics in their unit, with intervals.

    The name is `unrecovered`, `failed`, `in_hull`, a metric (its median over the lanes that ended),
    or METRIC_STATISTIC with a statistic of median, mean, q05, q95 and max. Raises FolderError for
    another name.
    """
    study = results.study.config
    table: pd.DataFrame = results.cells.loc[[cell.number for cell in cells]]
    of = "ok"
    if name in (share.name for share in shares_of(study, cells)):
        share = LANE_SHARES[name]
        values = 100 * table.reindex(columns=share_names(name)).astype(float)
        values = values.set_axis(VALUE_COLUMNS, axis=1)
        words, sure = f"lanes {share.words(cells)}", confidence_told(study.samples)
        found = Quantity(name, words, "%", True, sure, values, share.note(study, cells))
    elif name == "failed":
        of, values = "lanes", failed_shares(table)
        found = Quantity(name, "lanes failed", "%", True, CONFIDENCE, values)
    else:
        metric, statistic = metric_and_statistic(study, name)
        values = statistic_table(results, cells, metric, statistic)
        note = AGREEMENT_NOTES.get(metric.name, "") if is_leaderless(cells) else ""
        words = f"{metric.words or metric.name.replace('_', ' ')}, {STATISTIC_WORDS[statistic]}"
        if metric.over == "tail":
            words = words.replace(",", " over the tail,", 1)
        found = Quantity(name, words, metric.column_unit, False, CONFIDENCE, values, note)
    lanes = set(table.loc[values["value"].dropna().index, of].tolist())
    return found._replace(lanes=int(lanes.pop()) if len(lanes) == 1 else 0)


def metric_and_statistic(study: Config, name: str) -> tuple[Metric, str]:
    """Metric and statistic of a name; raises FolderError if the study has no such metric."""
    metrics = {metric.name: metric for metric in study.measured()}
    if name in metrics:
        return metrics[name], "median"
    stem, _, statistic = name.rpartition("_")
    if stem in metrics and statistic in STATISTIC_WORDS:
        return metrics[stem], statistic
    raise FolderError(
        f"y: must be one of {', '.join(known_quantities(study))}, or a metric with _median, _mean,"
        f" _q05, _q95 or _max (got {name})"
    )


def failed_shares(table: pd.DataFrame) -> pd.DataFrame:
    failed, lanes = table["failed"].to_numpy(), table["lanes"].to_numpy()
    columns = failed / lanes, *clopper_pearson(failed, lanes, CONFIDENCE)
    return 100 * pd.DataFrame(dict(zip(VALUE_COLUMNS, columns, strict=True)), index=table.index)


def statistic_table(
    results: Results, cells: Sequence[Cell], metric: Metric, statistic: str
) -> pd.DataFrame:
    """A statistic of a metric over the lanes that ended, with its interval, from the rows."""
    found, wanted = {}, {cell.number for cell in cells}
    for number, lanes in results.by_cell("sample", metric.name, where=rows.OK, cells=wanted):
        values = lanes[metric.name].to_numpy(dtype=float)
        units = independent_units(results.study.config, lanes["sample"].to_numpy())
        if statistic == "mean":
            found[number] = values.mean(), *mean_interval(values, CONFIDENCE, units)
        elif statistic == "max":
            found[number] = values.max(), *UNKNOWN
        else:
            at = QUANTILES[statistic]
            ends = UNKNOWN if units is not None else quantile_interval(values, at, CONFIDENCE)
            found[number] = quantile_of(values, at), *ends
    return pd.DataFrame.from_dict(found, orient="index", columns=VALUE_COLUMNS, dtype=float)
