"""The lanes that the report shows: which they are, and where their trajectories are stored."""

import re
import warnings
from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
import xarray as xr
from upath import UPath

from jaxnet.runs.replay import replay, store_of, worst_of
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.store import layout, rows
from jaxnet.store.arrays import open_store
from jaxnet.store.results import Results

MOST_REPLAYED = 12  # whose median and worst lanes are simulated again
MOST_BYTES = 2**28  # that such a lane may take
MOST_VEHICLES = 300  # of a fleet of which each can be told from the others where it is drawn


class Watched(NamedTuple):
    """A lane with its trajectory: why it is shown, its engine if that is not the study's, and its store."""

    cell: int
    sample: int
    why: str
    engine: str | None
    path: UPath

    def arrays(self) -> xr.Dataset:
        """Its states, the navigator's path, the attack and whom vehicles retained, over time."""
        data = open_store(self.path)
        if "lane" not in data.dims:
            return data.isel(cell=self.cell, sample=self.sample)
        mine = (data["cell"].values == self.cell) & (data["sample"].values == self.sample)
        return data.isel(lane=int(np.flatnonzero(mine)[0]))


def exemplary(results: Results) -> dict[tuple[int, int], str]:
    """The median and the worst ok lane of MOST_REPLAYED cells at most, spread evenly over the study."""
    ended = np.flatnonzero(results.cells["ok"])
    spread = np.linspace(0, len(ended) - 1, min(len(ended), MOST_REPLAYED)).round().astype(int)
    found: dict[tuple[int, int], str] = {}
    for cell, lanes in results.by_cell("sample", "tail_mean", where=rows.OK, cells=ended[spread].tolist()):
        samples = lanes.sort_values("tail_mean", kind="stable")["sample"].tolist()
        found[cell, samples[-1]] = "worst of its cell"
        found.setdefault((cell, samples[(len(samples) - 1) // 2]), "median of its cell")
    return found


def replay_watched(results: Results, told: Steps = no_progress) -> Iterator[UPath]:
    """Simulate again what the report shows and no store holds; the stores, as they are made.

    The worst lanes of the study are followed by the nonlinear engine, the exemplary ones by the study's own.
    None is of large fleets, which is told.
    """
    cells = results.study.cells
    size = layout.variable_bytes(layout.trajectory_variables(cells), cells)
    vehicles = max(cell.scenario.vehicles for cell in cells)
    if size > MOST_BYTES or vehicles > MOST_VEHICLES:
        words = (
            f"lanes of {vehicles:,} vehicles, {size / 1e6:,.2f} MB each, are too large to be put in motion"
        )
        warnings.warn(f"{results.path}: {words}", stacklevel=2)
        return
    wanted: dict[tuple[int, int], str | None] = dict.fromkeys(worst_of(results), "nonlinear")
    there = {each[:2] for each in stored(results)} | set(wanted)
    wanted |= dict.fromkeys(place for place in exemplary(results) if place not in there)
    for done, ((cell, sample), engine) in enumerate(wanted.items()):
        told("lanes simulated again", done, len(wanted))
        path = results.file(store_of(results, cell, sample, engine))
        if not (path / "zarr.json").exists():
            path, _ = replay(results, cell, sample, engine)
        yield path


def watched(results: Results) -> list[Watched]:
    """All lanes that have a trajectory.

    First the worst of the study, then replayed, exemplary and other ones.
    """
    worst, known = set(worst_of(results)), exemplary(results)
    order = ["worst of the study", "replayed", *dict.fromkeys(known.values()), "stored"]
    found: dict[tuple[int, int, str | None], Watched] = {}
    for each in [*replayed(results), *stored(results)]:
        place = each[:2]
        why = "worst of the study" if place in worst else known.get(place, each.why)
        found.setdefault((*place, each.engine), each._replace(why=why))
    return sorted(found.values(), key=lambda each: order.index(each.why))


def replayed(results: Results) -> Iterator[Watched]:
    """Those in `replays/` that the study has."""
    places = (
        folder.glob("replays/cell-*.zarr/zarr.json")
        for folder in dict.fromkeys((results.folder.path, results.path))
    )
    stores = {file.parent.name: file.parent for found in places for file in found}
    for path in (stores[name] for name in sorted(stores)):
        named = re.fullmatch(r"cell-(\d+)-sample-(\d+)(?:-(\w+))?", path.stem)
        if named is None or int(named[1]) >= len(results.study.cells):
            continue
        if int(named[2]) < results.manifest["samples"]:
            yield Watched(int(named[1]), int(named[2]), "replayed", named[3], path)


def stored(results: Results) -> Iterator[Watched]:
    """Those in `trajectories.zarr`."""
    path = results.path / "trajectories.zarr"
    if not path.exists():
        return
    data = open_store(path)
    cells, samples = (data[name].values.tolist() for name in ("cell", "sample"))
    chosen = "lane" in data.dims
    for cell, sample in zip(cells, samples, strict=True) if chosen else product(cells, samples):
        yield Watched(cell, sample, "stored", None, path)
