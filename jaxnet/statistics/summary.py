"""Summary of rows: one line of `cells.csv` per cell."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from jaxnet.config.cells import Cell
from jaxnet.config.keys import RANDOMISATIONS, Config
from jaxnet.kinds.metrics import CONTRACT
from jaxnet.statistics.intervals import CONFIDENCE, UNKNOWN, mean_interval, quantile_interval
from jaxnet.statistics.recovery import confidence_of
from jaxnet.statistics.shares import share_columns, shares_of
from jaxnet.store import rows
from jaxnet.store.folder import Folder
from jaxnet.store.layout import Shard

SUMMARISED = ("tail_mean", "tail_max")
QUANTILES = {"q05": 0.05, "median": 0.5, "q95": 0.95}
COLUMNS_OF_METRIC = (
    *("mean", "low", "high", "median", "median_low", "median_high"),
    *("q05", "q95", "max"),
)


def summarise(
    folder: Folder,
    shards: Sequence[Shard],
    cells: Sequence[Cell],
    study: Config,
    samples: Sequence[int],
) -> pd.DataFrame:
    """Return `cells.csv`: swept keys, numbers of lanes, statistics of metrics, and shares.

    Statistics and shares are over the lanes that ended. `samples` are the numbers of samples of
    the cells.
    """
    beyond = study.measured()[len(CONTRACT) :]
    table, metrics = [], [*SUMMARISED, *(metric.name for metric in beyond)]
    shares = shares_of(study, cells)
    for number, lanes in rows.scan_cells(folder, shards, ("sample", "status", *metrics)):
        ok: Any = lanes[lanes["status"] == "ok"]
        counts = {"lanes": len(lanes), "ok": len(ok), "failed": len(lanes) - len(ok)}
        row = cells[number].labels | counts
        sure = confidence_of(study.samples, samples[number])
        units = independent_units(study, ok["sample"].to_numpy())
        for metric in metrics:
            found = metric_statistics(ok[metric].to_numpy(), units, sure)
            row |= {f"{metric}_{name}": value for name, value in found.items()}
        for share in shares:
            row |= share_columns(share, share.which(study, cells[number], ok), sure)
        table.append(row)
    return pd.DataFrame(table)


def independent_units(
    study: Config, samples: Int[np.ndarray, " lanes"]
) -> Int[np.ndarray, " lanes"] | None:
    """Number of each sample's scrambled sequence; None if the samples are independent."""
    if study.draws == "random" or not isinstance(study.samples, int):
        return None
    return samples // (study.samples // RANDOMISATIONS)


def metric_statistics(
    values: Float[np.ndarray, " lanes"],
    units: Int[np.ndarray, " lanes"] | None = None,
    confidence: float = CONFIDENCE,
) -> dict[str, float]:
    """Statistics of a metric over lanes, by the ends of their columns' names in `cells.csv`.

    Lanes of one unit depend on each other, and their median has no interval; the `units` are
    independent. Numbers that are not known
    are not-a-number.
    """
    if not len(values):
        return dict.fromkeys(COLUMNS_OF_METRIC, np.nan)
    mean = float(values.mean()), *mean_interval(values, confidence, units)
    ends = UNKNOWN if units is not None else quantile_interval(values, 0.5, confidence)
    median = quantile_of(values, 0.5), *ends
    rest = quantile_of(values, 0.05), quantile_of(values, 0.95), float(values.max())
    return dict(zip(COLUMNS_OF_METRIC, (*mean, *median, *rest), strict=True))


def quantile_of(values: Float[np.ndarray, " lanes"], quantile: float) -> float:
    """Quantile of values that may be infinite: between two of them the higher one counts."""
    with np.errstate(invalid="ignore"):  # inf - inf, and 0 inf
        between = float(np.quantile(values, quantile))
    return between if between == between else float(np.quantile(values, quantile, method="higher"))
