"""One lane again, by itself, with everything that can be seen of it."""

from dataclasses import replace

import numpy as np
import pandas as pd
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.engine import batch
from jaxnet.engine.batch import Machine
from jaxnet.kinds import registry
from jaxnet.lanes.jobs import job
from jaxnet.statistics import recovery
from jaxnet.store import lane_store, layout, rows
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.layout import Shard
from jaxnet.store.results import Results


def replay(results: Results, cell: int, sample: int, engine: str | None = None) -> tuple[UPath, pd.Series]:
    """Store the lane's trajectory under `replays/`; its path and the lane's row.

    `engine` names one to use instead of the study's own.
    Raises FolderError if the study has no such lane, or the engine cannot simulate it.
    """
    study, samples = results.study, results.manifest["samples"]
    if cell >= len(study.cells) or sample >= samples:
        raise FolderError(
            f"{results.path} has cells 0 to {len(study.cells) - 1} and samples 0 to"
            f" {samples - 1} (got cell {cell}, sample {sample})"
        )
    chosen = with_engine(study.cells[cell], engine)
    variables = layout.ERRORS | layout.trajectory_variables([chosen])
    machine = Machine(chunk=results.manifest.get("chunk"))
    lane = job(chosen.scenario, study.config.seed, [sample], layout.series_of(variables))
    outcome = batch.simulate(lane, machine)
    path, folder = path_of(results, cell, sample, engine), Folder(results.path)
    for name, content in lane_store.files_of(variables, chosen, sample, outcome.series).items():
        file = str((path / name).relative_to(results.path))
        folder.put(file, lambda file, content=content: file.write(content))
    types = rows.column_types(study.config, study.cells)
    row = rows.table_of(Shard(0, chosen, range(sample, sample + 1)), outcome, types)
    return path, row.to_pandas().iloc[0]


def path_of(results: Results, cell: int, sample: int, engine: str | None = None) -> UPath:
    """Where a replayed lane is stored, by the study's own engine or another."""
    own = results.study.cells[cell].scenario.engine.reference()
    other = "" if engine in (None, own) else f"-{engine}"
    return results.path / "replays" / f"cell-{cell}-sample-{sample}{other}.zarr"


def worst_of(results: Results) -> list[tuple[int, int]]:
    """Cell and sample of the lanes to be looked at, those with the greatest mean error for their ā."""
    asked = results.study.config.recovery
    if asked is None:
        return []
    return recovery.worst(worst_of_cells(results, asked.worst), results.study.cells, asked.worst)


def worst_of_cells(results: Results, number: int) -> pd.DataFrame:
    """The ok lanes of each cell with the greatest mean errors: cell, sample, tail_mean."""
    lanes = results.by_cell("cell", "sample", "tail_mean", where=rows.OK)
    found = [each.nlargest(number, "tail_mean") for _, each in lanes]
    nothing = pd.DataFrame({"cell": np.empty(0, int), "sample": np.empty(0, int), "tail_mean": np.empty(0)})
    return pd.concat(found, ignore_index=True) if found else nothing


def with_engine(cell: Cell, engine: str | None) -> Cell:
    """The cell under this engine with its defaults; itself if that is its own."""
    if engine in (None, cell.scenario.engine.reference()):
        return cell
    chosen = registry.find("engine", str(engine))()
    scenario = cell.scenario.model_copy(update={"engine": chosen})
    for fault in chosen.faults(scenario):
        raise FolderError(f"cell {cell.number}: {fault.message}")
    return replace(cell, scenario=scenario)
