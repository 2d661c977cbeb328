"""`trajectories.zarr` where lanes are chosen, and `replays/`: arrays over (lane, time, …), a chunk a lane.

`cell`, `sample` and the swept keys are coordinates along `lane`, so a store is as large as what was chosen.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.store import arrays
from jaxnet.store.layout import Variable, along_lanes, coordinates, shared

if TYPE_CHECKING:
    import zarr
    from zarr.core.buffer import Buffer

CHECKSUMS = "checksums"  # of the chunks of each lane, by array


def create_lanes(
    store: Any, variables: Mapping[str, Variable], cells: Sequence[Cell], lanes: Sequence[tuple[Cell, int]]
) -> "zarr.Group":
    """A new store with room for these lanes of a study alone, each a cell and a sample."""
    import zarr

    group = zarr.open_group(store, mode="w")
    coords = coordinates(cells, 0) | {"lane": np.arange(len(lanes))}
    arrays.create(group, along_lanes(variables), coords, (1,))
    place = {"cell": [cell.number for cell, _ in lanes], "sample": [sample for _, sample in lanes]}
    arrays.add_labels(group, "lane", place | arrays.swept(cells, [cell for cell, _ in lanes]))
    return group


def write_lanes(
    group: "zarr.Group",
    first: int,
    cell: Cell,
    variables: Mapping[str, Variable],
    series: Mapping[str, np.ndarray],
) -> None:
    """Store lanes of one cell from a place on."""
    values = arrays.stored(variables, series)
    count = len(next(iter(values.values())))
    same = arrays.of_cell(cell, shared(variables), np.asarray(arrays.member(group, "time")[:]))
    values |= {name: np.broadcast_to(each, (count, *each.shape)) for name, each in same.items()}
    arrays.write(group, (slice(first, first + count),), values)


def seal(group: "zarr.Group", path: UPath, variables: Mapping[str, Variable], lanes: int) -> None:
    """Note the checksums of chosen lanes, all of which are written."""
    group.attrs[CHECKSUMS] = [
        arrays.checksums(path, along_lanes(variables), (lane,)) for lane in range(lanes)
    ]
    arrays.consolidate(group)


def holds(path: UPath, variables: Mapping[str, Variable], lanes: Sequence[tuple[int, int]]) -> bool:
    """Whether a store holds just these chosen lanes, cell and sample, as they were written."""
    group = arrays.opened(path, ("cell", "sample"), CHECKSUMS)
    if group is None:
        return False
    there = [np.asarray(arrays.member(group, name)[:]).tolist() for name in ("cell", "sample")]
    written: Any = group.attrs[CHECKSUMS]
    return list(zip(*there, strict=True)) == list(lanes) and all(
        arrays.intact(path, along_lanes(variables), (lane,), each) for lane, each in enumerate(written)
    )


def files_of(
    variables: Mapping[str, Variable], cell: Cell, sample: int, series: Mapping[str, np.ndarray]
) -> dict[str, bytes]:
    """The files of a store of one lane; the last makes it one."""
    from zarr.storage import MemoryStore

    held: dict[str, Buffer] = {}
    group = create_lanes(MemoryStore(held), variables, [cell], [(cell, sample)])
    write_lanes(group, 0, cell, variables, series)
    arrays.consolidate(group)
    return {name: held[name].to_bytes() for name in sorted(held, key=lambda name: name == "zarr.json")}
