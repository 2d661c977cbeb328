"""Results for other programs: a file for MATLAB and Octave, or trajectories as CSV.

A file of version 5, which every MATLAB and Octave reads, has variables below 2 GB, under names that
MATLAB accepts. The CSV files have a row for each time and vehicle, with the columns cell, sample,
the swept keys, time [s], vehicle, then states, inputs, attack signal and navigator.
"""

import keyword
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd
import xarray as xr
from scipy import io
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.store.arrays import lane_in, lanes_in
from jaxnet.store.folder import STORES, Folder, FolderError
from jaxnet.store.results import Results
from jaxnet.store.tables import csv_text

MOST_VARIABLE_BYTES = 2**31 - 2**20  # of a variable, its header included
LONGEST_NAME = 63  # letters of a name
RESERVED = "case catch end function otherwise parfor persistent spmd switch"
PER_VEHICLE = ("states", "inputs", "attack")
StructField = TypeVar("StructField")
Struct = Mapping[str, np.ndarray | dict[str, np.ndarray]]  # a structure of MATLAB


def write_mat(results: Results, out: str | Path | UPath | None = None) -> UPath:
    place = results.path / "results.mat" if out is None else UPath(out)
    if place.suffix != ".mat":
        raise FolderError(f"mat: a file for MATLAB ends in .mat (got {out})")
    results.need_run()
    content = dict(structs_of(results))
    return Folder(place.parent).put(
        place.name,
        lambda file: io.savemat(
            file, content, do_compression=True, oned_as="column", long_field_names=True
        ),
    )


def structs_of(results: Results) -> Iterator[tuple[str, Struct]]:
    """Yield the structures of the file: the stores, the rows (`lanes`), `cells`, the swept keys.

    A store has arrays, coordinates, and `dims`, which names the dimensions of each.
    """
    for store in STORES:
        name = store.removesuffix(".zarr")
        if (results.path / store).exists():
            data = getattr(results, name)
            refuse_large(store, data.nbytes)
            every = {str(key): each for key, each in data.variables.items() if key != "lane"}
            dims = {key: np.array(each.dims, dtype=object) for key, each in every.items()}
            found = {key: plain_array(each.values) for key, each in every.items()}
            yield name, {**valid_names(found), "dims": valid_names(dims)}
    refuse_large("lanes/", int(results.lanes.memory_usage(deep=True).sum()))
    yield "lanes", column_struct(results.lanes)
    yield "cells", column_struct(results.cells)
    yield "swept", column_struct(pd.DataFrame([cell.labels for cell in results.study.cells]))


def refuse_large(name: str, size: int) -> None:
    if size > MOST_VARIABLE_BYTES:
        raise FolderError(
            f"mat: {name} has {size / 1e9:.3g} GB, and a variable of a file for MATLAB has 2 GB at"
            " most: take fewer samples, or save fewer trajectories, as with"
            " save.trajectories={worst: 10}"
        )


def column_struct(table: pd.DataFrame) -> dict[str, np.ndarray]:
    return valid_names({str(name): plain_array(table[name].to_numpy()) for name in table})


def plain_array(values: np.ndarray) -> np.ndarray:
    if values.dtype.kind in "iufb":
        return values
    return np.array([str(value) for value in values.ravel()], dtype=object).reshape(values.shape)


def valid_names(content: Mapping[str, StructField]) -> dict[str, StructField]:
    found: dict[str, StructField] = {}
    for name, each in content.items():
        valid = re.sub(r"[^A-Za-z0-9_]", "_", name)
        if not valid[:1].isalpha() or keyword.iskeyword(valid) or valid in RESERVED.split():
            valid = f"x_{valid}"
        valid = valid[:LONGEST_NAME]
        while valid in found:
            valid = f"{valid[: LONGEST_NAME - 1]}_"
        found[valid] = each
    return found


def write_csv(results: Results, out: str | Path | UPath | None = None) -> UPath:
    """Write `csv/cell-C-sample-S.csv` of each stored lane, or into another folder; return it."""
    folder = Folder(results.folder.path / "csv" if out is None else out)
    data = results.trajectories
    for cell, sample in lanes_in(data):
        lane = lane_in(data, int(cell), int(sample))
        assert lane is not None
        table = trajectory_table(results.study.cells[cell], sample, lane)
        folder.put(f"cell-{cell}-sample-{sample}.csv", csv_text(table).encode())
    return folder.path


def trajectory_table(cell: Cell, sample: int, lane: xr.Dataset) -> pd.DataFrame:
    time, vehicles = lane["time"].values, lane["vehicle"].values
    columns: dict[str, object] = {"cell": cell.number, "sample": sample, **cell.labels}
    columns |= {"time": np.repeat(time, len(vehicles)), "vehicle": np.tile(vehicles, len(time))}
    for name in PER_VEHICLE:
        array = lane[name].transpose("time", "vehicle", ...)
        for label in array[array.dims[2]].values:
            column = f"attack_{label}" if name == "attack" else str(label)
            columns[column] = array.sel({array.dims[2]: label}).values.ravel()
    for axis, values in zip(lane["axis"].values, lane["navigator"].values.T, strict=True):
        columns[f"navigator_{axis}"] = np.repeat(values, len(vehicles))
    return pd.DataFrame(columns)
