"""Stores of chosen lanes, `trajectories.zarr` and `replays/`: arrays over (lane, time, …), one chunk a lane.

`cell`, `sample` and the swept keys are coordinates along `lane`. The size of a store is that of its lanes.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.lazy import LazyModule
from jaxnet.store import arrays
from jaxnet.store.layout import Variable, along_lanes, cell_variables, coordinates

if TYPE_CHECKING:
    import zarr
    import zarr.storage
    from zarr.abc.store import Store
    from zarr.core.buffer import Buffer
else:
    zarr = LazyModule("zarr")

CHECKSUMS = "checksums"  # of the chunks of each lane, by array


def create_lanes(
    store: "str | Store",
    variables: Mapping[str, Variable],
    cells: Sequence[Cell],
    lanes: Sequence[tuple[Cell, int]],
) -> "zarr.Group":
    """Create a store for these lanes of a study, each a cell and a sample."""
    group = zarr.open_group(store, mode="w")
    coords = coordinates(cells, 0) | {"lane": np.arange(len(lanes))}
    arrays.create_arrays(group, along_lanes(variables), coords, (1,))
    place = {"cell": [cell.number for cell, _ in lanes], "sample": [sample for _, sample in lanes]}
    arrays.add_labels(
        group, "lane", place | arrays.swept_labels(cells, [cell for cell, _ in lanes])
    )
    return group


def write_lanes(
    group: "zarr.Group",
    first: int,
    cell: Cell,
    variables: Mapping[str, Variable],
    series: Mapping[str, np.ndarray],
) -> None:
    """Write lanes of one cell, the first of them at the place `first`."""
    values = arrays.series_values(variables, series, cell.scenario.vehicle.states)
    count = len(next(iter(values.values())))
    same = arrays.cell_values(
        cell, cell_variables(variables), np.asarray(arrays.array_in(group, "time")[:])
    )
    values |= {name: np.broadcast_to(each, (count, *each.shape)) for name, each in same.items()}
    arrays.write_chunks(group, (slice(first, first + count),), values)


def seal(group: "zarr.Group", path: UPath, variables: Mapping[str, Variable], lanes: int) -> None:
    """Store the checksums of all lanes, as the last step of writing."""
    group.attrs[CHECKSUMS] = [
        arrays.read_checksums(path, along_lanes(variables), (lane,)) for lane in range(lanes)
    ]
    arrays.consolidate(group)


def holds(path: UPath, variables: Mapping[str, Variable], lanes: Sequence[tuple[int, int]]) -> bool:
    """Return whether a store holds exactly these lanes (cell, sample), undamaged."""
    group = arrays.open_for_writing(path, ("cell", "sample"), CHECKSUMS)
    if group is None:
        return False
    there = [np.asarray(arrays.array_in(group, name)[:]).tolist() for name in ("cell", "sample")]
    written: Any = group.attrs[CHECKSUMS]
    return list(zip(*there, strict=True)) == list(lanes) and all(
        arrays.is_intact(path, along_lanes(variables), (lane,), each)
        for lane, each in enumerate(written)
    )


def files_of(
    variables: Mapping[str, Variable], cell: Cell, sample: int, series: Mapping[str, np.ndarray]
) -> dict[str, bytes]:
    """Return the files of a store of one lane by name, `zarr.json` last, which makes the store valid."""
    held: dict[str, Buffer] = {}
    group = create_lanes(zarr.storage.MemoryStore(held), variables, [cell], [(cell, sample)])
    write_lanes(group, 0, cell, variables, series)
    arrays.consolidate(group)
    return {
        name: held[name].to_bytes() for name in sorted(held, key=lambda name: name == "zarr.json")
    }
