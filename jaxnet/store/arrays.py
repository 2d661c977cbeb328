"""`errors.zarr` and `trajectories.zarr`: labelled arrays over (cell, sample, time, …), readable by xarray.

A chunk belongs to one cell and one shard (or one lane, where lanes are chosen), so a write is whole and
touches nobody else's. Lanes that were not stored are not-a-number and take no room.

`state` has a last dimension of its own name, as the contract says; its labels are therefore under
`state_name`, since xarray takes a variable named like a dimension for that dimension's coordinate.
"""

import uuid
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import google_crc32c
import numpy as np
import zarr
import zarr.errors
from upath import UPath
from zarr.codecs import Crc32cCodec, ZstdCodec
from zarr.storage import FsspecStore

from jaxnet.config.cells import Cell
from jaxnet.kinds.vehicles import HEADING
from jaxnet.store.layout import NAVIGATOR, Variable, coordinates

IDENTITY = "identity"
CHECKSUM = 4  # bytes at a chunk's end


def prepare(
    path: UPath, variables: Mapping[str, Variable], cells: Sequence[Cell], samples: int, chunk: int
) -> zarr.Group:
    """The store at this path, with room for that many samples; made if there is none that can be read."""
    coords = coordinates(cells, samples)
    group = opened(path, (*variables, "sample"))
    if group is None or any(member(group, name).chunks[1] != chunk for name in variables):
        group = zarr.open_group(store_at(path), mode="w")
        create(group, variables, coords, chunk)
        if "state" in variables:
            add_navigator(group, cells, coords)
        label_cells(group, cells)
        group.attrs[IDENTITY] = uuid.uuid4().hex  # last, so that a store that has one is whole
    for name in variables:
        array = member(group, name)
        array.resize((array.shape[0], samples, *array.shape[2:]))
    member(group, "sample").resize((samples,))
    member(group, "sample")[:] = coords["sample"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", zarr.errors.ZarrUserWarning)
        zarr.consolidate_metadata(group.store)
    return group


def opened(path: UPath, names: Sequence[str] = ()) -> zarr.Group | None:
    """The store at this path for writing, if there is one with these arrays and it was made to its end."""
    try:
        group = zarr.open_group(store_at(path), mode="r+", use_consolidated=False)
        for name in names:
            member(group, name)
    except (FileNotFoundError, ValueError, KeyError):  # none there, or its metadata is torn
        return None
    return group if IDENTITY in group.attrs else None


def store_at(path: UPath) -> Any:
    """What zarr and xarray take for a path."""
    if isinstance(path, Path):
        return str(path)
    return FsspecStore.from_url(str(path), storage_options=dict(path.storage_options))


def identity(group: zarr.Group) -> str:
    """A word that tells a store from every other, also from one that was at its path before."""
    return str(group.attrs[IDENTITY])


def member(group: zarr.Group, name: str) -> zarr.Array:
    """An array of a store."""
    array = group[name]
    assert isinstance(array, zarr.Array)
    return array


def create(
    group: zarr.Group, variables: Mapping[str, Variable], coords: Mapping[str, Any], chunk: int
) -> None:
    """Empty arrays, and the coordinates of their dimensions."""
    for dim in dict.fromkeys(dim for variable in variables.values() for dim in variable.dims):
        add(group, "state_name" if dim == "state" else dim, (dim,), coords[dim])
    member(group, "time").attrs["units"] = "s"
    for name, (dims, dtype, meaning) in variables.items():
        shape = [len(coords[dim]) for dim in dims]
        array = group.create_array(
            name,
            shape=shape,
            chunks=(1, chunk, *shape[2:]),
            compressors=(ZstdCodec(), Crc32cCodec()),
            dtype=dtype,
            fill_value=np.nan,
            dimension_names=dims,
        )
        array.attrs["long_name"] = meaning


def add(group: zarr.Group, name: str, dims: tuple[str, ...], values: np.ndarray) -> None:
    """A whole array, written at once."""
    dtype: Any = str if values.dtype == object else values.dtype
    array = group.create_array(name, shape=values.shape, dtype=dtype, dimension_names=dims)
    array[...] = values


def add_navigator(group: zarr.Group, cells: Sequence[Cell], coords: Mapping[str, Any]) -> None:
    """`navigator`, the same for all lanes of a cell."""
    paths = [cell.scenario.navigator.jets(coords["time"])[0].T for cell in cells]
    add(group, "navigator", NAVIGATOR.dims, np.stack(paths))
    member(group, "navigator").attrs["long_name"] = NAVIGATOR.meaning


def label_cells(group: zarr.Group, cells: Sequence[Cell]) -> None:
    """Swept keys as coordinates along `cell`."""
    names = ["state_name"] if "state_name" in group else []
    for key in cells[0].labels:
        values = np.array([cell.labels[key] for cell in cells])
        names.append(f"{key}_name" if key in group else key)  # a swept attack beside the signal `attack`
        add(group, names[-1], ("cell",), values.astype(object) if values.dtype.kind in "UO" else values)
    group.attrs["coordinates"] = " ".join(names)


def write(group: zarr.Group, cell: int, samples: slice, series: Mapping[str, np.ndarray]) -> None:
    """Store the series of consecutive samples of one cell, also what is not a number in every lane."""
    for name, values in series.items():
        array = member(group, name).with_config({"write_empty_chunks": True})  # or `intact` would miss them
        stored = wrapped(values) if name == "state" else values
        array[cell, samples] = stored.astype(array.dtype)


def intact(path: UPath, variables: Mapping[str, Variable], cell: int, block: int) -> bool:
    """Whether the chunks of one cell and shard are there as they were written, by their checksums."""
    for name, (dims, *_) in variables.items():
        place = (cell, block, *[0] * (len(dims) - 2))
        try:
            chunk = (path / name / "c" / "/".join(map(str, place))).read_bytes()
        except FileNotFoundError:
            return False
        if len(chunk) <= CHECKSUM:
            return False
        if google_crc32c.value(chunk[:-CHECKSUM]) != int.from_bytes(chunk[-CHECKSUM:], "little"):
            return False
    return True


def wrapped(states: np.ndarray) -> np.ndarray:
    """States with headings in (-π, π]."""
    states = states.copy()
    heading = states[..., HEADING]
    states[..., HEADING] = np.pi - np.mod(np.pi - heading, 2 * np.pi)
    return states
