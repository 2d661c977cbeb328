"""Stores of labelled arrays for xarray, over (cell, sample, …), or of chosen lanes over (lane, …).

`errors.zarr`, `vehicles.zarr` and `trajectories.zarr` have a chunk for each cell and shard, so a
write replaces whole chunks and touches no other shard. Each chunk ends with its checksum. The
shard's row file has a copy of the checksum, which reveals a foreign chunk. In a store of chosen
lanes, as in `replays/`, each chunk is a lane's, and the attribute `checksums` has the copies.

xarray and zarr are imported at their first use: studies without arrays do not wait for them.
"""

import uuid
import warnings
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from upath import UPath

from jaxnet.config import naming
from jaxnet.config.cells import Cell
from jaxnet.config.scenario import sources_of
from jaxnet.lazy import LazyModule
from jaxnet.store import gate
from jaxnet.store.layout import DIMENSIONS, CellLabel, Variable, cell_variables, coordinates

if TYPE_CHECKING:
    import xarray
    import xarray.indexes
    import zarr
    import zarr.codecs
    import zarr.errors
    import zarr.storage
    from zarr.abc.store import Store
    from zarr.core.buffer import Buffer

    from jaxnet.store import chunks
else:
    chunks = LazyModule("jaxnet.store.chunks")
    xarray = LazyModule("xarray")
    zarr = LazyModule("zarr")

IDENTITY = "identity"  # attribute of a store that shards fill, written last
CHECKSUMS = "checksums"  # attribute of a store of lanes, written last: by lane and array
NOBODY = -1  # source of a slot that a cell does not have
BY_SAMPLE = ("cell", "sample")  # first dimensions of a store that shards fill

Variables = Mapping[str, Variable]
NamedArrays = Mapping[str, np.ndarray]
ChunkPlace = tuple[int, ...]  # of a chunk along the first dimensions


def prepare(
    path: UPath, variables: Variables, cells: Sequence[Cell], samples: int, chunk: int
) -> str:
    """Open or create a store with room for this number of samples; return its identity."""
    coords = coordinates(cells, samples)
    group = open_for_writing(path, (*variables, "sample"))
    if group is None or not all(
        has_layout(array_in(group, name), dims_of(variable, BY_SAMPLE), chunk)
        for name, variable in variables.items()
    ):
        group = zarr.open_group(store_at(path), mode="w")
        create_arrays(group, variables, coords, BY_SAMPLE, (1, chunk))
        shared = cell_variables(variables) if "states" in variables else {}
        every = [cell_values(cell, shared, coords["time"]) for cell in cells]
        for name, variable in shared.items():
            dims = dims_of(variable, ("cell",))
            shape = [len(coords[dim]) for dim in dims[1:]]
            whole = [pad_slots(one[name].astype(variable.dtype), shape) for one in every]
            add_array(group, name, dims, np.stack(whole), variable.unit, variable.meaning)
        add_labels(group, "cell", swept_labels(cells, cells))
        group.attrs[IDENTITY] = uuid.uuid4().hex
    for name in variables:
        array = array_in(group, name)
        array.resize((array.shape[0], samples, *array.shape[2:]))
    array_in(group, "sample").resize((samples,))
    array_in(group, "sample")[:] = coords["sample"]
    consolidate(group)
    return str(group.attrs[IDENTITY])


def has_layout(array: "zarr.Array", dims: tuple[str, ...], chunk: int) -> bool:
    known = getattr(array.metadata, "dimension_names", None) or ()
    return tuple(known) == dims and array.chunks[1] == chunk


def consolidate(group: "zarr.Group") -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", zarr.errors.ZarrUserWarning)
        zarr.consolidate_metadata(group.store)


def open_for_writing(
    path: UPath, names: Sequence[str] = (), mark: str = IDENTITY
) -> "zarr.Group | None":
    """Open a store; None unless it has these arrays and the attribute `mark` of a whole store."""
    try:
        store = chunks.GatedStore(store_at(path), str(path), {}, None)
        group = zarr.open_group(store, mode="r+", use_consolidated=False, zarr_format=3)
        whole = {*names} <= {*group.array_keys()} and mark in group.attrs
    except (FileNotFoundError, ValueError, KeyError):  # none there, torn, or not of ours
        return None
    return group if whole else None


def open_store(
    path: UPath,
    sizes: Mapping[str, int] | None = None,
    due: "chunks.Due | None" = None,
    by_dask: bool = False,
) -> "xarray.Dataset":
    """Open the store at a path for reading. All its coordinates can select.

    `sizes` are those of dimensions, and `due` tells which chunks are in the store. `by_dask` gives
    arrays of dask where it is installed, for stores beyond memory; its import takes 0.3 s.
    Raises FolderError for a store that is not ours, or where a chunk turns out to be corrupt.
    """
    store = chunks.GatedStore(store_at(path), str(path), sizes or {}, due)
    read: dict[str, Any] = {} if by_dask else {"chunks": None}
    with gate.reading(path):
        try:
            data = xarray.open_zarr(store, zarr_format=3, consolidated=False, **read)
        except FileNotFoundError:
            told = "is no store of ours: it has no zarr.json, of version 3 of Zarr"
            raise gate.FolderError(f"{path} {told}") from None
        data = data[sorted(map(str, data.data_vars))]  # a folder lists them in any order
        labels = sorted(str(name) for name in data.coords if name not in data.xindexes)
        if "lane" in data.dims:
            return data.set_xindex(labels, xarray.indexes.PandasMultiIndex)
        for name in labels:
            data = data.set_xindex(name)
        return data


