"""Bands of ẽ(t): quantiles over lanes of the fleet's mean error, or of the leaderless spread."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.statistics.curves import GREATEST_SHOWN, LOG_FLOOR, MOST_PANELS, decades
from jaxnet.statistics.groups import Group, Label, labels_without_magnitude
from jaxnet.store.results import Results

MOST_TIMES = 300  # instants of a band
FEWEST_TIMES = 60  # instants of a band next to many others
MOST_NUMBERS = 180_000  # in all bands together, so that a page of hundreds of cells stays small


class Band(NamedTuple):
    """Quantiles of the error or spread at each time over the ok lanes of a cell [m]."""

    time: Float[np.ndarray, " times"]
    low: Float[np.ndarray, " times"]
    median: Float[np.ndarray, " times"]
    high: Float[np.ndarray, " times"]
    greatest: Float[np.ndarray, " times"]
    lanes: int


def error_band(stored: xr.DataArray, cell: Cell, most: int = MOST_TIMES) -> Band | None:
    """The 5 % quantile, median, 95 % quantile and maximum over samples; None if no lane is ok.

    The band has at most `most` instants.
    """
    times = stored.sizes["time"]
    instants = np.unique(np.linspace(0, times - 1, min(times, most)).round().astype(int))
    values = stored.isel(cell=cell.number).values[:, instants]
    values = np.minimum(values[~np.isnan(values).any(axis=1)], GREATEST_SHOWN, dtype=float)
    if not len(values):
        return None
    low, median, high, greatest = np.quantile(values, [0.05, 0.5, 0.95, 1.0], axis=0)
    return Band(stored["time"].values[instants], low, median, high, greatest, len(values))


def all_bands(results: Results, of: Sequence[Cell] | None = None) -> dict[int, Band]:
    """Return the bands of the first MOST_PANELS scenes, by number of the cell.

    `of` restricts the scenes to some cells.
    """
    groups = scenes(results.study.cells if of is None else of)[:MOST_PANELS]
    return error_bands(results, [cell for group in groups for cell in group.cells])


def error_bands(results: Results, cells: Sequence[Cell]) -> dict[int, Band]:
    """Return bands by cell; more cells have fewer instants each, FEWEST_TIMES at least."""
    stored = results.errors[variable_over_time(cells)]
    most = int(np.clip(MOST_NUMBERS // (4 * len(cells)), FEWEST_TIMES, MOST_TIMES))
    found = {cell.number: error_band(stored, cell, most) for cell in cells}
    return {number: each for number, each in found.items() if each is not None}


def variable_over_time(cells: Sequence[Cell]) -> str:
    """Array of `errors.zarr` that tells how these cells fare: the spread without a navigator."""
    return "spread" if is_leaderless(cells) else "tracking"


def bands_span(found: Mapping[int, Band]) -> tuple[float, float]:
    low = min(float(each.low.min()) for each in found.values())
    return decades(
        max(LOG_FLOOR, low),
        max(LOG_FLOOR, *(float(each.greatest.max()) for each in found.values())),
    )


def scenes(cells: Sequence[Cell]) -> list[Group]:
    """Groups of cells that differ only in ā, fixed or drawn, in the study's order."""
    members: dict[tuple[tuple[str, Label], ...], list[Cell]] = {}
    for cell in cells:
        members.setdefault(tuple(labels_without_magnitude(cell).items()), []).append(cell)
    return [Group(dict(labels), tuple(group)) for labels, group in members.items()]
