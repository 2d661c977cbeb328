"""Summary of rows: one line of `cells.csv` per cell."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Int

from jaxnet.config.cells import Cell
from jaxnet.config.keys import RANDOMISATIONS, Config
from jaxnet.kinds.metrics import CONTRACT, DETECTION
from jaxnet.statistics import means, recovery
from jaxnet.statistics.hull import hull_share
from jaxnet.statistics.limits import ceilings
from jaxnet.statistics.recovery import CONFIDENCE
from jaxnet.store import rows
from jaxnet.store.folder import Folder
from jaxnet.store.layout import Shard

SUMMARISED = ("tail_mean", "tail_max")  # norms, so not negative
NO_MEAN_INTERVAL = "no interval of a mean holds without a bound on every lane: an end is missing where theory gives none"

MetricRange = tuple[float, float]  # least and greatest of a metric
UNBOUNDED = -np.inf, np.inf


def summarise(
    folder: Folder,
    shards: Sequence[Shard],
    cells: Sequence[Cell],
    study: Config,
    samples: Sequence[int],
) -> pd.DataFrame:
    """Return `cells.csv`: swept keys, lanes, ok, failed, and statistics of the tail errors over ok lanes.

    With `recovery` the table also has the share unrecovered, and without a navigator the share of lanes in
    the hull. `samples` are the numbers of samples of the cells.
    """
    table, counts, metrics = [], recovery.zero_counts(cells), summarised_metrics(study)
    sure = np.array([recovery.confidence_of(study.samples, each) for each in samples])
    for number, lanes in rows.scan_cells(folder, shards, ("sample", "status", *metrics)):
        ok: Any = lanes[lanes["status"] == "ok"]
        row = {
            **cells[number].labels,
            "lanes": len(lanes),
            "ok": len(ok),
            "failed": len(lanes) - len(ok),
        }
        ranges = ranges_of(study, cells[number], ok["sample"].tolist())
        drawn = independent_units(study, ok["sample"].to_numpy())
        for metric in metrics:
            within = ranges.get(metric, UNBOUNDED)
            found = metric_statistics(ok[metric].to_numpy(), within, drawn, float(sure[number]))
            row |= {f"{metric}_{name}": value for name, value in found.items()}
        if any(cell.scenario.leaderless for cell in cells):
            row |= hull_share(cells[number], ok["outside"].to_numpy(), float(sure[number]))
        table.append(row)
        if study.recovery is not None:
            counts.add(cells[number], ok[cells[number].scenario.judged].to_numpy(), study.recovery)
    cells_table = pd.DataFrame(table)
    if study.recovery is None:
        return cells_table
    return cells_table.join(recovery.unrecovered_columns(counts, cells, sure))


def ranges_of(study: Config, cell: Cell, samples: Sequence[int]) -> dict[str, MetricRange]:
    """Return the range of the tail errors [m] and of the shares of alarms in some lanes of a cell.

    The range of an error is from 0 to the greatest error that theory allows.
    """
    errors = {metric: (0.0, most) for metric, most in ceilings(study, cell, samples).items()}
    return errors | dict.fromkeys(DETECTION, (0.0, 1.0))


def summarised_metrics(study: Config) -> list[str]:
    """Return the metrics of tables: the tail errors, and the study's metrics beyond the contract."""
    return [*SUMMARISED, *(metric.name for metric in study.measured()[len(CONTRACT) :])]


def independent_units(
    study: Config, samples: Int[np.ndarray, " lanes"]
) -> Int[np.ndarray, " lanes"] | None:
    """Return the number of each sample's independent sequence; None if the samples are independent."""
    if study.draws == "random" or not isinstance(study.samples, int):
        return None
    return samples // (study.samples // RANDOMISATIONS)


def interval_basis(study: Config) -> str:
    """Return the units over which intervals of means are computed, in words."""
    return (
        "lanes" if study.draws == "random" else f"the means of {RANDOMISATIONS} scrambled sequences"
    )


def metric_statistics(
    values: np.ndarray,
    within: MetricRange,
    units: Int[np.ndarray, " lanes"] | None = None,
    confidence: float = CONFIDENCE,
) -> dict[str, float]:
    """Return mean, interval of the mean, median, quantiles and maximum; not-a-number without a lane.

    The interval uses the range `within`: an end with an infinite bound is not-a-number. Lanes of one unit
    depend on each other; the `units` are independent.
    """
    if not len(values):
        return dict.fromkeys(("mean", "low", "high", "median", "q05", "q95", "max"), np.nan)
    sums, counts = values, None
    with np.errstate(invalid="ignore"):  # infinite values
        if units is not None:
            _, number, counts = np.unique(units, return_inverse=True, return_counts=True)
            sums, counts = np.bincount(number, values), counts.astype(float)
        low, high = means.mean_interval(sums, *within, confidence, counts)
        at = [0.05, 0.5, 0.95]
        between, above = np.quantile(values, at), np.quantile(values, at, method="higher")
        q05, median, q95 = np.where(np.isnan(between), above, between)  # inf - inf, and 0 inf
    ends = {"mean": values.mean(), "low": low, "high": high}
    return ends | {"median": median, "q05": q05, "q95": q95, "max": values.max()}