def lanes_in(data: "xarray.Dataset") -> Iterator[tuple[int, int]]:
    """Cell and sample of each lane in a store of trajectories."""
    cells, samples = (data[name].values.tolist() for name in ("cell", "sample"))
    yield from zip(cells, samples, strict=True) if "lane" in data.dims else product(cells, samples)


def lane_in(data: "xarray.Dataset", cell: int, sample: int) -> "xarray.Dataset | None":
    if "lane" not in data.dims:
        return data.sel(cell=cell, sample=sample) if sample in data["sample"] else None
    mine = (data["cell"].values == cell) & (data["sample"].values == sample)
    return data.isel(lane=int(np.flatnonzero(mine)[0])) if mine.any() else None


def store_at(path: UPath) -> "Store":
    if isinstance(path, Path):
        return zarr.storage.LocalStore(str(path))
    return zarr.storage.FsspecStore.from_url(str(path), storage_options=dict(path.storage_options))


def array_in(group: "zarr.Group", name: str) -> "zarr.Array":
    return cast("zarr.Array", group[name])


def dims_of(variable: Variable, first: tuple[str, ...]) -> tuple[str, ...]:
    return (*first, *variable.dims.split())


def create_arrays(
    group: "zarr.Group",
    variables: Variables,
    coords: NamedArrays,
    first: tuple[str, ...],
    chunk: tuple[int, ...],
) -> None:
    """Create empty arrays with these first dimensions and chunks along them, and coordinates."""
    every = (dim for variable in variables.values() for dim in dims_of(variable, first))
    for dim in dict.fromkeys(every):
        add_array(group, dim, (dim,), coords[dim], *DIMENSIONS[dim])
    for name, variable in variables.items():
        dims = dims_of(variable, first)
        shape = [len(coords[dim]) for dim in dims]
        group.create_array(
            name,
            shape=shape,
            chunks=(*chunk, *shape[len(chunk) :]),
            compressors=(zarr.codecs.ZstdCodec(), zarr.codecs.Crc32cCodec()),
            dtype=variable.dtype,
            fill_value=fill_value_of(variable.dtype),
            dimension_names=dims,
            attributes={"units": variable.unit, "long_name": variable.meaning},
        )


def add_array(
    group: "zarr.Group",
    name: str,
    dims: tuple[str, ...],
    values: np.ndarray,
    unit: str,
    meaning: str,
) -> None:
    dtype = str if values.dtype == object else values.dtype
    told: dict[str, Any] = {"units": unit, "long_name": meaning}
    held: dict[str, Any] = {"shape": values.shape, "dtype": dtype, "dimension_names": dims}
    group.create_array(name, **held, attributes=told)[...] = values


def cell_values(cell: Cell, variables: Variables, time: np.ndarray) -> dict[str, np.ndarray]:
    """A cell's path of the navigator [m], of shape (time, 2), and the source heard in each slot."""
    found = {"navigator": cell.scenario.navigator.jets(time)[0].T}
    if "source" in variables:
        found["source"] = sources_of(cell.scenario)
    return found


def swept_labels(cells: Sequence[Cell], along: Sequence[Cell]) -> dict[str, list[CellLabel]]:
    return {key: [cell.labels[key] for cell in along] for key in cells[0].labels}


def add_labels(group: "zarr.Group", dim: str, labels: Mapping[str, Sequence[CellLabel]]) -> None:
    """Write the swept keys as further coordinates along a dimension."""
    names = []
    for key, given in labels.items():
        values = np.array(given)
        values = values.astype(object) if values.dtype.kind in "UO" else values
        # a swept attack beside the signal `attack`
        names.append(f"{key}_name" if key in group else key.replace(" ", ""))
        swept = key not in BY_SAMPLE
        told = (naming.unit(key), naming.key_name(key)) if swept else DIMENSIONS[key]
        add_array(group, names[-1], (dim,), values, *told)
    group.attrs["coordinates"] = " ".join(names)


def series_values(
    variables: Variables, series: NamedArrays, states: Sequence[str]
) -> dict[str, np.ndarray]:
    """Values of an engine's series; `states` names the states. Headings are in (-π, π]."""
    values = {name: series[variable.series] for name, variable in variables.items()}
    if "states" in values and "heading" in states:
        values["states"], heading = values["states"].copy(), states.index("heading")
        angle = values["states"][..., heading]
        values["states"][..., heading] = np.pi - np.mod(np.pi - angle, 2 * np.pi)
    return {name: each.astype(variables[name].dtype) for name, each in values.items()}


