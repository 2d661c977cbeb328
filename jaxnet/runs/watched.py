"""The lanes that the report shows, and the stores of their trajectories."""

import re
import warnings
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import xarray as xr
from upath import UPath

from jaxnet.config.cells import judged_metric
from jaxnet.runs.replay import replay_each, store_of, worst_of, worst_of_cells
from jaxnet.statistics.groups import evenly
from jaxnet.statistics.recovery import worst_first
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.store import layout, rows
from jaxnet.store.arrays import lane_in, lanes_in, open_store
from jaxnet.store.results import Results

WORST_OF_ALL = "worst lane of the study"
WORST = "worst per ā"
MOST_REPLAYED = 12  # whose median and worst lanes are simulated again
MOST_BYTES = 2**28  # that such a lane may take
MOST_VEHICLES = 300  # of a fleet of which each can be told from the others where it is drawn


class Watched(NamedTuple):
    """A lane with a trajectory: why it is shown, its engine (None: the study's own), its store."""

    cell: int
    sample: int
    why: str
    engine: str | None
    path: UPath

    def arrays(self, of: Results) -> xr.Dataset:
        found = lane_in(open_store(self.path, of.sizes), self.cell, self.sample)
        assert found is not None
        return found


def exemplary(results: Results) -> dict[tuple[int, int], str]:
    """The study's worst ok lane, and of up to MOST_REPLAYED cells the median and the worst one."""
    ended = np.flatnonzero(results.cells["ok"]).tolist()
    metric, chosen = judged_metric(results.study.cells), evenly(ended, MOST_REPLAYED)
    first = worst_first(worst_of_cells(results, 1), metric).head(1)
    places = zip(first["cell"].tolist(), first["sample"].tolist(), strict=True)
    found = dict.fromkeys(places, WORST_OF_ALL)
    for cell, lanes in results.by_cell("sample", metric, where=rows.OK, cells=chosen):
        samples = worst_first(lanes, metric)["sample"].tolist()
        found.setdefault((cell, samples[0]), "worst of its cell")
        found.setdefault((cell, samples[len(samples) // 2]), "median of its cell")
    return found


def replay_watched(results: Results, told: Steps = no_progress) -> Iterator[UPath]:
    """Simulate the lanes of the report that no store holds; yield each store.

    The nonlinear engine simulates the worst lanes where a law may be singular, unless inputs are
    held; the study's own engine simulates the others, and lanes that were given up. Large fleets
    are left out, with a warning.
    """
    if fleet := too_large(results):
        warnings.warn(f"{results.place}: {fleet}, are too large to be put in motion", stacklevel=2)
        return
    yield from (path for path in watched_stores(results).values() if (path / "zarr.json").exists())
    while missing := missing_lanes(results):  # once more after the nonlinear engine gave up
        replays = replay_each(results, missing)
        for done in range(len(missing)):
            told("lanes simulated again", done, len(missing))
            yield next(replays)[0]


def lanes_again(results: Results) -> int:
    """The number of lanes that `replay_watched` simulates."""
    if results.missing or not results.has_run or too_large(results):
        return 0
    return len(missing_lanes(results))


def missing_lanes(results: Results) -> list[tuple[int, int, str | None]]:
    paths = watched_stores(results).items()
    return [lane for lane, path in paths if not (path / "zarr.json").exists()]


def gave_up(results: Results, cell: int, sample: int, engine: str | None) -> bool:
    """Whether a replay by another engine ended too early, though the study's lane is ok."""
    path = results.file(store_of(results, cell, sample, engine))
    if not engine or not (path / "zarr.json").exists():
        return False
    row, last = results.row(cell, sample), open_store(path)["states"].isel(time=-1)
    return row is not None and bool(row.loc["status"] == "ok") and bool(last.isnull().all())


def too_large(results: Results) -> str:
    """The size of lanes that are not put in motion, "" of others."""
    cells = results.study.cells
    size = layout.variable_bytes(layout.trajectory_variables(cells), cells)
    vehicles = max(cell.scenario.vehicles for cell in cells)
    if size <= MOST_BYTES and vehicles <= MOST_VEHICLES:
        return ""
    return f"lanes of {vehicles:,} vehicles, {size / 1e6:,.2f} MB each"


def watched_stores(results: Results) -> dict[tuple[int, int, str | None], UPath]:
    """Cell, sample and engine of the lanes that the page shows without a stored run of theirs."""
    there, worst = {each[:2] for each in stored_lanes(results)}, worst_of(results)
    wanted: dict[tuple[int, int], str | None] = dict.fromkeys([*worst, *exemplary(results)])
    for at in worst:
        scenario = results.study.cells[at[0]].scenario
        by_law = scenario.vehicle.singular and not scenario.engine.samples
        if by_law and not gave_up(results, *at, "nonlinear"):
            wanted[at] = "nonlinear"
    shown = ((at, by) for at, by in wanted.items() if by or at not in there)
    return {(*at, by): results.file(store_of(results, *at, by)) for at, by in shown}


def watched(results: Results) -> list[Watched]:
    known = exemplary(results)
    order = [WORST_OF_ALL, WORST, "replayed", *dict.fromkeys(known.values()), "stored"]
    first = {place: why for place, why in known.items() if why == WORST_OF_ALL}
    known |= dict.fromkeys(worst_of(results), WORST) | first
    found: dict[tuple[int, int, str | None], Watched] = {}
    for each in [*replayed_lanes(results), *stored_lanes(results)]:
        why = known.get(each[:2], each.why)
        if not gave_up(results, *each[:2], each.engine):
            found.setdefault((*each[:2], each.engine), each._replace(why=why))
    return sorted(found.values(), key=lambda each: (order.index(each.why), bool(each.engine)))


def replayed_lanes(results: Results) -> Iterator[Watched]:
    places = dict.fromkeys((results.folder.path, results.path))
    files = (file for place in places for file in place.glob("replays/cell-*.zarr/zarr.json"))
    stores = {file.parent.name: file.parent for file in files}
    for _, path in sorted(stores.items()):
        if named := re.fullmatch(r"cell-(\d+)-sample-(\d+)(?:-(\w+))?", path.stem):
            cell, sample = int(named[1]), int(named[2])
            if cell < len(results.study.cells) and sample < results.samples[cell]:
                yield Watched(cell, sample, "replayed", named[3], path)


def stored_lanes(results: Results) -> Iterator[Watched]:
    path = results.path / "trajectories.zarr"
    if path.exists():
        for cell, sample in lanes_in(open_store(path, results.sizes)):
            yield Watched(cell, sample, "stored", None, path)
