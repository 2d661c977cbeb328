"""Results as a file for MATLAB: what Python has as tables and arrays, under names that MATLAB takes.

It is a file of version 5, which every MATLAB and Octave reads, and whose variables are below 2 GB.
"""

import keyword
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy import io
from upath import UPath

from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.results import Results

MOST_BYTES = 2**31 - 2**20  # of a variable, its header included
LONGEST = 63  # letters of a name
RESERVED = {"case", "catch", "end", "function", "otherwise", "parfor", "persistent", "spmd", "switch"}
STORES = ("errors", "trajectories")


def write_mat(results: Results, out: str | Path | UPath | None = None) -> UPath:
    """Write `results.mat` into the folder, or another file; raises FolderError if a variable is too large."""
    place = results.path / "results.mat" if out is None else UPath(out)
    if place.suffix != ".mat":
        raise FolderError(f"mat: a file for MATLAB ends in .mat (got {out})")
    content = dict(variables(results))
    return Folder(place.parent).put(
        place.name,
        lambda file: io.savemat(file, content, do_compression=True, oned_as="column", long_field_names=True),
    )


def variables(results: Results) -> Iterator[tuple[str, dict[str, Any]]]:
    """A structure each: rows (`lanes`), `cells`, what is swept, and the stores that there are."""
    for name in STORES:
        if (results.path / f"{name}.zarr").exists():
            data = getattr(results, name)
            refuse_large(f"{name}.zarr", data.nbytes)
            yield name, arrays_of(data)
    refuse_large("lanes/", int(results.lanes.memory_usage(deep=True).sum()))
    yield "lanes", columns(results.lanes)
    yield "cells", columns(results.cells)
    yield "swept", columns(pd.DataFrame([cell.labels for cell in results.study.cells]))


def refuse_large(name: str, size: int) -> None:
    """Raise FolderError for what a variable of the file has no room for; a structure is one variable."""
    if size > MOST_BYTES:
        raise FolderError(
            f"mat: {name} has {size / 1e9:.3g} GB, and a variable of a file for MATLAB has 2 GB at"
            " most: take fewer samples, or save fewer trajectories, as with save.trajectories={worst: 10}"
        )


def columns(table: pd.DataFrame) -> dict[str, np.ndarray]:
    """A table as a structure of columns; text as cells."""
    return named({str(name): plain_array(table[name].to_numpy()) for name in table})


def arrays_of(data: xr.Dataset) -> dict[str, Any]:
    """A store as a structure: arrays, coordinates, and `dims` with the names of each array's dimensions."""
    every = {str(name): each for name, each in {**data.data_vars, **data.coords}.items() if name != "lane"}
    dims = named({name: np.array(each.dims, dtype=object) for name, each in every.items()})
    return named({name: plain_array(each.values) for name, each in every.items()}) | {"dims": dims}


def plain_array(values: np.ndarray) -> np.ndarray:
    """Numbers as they are, everything else as cells of text."""
    if values.dtype.kind in "iufb":
        return values
    return np.array([str(value) for value in values.ravel()], dtype=object).reshape(values.shape)


def named(content: dict[str, Any]) -> dict[str, Any]:
    """The same under names that MATLAB takes, none of them twice."""
    found: dict[str, Any] = {}
    for name, each in content.items():
        valid = matlab_name(name)
        while valid in found:
            valid = f"{valid[: LONGEST - 1]}_"
        found[valid] = each
    return found


def matlab_name(name: str) -> str:
    """A name of letters, digits and underscores, the first a letter: `attack_magnitude`."""
    valid = re.sub(r"[^A-Za-z0-9_]", "_", name)
    if not valid[:1].isalpha() or keyword.iskeyword(valid) or valid in RESERVED:
        valid = f"x_{valid}"
    return valid[:LONGEST]