def write_chunks(group: "zarr.Group", place: tuple[int | slice, ...], values: NamedArrays) -> None:
    """Write whole chunks, since existing ones may be torn, and also those of fill values alone."""
    for name, each in values.items():
        array = array_in(group, name).with_config({"write_empty_chunks": True})
        array[place] = pad_slots(each, array.shape[len(place) :])


def pad_slots(values: np.ndarray, shape: Sequence[int]) -> np.ndarray:
    """Pad values to this shape of their last dimensions: a cell may have fewer slots."""
    missing = np.subtract(shape, values.shape[-len(shape) :])
    if not missing.any():
        return values
    widths = [(0, 0)] * (values.ndim - len(shape)) + [(0, number) for number in missing]
    return np.pad(values, widths, constant_values=fill_value_of(values.dtype))


def fill_value_of(dtype: np.dtype | str) -> int | float:
    return np.nan if np.issubdtype(dtype, np.floating) else NOBODY


def chunk_files(
    path: UPath, variables: Variables, place: ChunkPlace
) -> Iterator[tuple[str, UPath]]:
    for name, variable in variables.items():
        whole = (*place, *[0] * len(variable.dims.split()))
        yield name, path / name / "c" / "/".join(map(str, whole))


def read_checksums(path: UPath, variables: Variables, place: ChunkPlace) -> dict[str, int]:
    return {
        name: chunks.checksum_of(cast(bytes, file.fs.cat_file(file.path, start=-chunks.CHECKSUM)))
        for name, file in chunk_files(path, variables, place)
    }


def is_intact(
    path: UPath, variables: Variables, place: ChunkPlace, written: Mapping[str, int]
) -> bool:
    """Whether the chunks at a place have the checksums that were recorded at their writing."""
    for name, file in chunk_files(path, variables, place):
        try:
            chunk = file.read_bytes()
        except FileNotFoundError:
            return False
        if chunks.checksum_of(chunk) != written.get(name) or not chunks.is_summed(chunk):
            return False
    return True


def create_lanes(
    store: "Store", variables: Variables, cells: Sequence[Cell], lanes: Sequence[tuple[Cell, int]]
) -> "zarr.Group":
    group = zarr.open_group(store, mode="w")
    coords = coordinates(cells, 0) | {"lane": np.arange(len(lanes))}
    create_arrays(group, {**variables, **cell_variables(variables)}, coords, ("lane",), (1,))
    place = {"cell": [cell.number for cell, _ in lanes], "sample": [sample for _, sample in lanes]}
    add_labels(group, "lane", place | swept_labels(cells, [cell for cell, _ in lanes]))
    return group


def write_lanes(
    group: "zarr.Group", first: int, cell: Cell, variables: Variables, series: NamedArrays
) -> None:
    """Write lanes of one cell, the first of them at the place `first`."""
    values = series_values(variables, series, cell.scenario.vehicle.states)
    count = len(next(iter(values.values())))
    same = cell_values(cell, cell_variables(variables), np.asarray(array_in(group, "time")[:]))
    values |= {name: np.broadcast_to(each, (count, *each.shape)) for name, each in same.items()}
    write_chunks(group, (slice(first, first + count),), values)


def seal(group: "zarr.Group", path: UPath, variables: Variables, lanes: int) -> None:
    """Store the checksums of all lanes, as the last step of writing."""
    every = {**variables, **cell_variables(variables)}
    group.attrs[CHECKSUMS] = [read_checksums(path, every, (lane,)) for lane in range(lanes)]
    consolidate(group)


def holds_lanes(path: UPath, variables: Variables, lanes: Sequence[tuple[int, int]]) -> bool:
    """Whether a store holds exactly these lanes (cell, sample), undamaged."""
    group = open_for_writing(path, BY_SAMPLE, CHECKSUMS)
    if group is None:
        return False
    there = [np.asarray(array_in(group, name)[:]).tolist() for name in BY_SAMPLE]
    written = cast(list[dict[str, int]], group.attrs[CHECKSUMS])
    every = {**variables, **cell_variables(variables)}
    return list(zip(*there, strict=True)) == list(lanes) and all(
        is_intact(path, every, (lane,), each) for lane, each in enumerate(written)
    )


def lane_files(
    variables: Variables, cell: Cell, sample: int, series: NamedArrays
) -> dict[str, bytes]:
    """Files of a store of one lane by name, `zarr.json` last, which makes the store valid."""
    held: dict[str, Buffer] = {}
    group = create_lanes(zarr.storage.MemoryStore(held), variables, [cell], [(cell, sample)])
    write_lanes(group, 0, cell, variables, series)
    consolidate(group)
    ordered = sorted(held, key=lambda name: name == "zarr.json")
    return {name: held[name].to_bytes() for name in ordered}
