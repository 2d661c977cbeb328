"""Results as a file for MATLAB: tables and arrays under names that MATLAB accepts.

The file has version 5, which every MATLAB and Octave reads. Its variables are below 2 GB.
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

from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.results import Results

MOST_VARIABLE_BYTES = 2**31 - 2**20  # of a variable, its header included
LONGEST_NAME = 63  # letters of a name
RESERVED = {
    "case",
    "catch",
    "end",
    "function",
    "otherwise",
    "parfor",
    "persistent",
    "spmd",
    "switch",
}
StructField = TypeVar("StructField")
Struct = dict[str, np.ndarray | dict[str, np.ndarray]]  # a structure of MATLAB
STORES = ("errors", "vehicles", "trajectories")


def write_mat(results: Results, out: str | Path | UPath | None = None) -> UPath:
    """Write `results.mat` into the folder, or another file; raise FolderError if a variable is too large."""
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


def structs_of(
    results: Results,
) -> Iterator[tuple[str, Mapping[str, np.ndarray | dict[str, np.ndarray]]]]:
    """Yield the structures of the file: the stores, the rows (`lanes`), `cells`, and the swept keys."""
    for name in STORES:
        if (results.path / f"{name}.zarr").exists():
            data = getattr(results, name)
            refuse_large(f"{name}.zarr", data.nbytes)
            yield name, array_struct(data)
    refuse_large("lanes/", int(results.lanes.memory_usage(deep=True).sum()))
    yield "lanes", column_struct(results.lanes)
    yield "cells", column_struct(results.cells)
    yield "swept", column_struct(pd.DataFrame([cell.labels for cell in results.study.cells]))


def refuse_large(name: str, size: int) -> None:
    """Raise FolderError for a structure too large for a variable of the file."""
    if size > MOST_VARIABLE_BYTES:
        raise FolderError(
            f"mat: {name} has {size / 1e9:.3g} GB, and a variable of a file for MATLAB has 2 GB at"
            " most: take fewer samples, or save fewer trajectories, as with save.trajectories={worst: 10}"
        )


def column_struct(table: pd.DataFrame) -> dict[str, np.ndarray]:
    """Return a table as a structure of columns, with text as cell arrays."""
    return valid_names({str(name): plain_array(table[name].to_numpy()) for name in table})


def array_struct(data: xr.Dataset) -> Struct:
    """Return a store as a structure of arrays and coordinates; `dims` names the dimensions of each array."""
    every = {
        str(name): each
        for name, each in {**data.data_vars, **data.coords}.items()
        if name != "lane"
    }
    dims = valid_names({name: np.array(each.dims, dtype=object) for name, each in every.items()})
    return valid_names({name: plain_array(each.values) for name, each in every.items()}) | {
        "dims": dims
    }


def plain_array(values: np.ndarray) -> np.ndarray:
    """Return numbers unchanged, and any other values as an array of text."""
    if values.dtype.kind in "iufb":
        return values
    return np.array([str(value) for value in values.ravel()], dtype=object).reshape(values.shape)


def valid_names(content: dict[str, StructField]) -> dict[str, StructField]:
    """Return the content under distinct names that MATLAB accepts."""
    found: dict[str, StructField] = {}
    for name, each in content.items():
        valid = matlab_name(name)
        while valid in found:
            valid = f"{valid[: LONGEST_NAME - 1]}_"
        found[valid] = each
    return found


def matlab_name(name: str) -> str:
    """Return a name of letters, digits and underscores that starts with a letter: `attack_magnitude`."""
    valid = re.sub(r"[^A-Za-z0-9_]", "_", name)
    if not valid[:1].isalpha() or keyword.iskeyword(valid) or valid in RESERVED:
        valid = f"x_{valid}"
    return valid[:LONGEST_NAME]
