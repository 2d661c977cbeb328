"""One lane again, by itself, with everything that can be seen of it."""

import shutil
from pathlib import Path

import pandas as pd

from jaxnet.engine import batch
from jaxnet.study import arrays, layout
from jaxnet.study.api import Results
from jaxnet.study.folder import FolderError
from jaxnet.study.lanes import job
from jaxnet.study.layout import Shard
from jaxnet.study.run import rows_of


def replay(results: Results, cell: int, sample: int) -> tuple[Path, pd.Series]:
    """Store the lane's trajectory under `replays/`; its path and the lane's row.

    Raises FolderError if the study has no such lane.
    """
    study = results.study
    if cell >= len(study.cells) or sample >= study.config.samples:
        raise FolderError(
            f"{results.path} has cells 0 to {len(study.cells) - 1} and samples 0 to"
            f" {study.config.samples - 1} (got cell {cell}, sample {sample})"
        )
    chosen = study.cells[cell]
    series = (*layout.ERRORS, *layout.trajectory_series([chosen]))
    outcome = batch.simulate(job(chosen.scenario, study.config.seed, [sample], series))
    path = results.path / "replays" / f"cell-{cell}-sample-{sample}.zarr"
    shutil.rmtree(path, ignore_errors=True)
    variables = layout.ERRORS | layout.TRAJECTORIES
    store = arrays.prepare(path, {name: variables[name] for name in series}, [chosen], 1, 1)
    arrays.member(store, "cell")[:], arrays.member(store, "sample")[:] = cell, sample
    arrays.write(store, 0, slice(0, 1), outcome.series)
    row = rows_of(study.config, Shard(0, chosen, range(sample, sample + 1)), outcome)
    return path, row.to_pandas().iloc[0]
