"""`errors.zarr`, `vehicles.zarr`, `trajectories.zarr`: labelled arrays over (cell, sample, …), for xarray.

A chunk belongs to one cell and one shard, so a write replaces whole chunks and touches no other shard. Each
chunk ends with its checksum. The shard's row file has a copy of the checksum, which reveals a foreign chunk.

xarray and zarr are imported at their first use, so that studies without arrays do not wait for them.
"""

import uuid
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import google_crc32c
import numpy as np
from upath import UPath

from jaxnet.config import naming
from jaxnet.config.cells import Cell
from jaxnet.config.scenario import sources_of
from jaxnet.lazy import LazyModule
from jaxnet.store import gate
from jaxnet.store.foreign import refuse_foreign
from jaxnet.store.layout import DIMENSIONS, CellLabel, Variable, cell_variables, coordinates

if TYPE_CHECKING:
    import xarray
    import xarray.indexes
    import zarr
    import zarr.codecs
    import zarr.errors
    import zarr.storage
    from zarr.abc.store import Store

    from jaxnet.store import chunks
else:
    chunks = LazyModule("jaxnet.store.chunks")
    xarray = LazyModule("xarray")
    zarr = LazyModule("zarr")

IDENTITY_KEY = "identity"
CHECKSUM = 4  # bytes at a chunk's end
NOBODY = -1  # source of a slot that a cell does not have


def prepare(
    path: UPath, variables: Mapping[str, Variable], cells: Sequence[Cell], samples: int, chunk: int
) -> "zarr.Group":
    """Open or create the store at a path, with room for this number of samples."""
    coords = coordinates(cells, samples)
    group = open_for_writing(path, (*variables, "sample"))
    if group is None or not all(
        has_layout(array_in(group, name), variable.dims, chunk)
        for name, variable in variables.items()
    ):
        group = zarr.open_group(store_at(path), mode="w")
        create_arrays(group, variables, coords, (1, chunk))
        if "states" in variables:
            add_shared(group, cell_variables(variables), cells, coords)
        add_labels(group, "cell", swept_labels(cells, cells))
        group.attrs[IDENTITY_KEY] = uuid.uuid4().hex  # last, so that a store that has one is whole
    for name in variables:
        array = array_in(group, name)
        array.resize((array.shape[0], samples, *array.shape[2:]))
    array_in(group, "sample").resize((samples,))
    array_in(group, "sample")[:] = coords["sample"]
    consolidate(group)
    return group


def has_layout(array: "zarr.Array", dims: tuple[str, ...], chunk: int) -> bool:
    """Return whether an array has these dimensions and this number of samples in a chunk."""
    known: Any = array.metadata.to_dict()
    return tuple(known.get("dimension_names") or ()) == dims and array.chunks[1] == chunk


