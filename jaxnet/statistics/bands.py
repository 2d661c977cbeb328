"""Quantiles of errors over the lanes of a cell.

Bands of ẽ(t) are of the mean error of the fleet, or of the spread without a navigator. The table of
vehicles is of the mean error of each vehicle over the tail.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Float

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.statistics.axes import by_hue, choose_axes, ordered_values, panels_of
from jaxnet.statistics.curves import GREATEST_SHOWN, LOG_FLOOR
from jaxnet.statistics.groups import Group, evenly, scenes
from jaxnet.statistics.recovery import threshold
from jaxnet.store.results import Results

MOST_TIMES = 300  # instants of a band
FEWEST_TIMES = 60  # instants of a band next to many others
MOST_NUMBERS = 180_000  # in all bands together, so that a page of hundreds of cells stays small
BAND_QUANTILES = [0.05, 0.5, 0.95, 1.0]
VEHICLE_COLUMNS = ["cell", "vehicle", "lanes", "low", "median", "q95", "greatest", "unrecovered"]


class Band(NamedTuple):
    """Quantiles of the error or spread at each time over the ok lanes of a cell [m]."""

    time: Float[np.ndarray, " times"]
    low: Float[np.ndarray, " times"]
    median: Float[np.ndarray, " times"]
    high: Float[np.ndarray, " times"]
    greatest: Float[np.ndarray, " times"]
    lanes: int


def band_groups(cells: Sequence[Cell], hue: str | None = None) -> list[Group]:
    """Cells that differ only in `hue`, a swept key; None is the magnitude of the attack.

    Raises FolderError if the key is not swept, or has too many values.
    """
    if hue is None:
        return scenes(cells)
    axes = choose_axes(cells, hue=hue, panel=[key for key in cells[0].labels if key != hue])
    hues = ordered_values(cells, hue)
    return [
        Group(labels, tuple(itertools.chain(*by_hue(mine, axes, hues))))
        for labels, mine in panels_of(cells, axes)
    ]


def error_bands(stored: xr.DataArray, cells: Sequence[Cell]) -> dict[int, Band]:
    """Bands by cell: the 5 % quantile, median, 95 % quantile and maximum over ok lanes.

    Cells without an ok lane have none. More cells have fewer instants each, FEWEST_TIMES at least.
    """
    most = int(np.clip(MOST_NUMBERS // (4 * len(cells)), FEWEST_TIMES, MOST_TIMES))
    instants = evenly(range(stored.sizes["time"]), most)
    found = {}
    for cell in cells:
        values = whole_lanes(stored.isel(cell=cell.number).values[:, instants])
        if len(values):
            quantiles = np.quantile(values, BAND_QUANTILES, axis=0)
            low, median, high, greatest = map(without_start, quantiles)
            time = stored["time"].values[instants]
            found[cell.number] = Band(time, low, median, high, greatest, len(values))
    return found


def without_start(values: Float[np.ndarray, " times"]) -> Float[np.ndarray, " times"]:
    """Values that begin at 0, as before the first message, have no place on a log axis until then.

    What never rises stays.
    """
    begun = np.maximum.accumulate(values) >= LOG_FLOOR
    return np.where(begun | ~begun.any(), values, np.nan)


def whole_lanes(values: Float[np.ndarray, "lanes n"]) -> Float[np.ndarray, "ok n"]:
    """The lanes that ended, with errors up to the greatest that an axis shows."""
    return np.minimum(values[~np.isnan(values).any(axis=1)], GREATEST_SHOWN, dtype=float)


def variable_over_time(cells: Sequence[Cell]) -> str:
    """Array of `errors.zarr` that tells how these cells fare: the spread without a navigator."""
    return "spread" if is_leaderless(cells) else "tracking"


def vehicle_table(results: Results, cells: Sequence[Cell]) -> pd.DataFrame:
    """Return a row for each cell and vehicle: quantiles of its mean errors over the ok lanes [m].

    `low` is the 5 % quantile. `unrecovered` is the share of lanes [%] in which the error exceeds
    the threshold of a recovery, not-a-number without one. Cells without an ok lane have no rows.
    """
    errors, found = results.vehicles["tail_mean"], []
    for cell in cells:
        values = whole_lanes(errors.isel(cell=cell.number).values)
        if not len(values):
            continue
        limit = threshold(cell, results.study.config.recovery)
        off = 100 * (values > limit).mean(axis=0) if limit == limit else np.nan
        quantiles = np.quantile(values, BAND_QUANTILES, axis=0)
        columns = [cell.number, np.arange(1, values.shape[1] + 1), len(values), *quantiles, off]
        found.append(pd.DataFrame(dict(zip(VEHICLE_COLUMNS, columns, strict=True))))
    return pd.concat(found or [pd.DataFrame(columns=VEHICLE_COLUMNS)], ignore_index=True)
