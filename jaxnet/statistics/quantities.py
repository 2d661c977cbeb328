"""A quantity of the study's table for each cell, with its interval, unit and words.

Figures and the page draw a `Quantity`; a terminal's table and those for papers print it.
"""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Config
from jaxnet.config.naming import choices_words
from jaxnet.kinds.metrics import LANE_STATISTICS, Metric
from jaxnet.kinds.metrics.spread import SPREAD
from jaxnet.kinds.refusals import suggestion
from jaxnet.model.wording import count, count_between, counted
from jaxnet.statistics.curves import (
    LOG_FLOOR,
    cell_magnitudes,
    failed_kinds,
    log_ends,
    mostly_failed,
)
from jaxnet.statistics.intervals import CONFIDENCE, clopper_pearson
from jaxnet.statistics.recovery import confidence_told
from jaxnet.statistics.summary import (
    asked_shares,
    independent_units,
    lane_estimate,
    lane_shares,
    share_names,
    unsettled_shares,
)
from jaxnet.statistics.tiles import lost_name, share_lost
from jaxnet.store import rows
from jaxnet.store.folder import FolderError
from jaxnet.store.results import Results

LEAST_RATIO_OF_LOG = 30.0  # of the greatest and the least value, for a log axis
SPREAD_WORDS = f"spread: {SPREAD.words}"
TITLES = {"tail_mean": "error", "tail_max": "worst vehicle"}  # of metrics, if not their names
FORMATION_NOTE = "errors, spread and outside leave out the vehicles' places in the formation"
MOST_UNENDED = 3  # choices of cells without a lane
VALUE_COLUMNS = ["value", "low", "high"]


class Quantity(NamedTuple):
    """A number of each cell with an interval, and its words.

    `values` has the columns value, low and high by cell; an end that is not known is not-a-number.
    An error may be rounding beside the column `size`, the cell's ā; 0 where it is no length.
    """

    name: str
    words: str
    unit: str
    share: bool  # in percent
    confidence: float
    values: pd.DataFrame
    note: str = ""  # what the words leave open
    lanes: Sequence[int] = ()  # of each cell with a value
    unended: Sequence[int] = ()  # cells without a value, for none of their lanes ended

    @property
    def known(self) -> Float[np.ndarray, " known"]:
        return self.values["value"].dropna().to_numpy(dtype=float)

    @property
    def log(self) -> bool:
        """Whether values belong on a log axis: none is negative, and they span over a decade.

        Numbers without a unit are shares or counts, of which 0 is not rounding.
        """
        if self.share or not self.known.size:
            return False
        least, greatest = self.known.min(), self.known.max()
        if not self.unit and least == 0:
            return False
        return bool(least >= 0 and greatest > LOG_FLOOR and greatest >= LEAST_RATIO_OF_LOG * least)

    @property
    def ends(self) -> tuple[float, float]:
        """Ends of an axis that holds all values and intervals."""
        if self.share:
            return 0.0, 100.0
        known = self.values[VALUE_COLUMNS].to_numpy(dtype=float)
        known = known[np.isfinite(known)]
        if self.log:
            return log_ends(self.known, known[known > LOG_FLOOR])  # an interval may go on below
        if self.unit == "m" and np.abs(known).max() < LOG_FLOOR:  # rounding needs no own scale
            return 0.0, 1.0
        return min(0.0, float(known.min())), float(known.max())

    @property
    def notes(self) -> str:
        """What a figure of the quantity has to say below its title."""
        known = self.values[["low", "high"]].notna().to_numpy().any()
        bars = f"bars: {100 * self.confidence:g} % intervals" if known else "no interval is known"
        lanes = f"{count_between(self.lanes, 'lane')} a point" if self.lanes else ""
        return "; ".join(filter(None, [self.note, lanes, bars]))

    @property
    def axis(self) -> str:
        return f"{self.words} [{self.unit}]" if self.unit else self.words


def asked_quantity(study: Config) -> str:
    """The quantity by which a study judges lanes: recovery, else the spread or mean tail error."""
    if study.recovery is not None:
        return "unrecovered"
    return "spread" if study.leaderless else "tail_mean"


def known_quantities(study: Config) -> list[str]:
    """Names of quantities; a metric's name may end in a statistic."""
    shares = ["failed"] if study.recovery is None else ["unrecovered", "failed"]
    shares += ["in_hull"] * study.leaderless
    return [*shares, *unsettled_shares(study), *(metric.name for metric in study.measured())]


def quantity_of(results: Results, cells: Sequence[Cell], name: str) -> Quantity:
    """Return a quantity of each cell: shares in percent, metrics in their unit, with intervals.

    The name is `unrecovered`, `failed`, `in_hull`, a metric (its median over the lanes that ended),
    or METRIC_STATISTIC with a statistic of median, mean, q05, q95 and max. Raises FolderError for
    another name.
    """
    study = results.study.config
    table: pd.DataFrame = results.cells.loc[[cell.number for cell in cells]]
    of = "ok"
    if name in asked_shares(study, cells):
        share, sure = lane_shares(study)[name], confidence_told(study.samples)
        words, values = f"lanes {share.words(cells)}", 100 * stored_values(table, share_names(name))
        note = share.note(study, cells)
        if name == "unrecovered" and any(table["failed"]):
            of, words, note = "lanes", f"lanes {lost_name(results)}", f"{note}, or failed"
            values = (100 * share_lost(results).loc[table.index]).set_axis(VALUE_COLUMNS, axis=1)
        found = Quantity(name, words, "%", True, sure, values, note)
    elif name == "failed":
        of, values = "lanes", 100 * share_failed(table)
        found = Quantity(name, "lanes failed", "%", True, CONFIDENCE, values)
    else:
        metric, statistic = metric_and_statistic(study, name)
        note, values = definition(metric), row_values(results, cells, metric, statistic)
        words = f"{metric_title(metric)}, {LANE_STATISTICS[statistic].words}"
        if endless := int(np.isinf(values["value"]).sum()):
            note = f"{note}; infinite, and not drawn, in {count(endless, 'cell')}".lstrip("; ")
        values = values.replace(np.inf, np.nan)
        found = Quantity(name, words, metric.column_unit, False, CONFIDENCE, values, note)
    note = "; ".join(filter(None, [found.note, unended_words(results, cells)]))
    found = found._replace(note=note)
    sizes = cell_magnitudes(results)[found.values.index] if found.unit == "m" else 0.0
    found = found._replace(values=found.values.assign(size=sizes))
    known = table.index.isin(values["value"].dropna().index)
    unended = table.index[~known & (table["ok"] == 0)].tolist()
    return found._replace(lanes=table.loc[known, of].tolist(), unended=unended)


