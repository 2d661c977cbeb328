"""Trajectories as CSV for pandas, R and Excel: a file for each stored lane, a row for each time and vehicle.

Columns: cell, sample, the swept keys, time [s], vehicle, then states, inputs, attack signal and navigator.
"""

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.store.folder import Folder
from jaxnet.store.results import Results
from jaxnet.store.tables import write_table

if TYPE_CHECKING:
    import xarray as xr

PER_VEHICLE = ("states", "inputs", "attack")


def write_csv(results: Results, out: str | Path | UPath | None = None) -> UPath:
    """Write `csv/cell-C-sample-S.csv` of each stored lane, or into another folder; return the folder.

    Raises FolderError if no trajectories are stored.
    """
    folder = Folder(results.folder.path / "csv" if out is None else out)
    for cell, sample, lane in stored_lanes_of(results):
        table = trajectory_table(results.study.cells[cell], sample, lane)
        folder.put(f"cell-{cell}-sample-{sample}.csv", functools.partial(write_table, table))
    return folder.path


def stored_lanes_of(results: Results) -> "Iterator[tuple[int, int, xr.Dataset]]":
    """Yield cell, sample and trajectory of each lane in the store of trajectories."""
    data = results.trajectories
    if "lane" in data.dims:
        for number in range(data.sizes["lane"]):
            lane = data.isel(lane=number)
            yield int(lane["cell"]), int(lane["sample"]), lane
        return
    for cell in data["cell"].values:
        for sample in data["sample"].values:
            yield int(cell), int(sample), data.sel(cell=cell, sample=sample)


def trajectory_table(cell: Cell, sample: int, lane: "xr.Dataset") -> pd.DataFrame:
    """Return the trajectory of one lane as a table."""
    time, vehicles = lane["time"].values, lane["vehicle"].values
    columns: dict[str, object] = {"cell": cell.number, "sample": sample, **cell.labels}
    columns |= {"time": np.repeat(time, len(vehicles)), "vehicle": np.tile(vehicles, len(time))}
    for name in PER_VEHICLE:
        array = lane[name].transpose("time", "vehicle", ...)
        for label, values in zip(
            array[array.dims[2]].values, np.moveaxis(array.values, 2, 0), strict=True
        ):
            columns[f"attack_{label}" if name == "attack" else str(label)] = values.ravel()
    for axis, values in zip(lane["axis"].values, lane["navigator"].values.T, strict=True):
        columns[f"navigator_{axis}"] = np.repeat(values, len(vehicles))
    return pd.DataFrame(columns)