def consolidate(group: "zarr.Group") -> None:
    """Consolidate the metadata, so that readers find all of it in one file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", zarr.errors.ZarrUserWarning)
        zarr.consolidate_metadata(group.store)


def open_for_writing(
    path: UPath, names: Sequence[str] = (), mark: str = IDENTITY_KEY
) -> "zarr.Group | None":
    """Open the store at a path for writing; None unless it is whole and has these arrays.

    The attribute `mark` is written last, so a store that has it is whole.
    """
    try:
        refuse_foreign(path)
        group = zarr.open_group(store_at(path), mode="r+", use_consolidated=False, zarr_format=3)
        for name in names:
            array_in(group, name)
    except (FileNotFoundError, ValueError, KeyError):  # none there, torn, or not of ours
        return None
    return group if mark in group.attrs else None


def open_store(
    path: UPath, sizes: Mapping[str, int] | None = None, due: "chunks.Due | None" = None
) -> "xarray.Dataset":
    """Open the store at a path for reading. All its coordinates can select.

    `sizes` are those of dimensions, and `due` tells which chunks are in the store.
    Raises FolderError for a store that is not ours, or where a chunk turns out to be corrupt.
    """
    promises = refuse_foreign(path, sizes)
    with gate.reading(path):
        store: Any = store_at(path)
        store = zarr.storage.LocalStore(store) if isinstance(store, str) else store
        store = chunks.GatedStore(store, str(path), promises, due)
        data = xarray.open_zarr(store, zarr_format=3)
        labels = [str(name) for name in data.coords if name not in data.xindexes]
        if "lane" in data.dims:
            return data.set_xindex(labels, xarray.indexes.PandasMultiIndex)
        for name in labels:
            data = data.set_xindex(name)
        return data


def store_at(path: UPath) -> "str | Store":
    """Return what zarr and xarray accept as the place of a store."""
    if isinstance(path, Path):
        return str(path)
    return zarr.storage.FsspecStore.from_url(str(path), storage_options=dict(path.storage_options))


def store_identity(group: "zarr.Group") -> str:
    """Return the identity of a store, which differs from that of any earlier store at this path."""
    return str(group.attrs[IDENTITY_KEY])


def array_in(group: "zarr.Group", name: str) -> "zarr.Array":
    """Return an array of a store."""
    array: Any = group[name]
    return array


def create_arrays(
    group: "zarr.Group",
    variables: Mapping[str, Variable],
    coords: Mapping[str, np.ndarray],
    chunks: tuple[int, ...],
) -> None:
    """Create empty arrays, chunked along their first dimensions, and the coordinates of their dimensions."""
    for dim in dict.fromkeys(dim for variable in variables.values() for dim in variable.dims):
        add_array(group, dim, (dim,), coords[dim], *DIMENSIONS[dim])
    for name, (dims, dtype, unit, meaning, _) in variables.items():
        shape = [len(coords[dim]) for dim in dims]
        array = group.create_array(
            name,
            shape=shape,
            chunks=(*chunks, *shape[len(chunks) :]),
            compressors=(zarr.codecs.ZstdCodec(), zarr.codecs.Crc32cCodec()),
            dtype=dtype,
            fill_value=fill_value_of(dtype),
            dimension_names=dims,
        )
        array.attrs.update(units=unit, long_name=meaning)


def add_array(
    group: "zarr.Group",
    name: str,
    dims: tuple[str, ...],
    values: np.ndarray,
    unit: str,
    meaning: str,
) -> None:
    """Write a whole array at once, with the attributes `units` and `long_name`."""
    dtype: Any = str if values.dtype == object else values.dtype
    array = group.create_array(name, shape=values.shape, dtype=dtype, dimension_names=dims)
    array[...] = values
    array.attrs.update(units=unit, long_name=meaning)


def add_shared(
    group: "zarr.Group",
    variables: Mapping[str, Variable],
    cells: Sequence[Cell],
    coords: Mapping[str, np.ndarray],
) -> None:
    """Write the arrays that all lanes of a cell share."""
    each = [cell_values(cell, variables, coords["time"]) for cell in cells]
    for name, (dims, dtype, unit, meaning, _) in variables.items():
        shape = [len(coords[dim]) for dim in dims[1:]]
        whole = np.stack([pad_slots(one[name].astype(dtype), shape) for one in each])
        add_array(group, name, dims, whole, unit, meaning)


def cell_values(
    cell: Cell, variables: Mapping[str, Variable], time: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the navigator's path [m] of shape (time, 2) and the source heard in each slot, for one cell."""
    made = {
        "navigator": lambda: cell.scenario.navigator.jets(time)[0].T,
        "source": lambda: sources_of(cell.scenario),
    }
    return {name: made[name]() for name in variables}


def swept_labels(cells: Sequence[Cell], along: Sequence[Cell]) -> dict[str, list[CellLabel]]:
    """Return the values of the swept keys in the cells `along`."""
    return {key: [cell.labels[key] for cell in along] for key in cells[0].labels}