def values_told(some: Sequence[Cell], cells: Sequence[Cell]) -> str:
    """The swept values that some of these cells have, of many the first."""
    where = choices_words([cell.labels for cell in some], [cell.labels for cell in cells])
    where[MOST_UNENDED:] = ["…"] * (len(where) > MOST_UNENDED)
    return " / ".join(where)


def unended_words(results: Results, cells: Sequence[Cell]) -> str:
    """Which of these cells have failed lanes, all, most or some, which no figure shows, and why."""
    table, kinds, failed = results.cells, failed_kinds(results), mostly_failed(results)
    ended = table["ok"].to_numpy()
    lost = [cell for cell in cells if ended[cell.number] == 0]
    few = [cell for cell in cells if cell.number in failed and cell not in lost]
    some = [cell for cell in cells if cell.number in kinds and cell.number not in failed]

    def told(words: str, those: Sequence[Cell]) -> str:
        why = sum((kinds.get(cell.number, Counter()) for cell in those), Counter[str]())
        where = f": {values_told(those, cells)}" * (len(those) < len(cells))
        return f"{words}{where} ({counted(why)})"

    def failed_words(those: Sequence[Cell]) -> str:
        numbers = table.loc[[cell.number for cell in those], ["failed", "ok"]].to_numpy(int)
        return told(f"{numbers[:, 0].sum():,} of {numbers.sum():,} lanes failed", those)

    parts = [told("no lane ended", lost)] * bool(lost)
    return "; ".join([*parts, *(failed_words(those) for those in (few, some) if those)])


def share_failed(table: pd.DataFrame) -> pd.DataFrame:
    """Share of lanes failed, low and high, from rows of `cells.csv`."""
    counts = table["failed"].to_numpy(), table["lanes"].to_numpy()
    columns = counts[0] / counts[1], *clopper_pearson(*counts, CONFIDENCE)
    return pd.DataFrame(dict(zip(VALUE_COLUMNS, columns, strict=True)), index=table.index)


def metric_title(metric: Metric) -> str:
    """Name of a metric in tables and on axes; `definition` says what it is."""
    return TITLES.get(metric.name, metric.name.replace("_", " "))


def meaning(metric: Metric) -> str:
    tail = " over the tail" if metric.over == "tail" else ""
    return f"{metric.told}{tail}"


def definition(metric: Metric) -> str:
    """What a metric is, behind its title and its name; "" where the title says it."""
    title, words = metric_title(metric), meaning(metric).replace(f" ({metric.name})", "")
    named = f"{title} ({metric.name})" if metric.name in TITLES else title
    return "" if words == title else f"{named}: {words.removeprefix(title).lstrip()}"


def stored_values(table: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """Value, low and high from these columns of `cells.csv`; what it lacks is not-a-number."""
    found = pd.DataFrame(np.nan, table.index, VALUE_COLUMNS)
    for column, name in zip(VALUE_COLUMNS, names, strict=False):
        if name in table:
            found[column] = pd.to_numeric(table[name], errors="coerce")
    return found


def row_values(
    results: Results, cells: Sequence[Cell], metric: Metric, statistic: str
) -> pd.DataFrame:
    """A statistic of a metric over the lanes that ended, with its interval, from the rows."""
    found, wanted = {}, {cell.number for cell in cells}
    for number, lanes in results.by_cell("sample", metric.name, where=rows.OK, cells=wanted):
        values = lanes[metric.name].to_numpy(dtype=float)
        units = independent_units(results.study.config, lanes["sample"].to_numpy())
        found[number] = lane_estimate(statistic, values, units)
    return pd.DataFrame.from_dict(found, orient="index", columns=VALUE_COLUMNS, dtype=float)


def metric_and_statistic(study: Config, name: str) -> tuple[Metric, str]:
    """Metric and statistic of a name; raises FolderError if the study has no such metric."""
    metrics = {metric.name: metric for metric in study.measured()}
    if name in metrics:
        return metrics[name], "median"
    stem, _, statistic = name.rpartition("_")
    if stem in metrics and statistic in LANE_STATISTICS:
        return metrics[stem], statistic
    more = [f"{metric}_{statistic}" for metric in metrics for statistic in LANE_STATISTICS]
    near = suggestion(name, [*known_quantities(study), *more], fallback=False)
    raise FolderError(
        f"y: must be one of {', '.join(known_quantities(study))}, or a metric with _median, _mean,"
        f" _q05, _q95 or _max (got {name}){near}"
    )
