"""Who tracks: the mean error of each vehicle over the tail, over the lanes of a cell."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from jaxnet.config.cells import Cell
from jaxnet.statistics.curves import GREATEST_SHOWN
from jaxnet.statistics.recovery import threshold
from jaxnet.store.results import Results

VEHICLE_COLUMNS = ["cell", "vehicle", "lanes", "low", "median", "q95", "greatest", "unrecovered"]


def vehicle_table(results: Results, cells: Sequence[Cell]) -> pd.DataFrame:
    """Return a row for each cell and vehicle: quantiles of its mean errors over the ok lanes [m].

    `low` is the 5 % quantile. `unrecovered` is the share of lanes [%] in which the error exceeds
    the threshold of a recovery, not-a-number without one. Cells without an ok lane have no rows.
    """
    errors, found = results.vehicles["tail_mean"], []
    for cell in cells:
        values = errors.isel(cell=cell.number).values.astype(float)
        values = np.minimum(values[~np.isnan(values).any(axis=1)], GREATEST_SHOWN)
        if not len(values):
            continue
        limit = threshold(cell, results.study.config.recovery)
        off = 100 * (values > limit).mean(axis=0) if limit == limit else np.nan
        quantiles = np.quantile(values, [0.05, 0.5, 0.95, 1.0], axis=0)
        columns = [cell.number, np.arange(1, values.shape[1] + 1), len(values), *quantiles, off]
        found.append(pd.DataFrame(dict(zip(VEHICLE_COLUMNS, columns, strict=True))))
    return pd.concat(found or [pd.DataFrame(columns=VEHICLE_COLUMNS)], ignore_index=True)
