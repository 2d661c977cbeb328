"""The table of a study, cell by quantity by statistic: what `cells.csv` has, a line a cell.

A quantity is a metric, whose `LANE_STATISTICS` are over the lanes that ended, or one of the
`LANE_SHARES` of these lanes. Each has its interval where theory gives one (`intervals`). A metric
more is a kind's or a study's; a share more is a line of `LANE_SHARES`, of
`asked_shares`, and of `quantities.known_quantities`.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int

from jaxnet.config.cells import Cell
from jaxnet.config.keys import RANDOMISATIONS, Config
from jaxnet.kinds.metrics import CONTRACT, LANE_STATISTICS, Metric
from jaxnet.statistics.amplitude import amplitude_note, attack_size
from jaxnet.statistics.falling import still_falls, unseen_period
from jaxnet.statistics.intervals import (
    CONFIDENCE,
    UNKNOWN,
    clopper_pearson,
    mean_interval,
    quantile_interval,
)
from jaxnet.statistics.recovery import (
    confidence_of,
    share_definition,
    share_name,
    threshold,
)
from jaxnet.store import rows
from jaxnet.store.folder import Folder
from jaxnet.store.layout import Shard

SUMMARISED = ("tail_mean", "tail_max")
QUANTILES = {"q05": 0.05, "median": 0.5, "q95": 0.95}

Estimated = tuple[float, float, float]  # value and both ends; an end that is not known is NaN
Units = Int[np.ndarray, " lanes"] | None  # independent units of the lanes; None: each lane is one
Counted = Bool[np.ndarray, " lanes"] | None  # None in a cell that has no such share


class Share(NamedTuple):
    """A share of the lanes that ended: its words, its note, and which lanes count."""

    words: Callable[[Sequence[Cell]], str]
    note: Callable[[Config, Sequence[Cell]], str]
    which: Callable[[Config, Cell, pd.DataFrame], Counted]


def count_unrecovered(study: Config, cell: Cell, ok: pd.DataFrame) -> Counted:
    """Whether the tail error, or the spread without a navigator, stays above τ ā (O6)."""
    if not attack_size(cell) > 0:
        return None
    return ok[cell.scenario.judged].to_numpy() > threshold(cell, study.recovery)


def unrecovered_note(study: Config, cells: Sequence[Cell]) -> str:
    if study.recovery is None:
        return ""
    reduced = amplitude_note(cells) if study.recovery.of == "magnitude" else ""
    return "; ".join(filter(None, [share_definition(study.recovery, cells), reduced]))


def count_in_hull(study: Config, cell: Cell, ok: pd.DataFrame) -> Counted:
    """Whether no vehicle leaves the hull of the starts, attacked vehicles aside.

    `outside` is at most the accuracy of the engine, 1e-8 m for the exact engine and 1e-5 m for
    others.
    """
    if not cell.scenario.leaderless:
        return None
    return ok["outside"].to_numpy() <= cell.scenario.engine.accuracy


def hull_note(study: Config, cells: Sequence[Cell]) -> str:
    tolerance = max(cell.scenario.engine.accuracy for cell in cells)
    who = "no honest vehicle leaves the convex hull of the honest starts"
    box = any(cell.scenario.defence.tolerates() is not None for cell in cells)
    proved = "; what is proved of W-MSR is the range of the starts on each axis, a box" * box
    return f"in the hull (in_hull): {who} by over {tolerance:g} m{proved}"


UNSETTLED_NOTE = "never settled (unsettled): above the limit at the last output time"

LANE_SHARES = {
    "in_hull": Share(lambda cells: "in the hull", hull_note, count_in_hull),
    "unrecovered": Share(share_name, unrecovered_note, count_unrecovered),
}


def unsettled_shares(study: Config) -> dict[str, Share]:
    """The share of lanes that never settle, of each settling time."""

    def share(metric: Metric) -> Share:
        words = "never settled" if metric.name == metric.base else f"never settled ({metric.name})"
        return Share(
            lambda cells: words,
            lambda study, cells: UNSETTLED_NOTE,
            lambda study, cell, ok: np.isinf(ok[metric.name].to_numpy()),
        )

    times = [each for each in study.metrics if each.base == "settling_time"]
    names = ["unsettled" if each.name == each.base else f"{each.name}_unsettled" for each in times]
    return dict(zip(names, map(share, times), strict=True))


def lane_shares(study: Config) -> dict[str, Share]:
    """Shares by their columns' names."""
    return LANE_SHARES | unsettled_shares(study)


