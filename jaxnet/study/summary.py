"""Statistics of rows: one line per cell."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy import special

from jaxnet.study import recovery
from jaxnet.study.config import Config
from jaxnet.study.sweep import Cell

SUMMARISED = ("tail_mean", "tail_max")
CONFIDENCE = 0.95


def summarise(lanes: pd.DataFrame, cells: Sequence[Cell], study: Config, look: int) -> pd.DataFrame:
    """`cells.csv`: swept keys, lanes, ok, failed, the spread of the tail errors over ok lanes.

    And, if asked for, the share that did not recover; `look` is the one that ended a sequential run.
    """
    by_cell: dict[Any, Any] = dict(tuple(lanes.groupby("cell")))
    rows = []
    for cell in cells:
        mine = by_cell[cell.number]
        ok = mine[mine["status"] == "ok"]
        row = {**cell.labels, "lanes": len(mine), "ok": len(ok), "failed": len(mine) - len(ok)}
        for metric in SUMMARISED:
            row |= {f"{metric}_{name}": value for name, value in spread(ok[metric].to_numpy()).items()}
        rows.append(row)
    table = pd.DataFrame(rows)
    if study.recovery is None:
        return table
    counts = recovery.count(lanes, cells, study.recovery.tau)
    return table.join(recovery.shares(counts, cells, recovery.confidence_of(study.samples, look)))


def spread(values: np.ndarray) -> dict[str, float]:
    """Mean with its t interval, median, quantiles and maximum; not-a-number where there is no lane."""
    count = len(values)
    if count == 0:
        return dict.fromkeys(("mean", "low", "high", "median", "q05", "q95", "max"), np.nan)
    mean, half = values.mean(), np.nan
    if count > 1:
        quantile = special.stdtrit(count - 1, (1 + CONFIDENCE) / 2)
        half = quantile * values.std(ddof=1) / np.sqrt(count)
    q05, median, q95 = np.quantile(values, [0.05, 0.5, 0.95])
    return {
        "mean": mean,
        "low": mean - half,
        "high": mean + half,
        "median": median,
        "q05": q05,
        "q95": q95,
        "max": values.max(),
    }
