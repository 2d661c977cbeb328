"""Replay: simulate one lane alone, and save all that can be seen of it."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from upath import UPath

from jaxnet.config.cells import Cell, judged_metric
from jaxnet.config.scenario import situation_of
from jaxnet.engine import batch
from jaxnet.engine.batch import Job, Outcome
from jaxnet.kinds import registry
from jaxnet.lanes.jobs import job, source_of
from jaxnet.model import hearing
from jaxnet.model.graph import Digraph
from jaxnet.runs.shards import Program, program_of
from jaxnet.statistics import recovery
from jaxnet.store import arrays, layout, rows
from jaxnet.store.arrays import Variables, lane_in, open_store
from jaxnet.store.folder import FolderError
from jaxnet.store.layout import Shard
from jaxnet.store.results import Results

AT_LIMIT = 1e-9  # of an input: so near its limit it is limited


def replay(
    results: Results, cell: int, sample: int, engine: str | None = None
) -> tuple[UPath, pd.Series]:
    """Store the lane's trajectory under `replays/`; return its path and the lane's row.

    `engine` is the name of an engine, by default the study's own.
    Raises FolderError if the study has no such lane, or the engine cannot simulate it.
    """
    refuse_unknown(results, cell, sample)
    ((path, shard, outcome),) = replay_each(results, [(cell, sample, engine)])
    columns = rows.row_columns(results.study.config, results.study.cells)
    return path, columns.table(shard, outcome).to_pandas().iloc[0]


def replay_each(
    results: Results, wanted: Iterable[tuple[int, int, str | None]]
) -> Iterator[tuple[UPath, Shard, Outcome]]:
    """Replay lanes, by cell, sample and engine; those of one program and network side by side."""
    results.need_code()
    cells, alike = results.study.cells, dict[Program, list[tuple[str, Variables, Shard, Job]]]()
    for cell, sample, engine in wanted:
        chosen, store = with_engine(cells[cell], engine), store_of(results, cell, sample, engine)
        variables = layout.error_variables([chosen]) | layout.trajectory_variables([chosen])
        source = source_of(results.study.config, cells[cell].scenario)
        one = job(chosen.scenario, source, [sample], layout.series_of(variables))
        shard = Shard(0, chosen, range(sample, sample + 1))
        alike.setdefault(program_of(one), []).append((store, variables, shard, one))
    machine = batch.Machine(chunk=results.manifest.get("chunk"))
    for together in alike.values():
        _, network, clock, plan = together[0][-1]
        inputs = (one.inputs for *_, one in together)
        outcomes = batch.simulate_each(inputs, len(together), network, clock, plan, machine)
        for (store, variables, shard, _), outcome in zip(together, outcomes, strict=True):
            place = shard.cell, shard.samples[0]
            for name, content in arrays.lane_files(variables, *place, outcome.series).items():
                results.folder.put(f"{store}/{name}", content)
            yield results.folder.path / store, shard, outcome


def refuse_unknown(results: Results, cell: int, sample: int) -> None:
    results.need_run()
    cells = len(results.study.cells)
    samples = results.samples[cell] if cell < cells else max(results.samples)
    if cell >= cells or sample >= samples:
        there = f"cells 0 to {cells - 1} and samples 0 to {samples - 1}"
        raise FolderError(f"{results.place} has {there} (got cell {cell}, sample {sample})")


def trajectory_of(results: Results, cell: int, sample: int) -> tuple[xr.Dataset, Digraph]:
    """Trajectory of a lane and its graph; a lane that no store holds is simulated again."""
    refuse_unknown(results, cell, sample)
    results.need_code()
    lane = stored_trajectory(results, cell, sample)
    if lane is None:
        path, _ = replay(results, cell, sample)
        lane = open_store(path, results.sizes).isel(lane=0)
    return pictured(results, cell, sample, lane)


def pictured(
    results: Results, cell: int, sample: int, lane: xr.Dataset
) -> tuple[xr.Dataset, Digraph]:
    """A trajectory with what pictures show beside it, and the graph of its lane.

    `output` is what the law steers and `offset` the place in the formation, both (2, m, times) [m].
    `saturated` and `colliding`, (m, times), say whose inputs are at their limits, and who touches
    another vehicle by the keys of the metric `collisions`. The attribute `arena` has the keys of
    the metric `outside_arena`.
    """
    scenario = results.study.cells[cell].scenario
    one = job(scenario, source_of(results.study.config, scenario), [sample])
    numbers, vehicle = one.inputs.lane, one.inputs.lane.vehicle
    states, inputs = (
        lane[name].transpose(axis, "vehicle", "time").values
        for name, axis in (("states", "state"), ("inputs", "input"))
    )
    (output, *_), offset = vehicle.output_jets(states), np.zeros_like(states[:2])
    if numbers.formation is not None:
        offset = numbers.formation.jets(lane["time"].values, len(offset[0]))[0]
    saturated = colliding = np.zeros(states.shape[1:], bool)
    if vehicle.limits:
        beyond = (1 + AT_LIMIT) * inputs
        saturated = (vehicle.within_limits(beyond) != beyond).any(axis=0)
    metrics = {each.base: each for each in reversed(results.study.config.metrics)}
    if "collisions" in metrics:
        touch: Any = metrics["collisions"].of
        pairs = touch.pairs(states)
        colliding = (pairs | pairs.swapaxes(0, 1)).any(axis=1)
    both = {"output": output, "offset": offset}
    lane = lane.assign({name: (("axis", "vehicle", "time"), each) for name, each in both.items()})
    each = {"saturated": saturated, "colliding": colliding}
    lane = lane.assign({name: (("vehicle", "time"), flags) for name, flags in each.items()})
    lane.attrs["arena"] = metrics["outside_arena"].keys if "outside_arena" in metrics else None
    if not scenario.topology.differs():
        return lane, situation_of(scenario).graph
    sources, weights = one.network.hearing.sources, numbers.weights[0]
    return lane, hearing.graph_of(np.asarray(sources), np.asarray(weights))


def stored_trajectory(results: Results, cell: int, sample: int) -> xr.Dataset | None:
    """Trajectory of a lane by the study's own engine, from a replay or the store, or None."""
    path = results.file(store_of(results, cell, sample))
    if (path / "zarr.json").exists():
        return open_store(path, results.sizes).isel(lane=0)
    if not (results.path / "trajectories.zarr").exists():
        return None
    return lane_in(results.trajectories, cell, sample)