def add_labels(group: "zarr.Group", dim: str, labels: Mapping[str, Sequence[CellLabel]]) -> None:
    """Write the swept keys as further coordinates along a dimension."""
    names = []
    for key, given in labels.items():
        values = np.array(given)
        names.append(
            f"{key}_name" if key in group else key
        )  # a swept attack beside the signal `attack`
        values = values.astype(object) if values.dtype.kind in "UO" else values
        told = (
            DIMENSIONS[key]
            if key in ("cell", "sample")
            else (naming.unit(key), naming.key_name(key))
        )
        add_array(group, names[-1], (dim,), values, *told)
    group.attrs["coordinates"] = " ".join(names)


def series_values(
    variables: Mapping[str, Variable], series: Mapping[str, np.ndarray], states: Sequence[str]
) -> dict[str, np.ndarray]:
    """Convert an engine's series to the values of these arrays; `states` are the names of the states."""
    values = {name: series[variable.series] for name, variable in variables.items()}
    if "states" in values and "heading" in states:
        values["states"] = wrap_headings(values["states"], states.index("heading"))
    return {name: each.astype(variables[name].dtype) for name, each in values.items()}


def write_chunks(
    group: "zarr.Group", place: tuple[int | slice, ...], values: Mapping[str, np.ndarray]
) -> None:
    """Write values at a place along the first dimensions, also chunks of fill values alone.

    Chunks are written whole, since an existing chunk may be torn.
    """
    for name, each in values.items():
        array = array_in(group, name).with_config(
            {"write_empty_chunks": True}
        )  # or `intact` would miss them
        array[place] = pad_slots(each, array.shape[len(place) :])


def pad_slots(values: np.ndarray, shape: Sequence[int]) -> np.ndarray:
    """Pad values to this shape of their last dimensions: a cell may have fewer slots than its array."""
    missing = np.subtract(shape, values.shape[-len(shape) :])
    if not missing.any():
        return values
    widths = [(0, 0)] * (values.ndim - len(shape)) + [(0, number) for number in missing]
    return np.pad(values, widths, constant_values=fill_value_of(values.dtype))


def fill_value_of(dtype: np.dtype | str) -> int | float:
    """Return the fill value of an array of this type."""
    return np.nan if np.issubdtype(dtype, np.floating) else NOBODY


def read_checksums(
    path: UPath, variables: Mapping[str, Variable], place: tuple[int, ...]
) -> dict[str, int]:
    """Return the stored checksum of the chunk of each array at a place."""
    found = {}
    for name, file in chunk_files(path, variables, place):
        end: Any = file.fs.cat_file(file.path, start=-CHECKSUM)
        found[name] = int.from_bytes(end, "little")
    return found


def is_intact(
    path: UPath,
    variables: Mapping[str, Variable],
    place: tuple[int, ...],
    written: Mapping[str, int],
) -> bool:
    """Return whether the chunks at a place have the checksums that were recorded when they were written."""
    for name, file in chunk_files(path, variables, place):
        try:
            chunk = file.read_bytes()
        except FileNotFoundError:
            return False
        if int.from_bytes(chunk[-CHECKSUM:], "little") != written.get(name):
            return False
        if google_crc32c.value(chunk[:-CHECKSUM]) != written[name]:
            return False
    return True


def chunk_files(
    path: UPath, variables: Mapping[str, Variable], place: tuple[int, ...]
) -> Iterator[tuple[str, UPath]]:
    """Yield the name of each array and the file of its chunk at a place along the first dimensions."""
    for name, variable in variables.items():
        whole = (*place, *[0] * (len(variable.dims) - len(place)))
        yield name, path / name / "c" / "/".join(map(str, whole))


def wrap_headings(states: np.ndarray, heading: int) -> np.ndarray:
    """Return states with headings, those of this number, in (-π, π]."""
    states = states.copy()
    states[..., heading] = np.pi - np.mod(np.pi - states[..., heading], 2 * np.pi)
    return states
