"""`errors.zarr` and `trajectories.zarr`: labelled arrays over (cell, sample, time, …), readable by xarray.

A chunk belongs to one cell and one shard, so a write is whole and touches nobody else's. It ends with its
checksum, which is kept elsewhere too: a chunk in another's place is told by it.

xarray and zarr take their time to import: who stores no arrays does not wait for them.
"""

import uuid
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import google_crc32c
import numpy as np
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.config.scenario import sources_of
from jaxnet.kinds.vehicles import HEADING
from jaxnet.store.foreign import refuse_foreign
from jaxnet.store.layout import Variable, coordinates, shared

if TYPE_CHECKING:
    import xarray
    import zarr

IDENTITY = "identity"
CHECKSUM = 4  # bytes at a chunk's end
NOBODY = -1  # is heard in a slot that a cell does not have


def prepare(
    path: UPath, variables: Mapping[str, Variable], cells: Sequence[Cell], samples: int, chunk: int
) -> "zarr.Group":
    """The store at this path, with room for that many samples; made if there is none that can be read."""
    import zarr

    coords = coordinates(cells, samples)
    group = opened(path, (*variables, "sample"))
    if group is None or not all(
        laid_out(member(group, name), variable.dims, chunk) for name, variable in variables.items()
    ):
        group = zarr.open_group(store_at(path), mode="w")
        create(group, variables, coords, (1, chunk))
        if "states" in variables:
            add_shared(group, shared(variables), cells, coords)
        add_labels(group, "cell", swept(cells, cells))
        group.attrs[IDENTITY] = uuid.uuid4().hex  # last, so that a store that has one is whole
    for name in variables:
        array = member(group, name)
        array.resize((array.shape[0], samples, *array.shape[2:]))
    member(group, "sample").resize((samples,))
    member(group, "sample")[:] = coords["sample"]
    consolidate(group)
    return group


def laid_out(array: "zarr.Array", dims: tuple[str, ...], chunk: int) -> bool:
    """Whether an array has these dimensions, and so many samples in a chunk."""
    known: Any = array.metadata.to_dict()
    return tuple(known.get("dimension_names") or ()) == dims and array.chunks[1] == chunk


def consolidate(group: "zarr.Group") -> None:
    """Have readers find all metadata in one place."""
    import zarr.errors

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", zarr.errors.ZarrUserWarning)
        zarr.consolidate_metadata(group.store)


def opened(path: UPath, names: Sequence[str] = (), mark: str = IDENTITY) -> "zarr.Group | None":
    """The store at this path for writing, if it has these arrays and the mark of one made to its end."""
    import zarr

    try:
        refuse_foreign(path)
        group = zarr.open_group(store_at(path), mode="r+", use_consolidated=False, zarr_format=3)
        for name in names:
            member(group, name)
    except (FileNotFoundError, ValueError, KeyError):  # none there, torn, or not of ours
        return None
    return group if mark in group.attrs else None


def open_store(path: UPath) -> "xarray.Dataset":
    """The store at this path; all its coordinates select, of chosen lanes several at a time."""
    from xarray import open_zarr
    from xarray.indexes import PandasMultiIndex

    refuse_foreign(path)
    data = open_zarr(store_at(path), zarr_format=3)
    labels = [str(name) for name in data.coords if name not in data.xindexes]
    if "lane" in data.dims:
        return data.set_xindex(labels, PandasMultiIndex)
    for name in labels:
        data = data.set_xindex(name)
    return data


def store_at(path: UPath) -> Any:
    """What zarr and xarray take for a path."""
    if isinstance(path, Path):
        return str(path)
    from zarr.storage import FsspecStore

    return FsspecStore.from_url(str(path), storage_options=dict(path.storage_options))


def identity(group: "zarr.Group") -> str:
    """A word that tells a store from every other, also from one that was at its path before."""
    return str(group.attrs[IDENTITY])


def member(group: "zarr.Group", name: str) -> "zarr.Array":
    """An array of a store."""
    array: Any = group[name]
    return array


def create(
    group: "zarr.Group",
    variables: Mapping[str, Variable],
    coords: Mapping[str, Any],
    chunks: tuple[int, ...],
) -> None:
    """Empty arrays, parted along their first dimensions, and the coordinates of their dimensions."""
    from zarr.codecs import Crc32cCodec, ZstdCodec

    for dim in dict.fromkeys(dim for variable in variables.values() for dim in variable.dims):
        add(group, dim, (dim,), coords[dim])
    member(group, "time").attrs["units"] = "s"
    for name, (dims, dtype, meaning, _) in variables.items():
        shape = [len(coords[dim]) for dim in dims]
        array = group.create_array(
            name,
            shape=shape,
            chunks=(*chunks, *shape[len(chunks) :]),
            compressors=(ZstdCodec(), Crc32cCodec()),
            dtype=dtype,
            fill_value=filling(dtype),
            dimension_names=dims,
        )
        array.attrs["long_name"] = meaning