def store_of(results: Results, cell: int, sample: int, engine: str | None = None) -> str:
    own = results.study.cells[cell].scenario.engine.reference()
    other = "" if engine in (None, own) else f"-{engine}"
    return f"replays/cell-{cell}-sample-{sample}{other}.zarr"


def worst_of(results: Results) -> list[tuple[int, int]]:
    """Cell and sample of the study's worst lanes, those with the greatest judged metric over ā."""
    asked = results.study.config.recovery
    if asked is None:
        return []
    lanes = worst_of_cells(results, asked.worst)
    return recovery.worst_lanes(lanes, results.study.cells, asked.worst)


def worst_of_cells(results: Results, number: int) -> pd.DataFrame:
    """The ok lanes of each cell with the greatest judged metric: cell, sample, the metric [m]."""
    metric = judged_metric(results.study.cells)
    lanes = results.by_cell("cell", "sample", metric, where=rows.OK)
    nothing = pd.DataFrame({"cell": [], "sample": []}, dtype=int).assign(**{metric: 0.0})
    found = (recovery.worst_first(each, metric).head(number) for _, each in lanes)
    return pd.concat([nothing, *found], ignore_index=True)


def with_engine(cell: Cell, engine: str | None) -> Cell:
    """The cell with another engine at its defaults; raise FolderError if the engine refuses it."""
    if engine in (None, cell.scenario.engine.reference()):
        return cell
    chosen = registry.find("engine", str(engine))()
    scenario = cell.scenario.model_copy(update={"engine": chosen})
    for fault in chosen.faults(scenario):
        raise FolderError(f"cell {cell.number}: {fault.message}")
    return replace(cell, scenario=scenario)