def asked_shares(study: Config, cells: Sequence[Cell]) -> list[str]:
    alone = any(cell.scenario.leaderless for cell in cells)
    found = ["in_hull"] * alone + ["unrecovered"] * (study.recovery is not None)
    return [*found, *unsettled_shares(study)]


def share_names(name: str) -> list[str]:
    return [name, f"{name}_low", f"{name}_high"]


def summarise(
    folder: Folder,
    shards: Sequence[Shard],
    cells: Sequence[Cell],
    study: Config,
    samples: Sequence[int],
) -> pd.DataFrame:
    """Return `cells.csv`: swept keys, numbers of lanes, statistics of metrics, and shares.

    `samples` are the numbers of samples of the cells.
    """
    table = []
    metrics = [*SUMMARISED, *(each.name for each in study.measured()[len(CONTRACT) :])]
    shares = asked_shares(study, cells)
    for number, lanes in rows.scan_cells(
        folder, shards, ("sample", "status", *metrics, "tail_fall")
    ):
        cell = cells[number]
        ok: Any = lanes[lanes["status"] == "ok"]
        row: dict[str, Any] = {**cell.labels, "lanes": len(lanes)}
        row |= {"ok": len(ok), "failed": len(lanes) - len(ok)}
        sure = confidence_of(study.samples, samples[number])
        units = independent_units(study, ok["sample"].to_numpy())
        for metric in metrics:
            found = metric_statistics(ok[metric].to_numpy(), units, sure)
            row |= {f"{metric}_{name}": value for name, value in found.items()}
        for name in shares:
            counted = lane_shares(study)[name].which(study, cell, ok)
            row |= dict(zip(share_names(name), share_estimate(counted, sure), strict=True))
        least = np.fmax(threshold(cell, study.recovery), cell.scenario.engine.accuracy)
        falls = ok["tail_fall"].to_numpy(), ok[cell.scenario.judged].to_numpy()
        swings = unseen_period(cell.scenario) > 0
        table.append(row | {"falling": still_falls(*falls, least, swings)})
    return pd.DataFrame(table)


def independent_units(study: Config, samples: Int[np.ndarray, " lanes"]) -> Units:
    """Number of each sample's scrambled sequence; None if the samples are independent."""
    if study.draws == "random" or not isinstance(study.samples, int):
        return None
    return samples // (study.samples // RANDOMISATIONS)


def metric_statistics(
    values: Float[np.ndarray, " lanes"], units: Units = None, confidence: float = CONFIDENCE
) -> dict[str, float]:
    """Statistics of a metric over lanes, by the ends of their columns' names in `cells.csv`."""
    found: dict[str, float] = {}
    for name, (_, columns) in LANE_STATISTICS.items():
        estimated = lane_estimate(name, values, units, confidence)
        found |= dict(zip(columns, estimated, strict=False))
    return found


def lane_estimate(
    statistic: str,
    values: Float[np.ndarray, " lanes"],
    units: Units = None,
    confidence: float = CONFIDENCE,
) -> Estimated:
    """A statistic of lanes and its interval.

    Lanes of one unit depend on each other, so their quantiles have no interval; a maximum has none.
    """
    if not len(values) or (
        statistic == "mean" and np.isinf(values).any()
    ):  # of what never happened
        return np.nan, *UNKNOWN
    if statistic == "mean":
        return float(values.mean()), *mean_interval(values, confidence, units)
    if statistic == "max":
        return float(values.max()), *UNKNOWN
    at = QUANTILES[statistic]
    interval = quantile_interval(values, at, confidence) if units is None else UNKNOWN
    return quantile_of(values, at), *interval


def quantile_of(values: Float[np.ndarray, " lanes"], quantile: float) -> float:
    """Quantile of values that may be infinite: between two of them the higher one counts."""
    with np.errstate(invalid="ignore"):  # inf - inf, and 0 inf
        between = float(np.quantile(values, quantile))
    return between if between == between else float(np.quantile(values, quantile, method="higher"))


def share_estimate(counted: Counted, confidence: float) -> Estimated:
    """Share and both ends of its exact interval; not-a-number without a lane."""
    if counted is None or not len(counted):
        return np.nan, *UNKNOWN
    many = np.count_nonzero(counted)
    low, high = clopper_pearson(np.array([many]), np.array([len(counted)]), confidence)
    return many / len(counted), float(low[0]), float(high[0])