def add(group: "zarr.Group", name: str, dims: tuple[str, ...], values: np.ndarray) -> None:
    """A whole array, written at once."""
    dtype: Any = str if values.dtype == object else values.dtype
    array = group.create_array(name, shape=values.shape, dtype=dtype, dimension_names=dims)
    array[...] = values


def add_shared(
    group: "zarr.Group", variables: Mapping[str, Variable], cells: Sequence[Cell], coords: Mapping[str, Any]
) -> None:
    """Arrays that all lanes of a cell share."""
    each = [of_cell(cell, variables, coords["time"]) for cell in cells]
    for name, (dims, dtype, meaning, _) in variables.items():
        shape = [len(coords[dim]) for dim in dims[1:]]
        whole = np.stack([padded(one[name].astype(dtype), shape) for one in each])
        add(group, name, dims, whole)
        member(group, name).attrs["long_name"] = meaning


def of_cell(cell: Cell, variables: Mapping[str, Variable], time: np.ndarray) -> dict[str, np.ndarray]:
    """Where the navigator of a cell is at each time [m], and whom its vehicles hear in which slot."""
    made = {
        "navigator": lambda: cell.scenario.navigator.jets(time)[0].T,
        "source": lambda: sources_of(cell.scenario),
    }
    return {name: made[name]() for name in variables}


def swept(cells: Sequence[Cell], along: Sequence[Cell]) -> dict[str, list[Any]]:
    """Values of a study's swept keys in these cells."""
    return {key: [cell.labels[key] for cell in along] for key in cells[0].labels}


def add_labels(group: "zarr.Group", dim: str, labels: Mapping[str, Sequence[Any]]) -> None:
    """Coordinates along a dimension besides its own."""
    names = []
    for key, given in labels.items():
        values = np.array(given)
        names.append(f"{key}_name" if key in group else key)  # a swept attack beside the signal `attack`
        add(group, names[-1], (dim,), values.astype(object) if values.dtype.kind in "UO" else values)
    group.attrs["coordinates"] = " ".join(names)


def stored(variables: Mapping[str, Variable], series: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What an engine's series come to in these arrays."""
    values = {name: series[variable.series] for name, variable in variables.items()}
    if "states" in values:
        values["states"] = wrapped(values["states"])
    return {name: each.astype(variables[name].dtype) for name, each in values.items()}


def write(group: "zarr.Group", place: tuple[int | slice, ...], values: Mapping[str, np.ndarray]) -> None:
    """Store values at their place along the first dimensions, also what is not a number in every lane.

    Chunks are written whole, for what is there may be torn.
    """
    for name, each in values.items():
        array = member(group, name).with_config({"write_empty_chunks": True})  # or `intact` would miss them
        array[place] = padded(each, array.shape[len(place) :])


def padded(values: np.ndarray, shape: Sequence[int]) -> np.ndarray:
    """Values that may have less slots than there is room for, in a shape of their last dimensions."""
    missing = np.subtract(shape, values.shape[-len(shape) :])
    if not missing.any():
        return values
    widths = [(0, 0)] * (values.ndim - len(shape)) + [(0, number) for number in missing]
    return np.pad(values, widths, constant_values=filling(values.dtype))


def filling(dtype: Any) -> Any:
    """What stands where nothing was written."""
    return np.nan if np.issubdtype(dtype, np.floating) else NOBODY


def checksums(path: UPath, variables: Mapping[str, Variable], place: tuple[int, ...]) -> dict[str, int]:
    """With what the chunks at a place end, by array."""
    found = {}
    for name, file in chunks(path, variables, place):
        end: Any = file.fs.cat_file(file.path, start=-CHECKSUM)
        found[name] = int.from_bytes(end, "little")
    return found


def intact(
    path: UPath, variables: Mapping[str, Variable], place: tuple[int, ...], written: Mapping[str, int]
) -> bool:
    """Whether the chunks at a place are those that were written there, by the checksums noted then."""
    for name, file in chunks(path, variables, place):
        try:
            chunk = file.read_bytes()
        except FileNotFoundError:
            return False
        if int.from_bytes(chunk[-CHECKSUM:], "little") != written.get(name):
            return False
        if google_crc32c.value(chunk[:-CHECKSUM]) != written[name]:
            return False
    return True


def chunks(
    path: UPath, variables: Mapping[str, Variable], place: tuple[int, ...]
) -> Iterator[tuple[str, UPath]]:
    """Each array's name, and its file at a place along the first dimensions."""
    for name, variable in variables.items():
        whole = (*place, *[0] * (len(variable.dims) - len(place)))
        yield name, path / name / "c" / "/".join(map(str, whole))


def wrapped(states: np.ndarray) -> np.ndarray:
    """States with headings in (-π, π]."""
    states = states.copy()
    heading = states[..., HEADING]
    states[..., HEADING] = np.pi - np.mod(np.pi - heading, 2 * np.pi)
    return states
