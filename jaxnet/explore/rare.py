"""Probability of rare failures of the defence, by subset simulation: `rare.csv`, one row per cell."""

import functools
import math
from typing import Any

import numpy as np
import pandas as pd
from scipy import special
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.config.study import Study
from jaxnet.engine import batch
from jaxnet.engine.batch import EVERYTHING, Machine
from jaxnet.explore import subsets
from jaxnet.explore.box import Box, places_of
from jaxnet.lanes.uniforms import Keyed
from jaxnet.statistics.recovery import same_thresholds, threshold
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.results import COLUMNS
from jaxnet.store.tables import read_table, write_table

RARE_FILE = "rare.csv"
REPEATS = 10  # independent runs of subset simulation


def count_rare(
    study: Study,
    folder: Folder,
    points: int,
    machine: Machine = EVERYTHING,
    progress: Steps = no_progress,
) -> UPath:
    """Write `rare.csv` cell by cell; a stored row with as many points is not computed again.

    Raises FolderError if the study has no `recovery`.
    """
    if study.config.recovery is None:
        raise FolderError("needs to know what has recovered: give recovery: {tau: 0.01}")
    rows = known_rare_rows(study, folder, points)
    known = {row["cell"] for row in rows}
    for number, cell in enumerate(study.cells):
        progress("cells", number, len(study.cells))
        if cell.number not in known and threshold(cell, study.config.recovery) > 0:
            rows.append(
                {"cell": cell.number, **cell.labels, **rare_row(study, cell, points, machine)}
            )
            table = pd.DataFrame(rows).sort_values("cell", kind="stable")
            folder.put(RARE_FILE, functools.partial(write_table, table))
    return folder.path / RARE_FILE


def known_rare_rows(study: Study, folder: Folder, points: int) -> list[dict[str, object]]:
    """Return the stored rows with the same number of points and the same thresholds."""
    if not (folder.path / RARE_FILE).exists():
        return []
    table: Any = read_table(folder.path / RARE_FILE, needed=COLUMNS[RARE_FILE].split())
    return table[(table["points"] == points) & same_thresholds(study, table)].to_dict("records")


def rare_row(study: Study, cell: Cell, points: int, machine: Machine) -> dict[str, float | int]:
    """Return the share unrecovered of a cell and its interval.

    `plain_lanes` is the number of random lanes that give an interval as narrow. Random graphs take no fixed
    number of draws. A chain keeps the graph of its first sample.
    """
    source, failed = Keyed(study.config.seed), 0
    box = Box(cell.scenario, source, places_of(cell.scenario, source))

    def height(where: np.ndarray, chains: np.ndarray) -> np.ndarray:
        nonlocal failed
        outcome = batch.simulate(box.lanes(special.ndtr(where), chains), machine)
        failed += int(np.count_nonzero(outcome.status))
        return np.where(outcome.status == 0, outcome.metrics[cell.scenario.judged], -math.inf)

    random, level = (
        np.random.default_rng([study.config.seed, cell.number]),
        threshold(cell, study.config.recovery),
    )
    found = subsets.estimate(height, len(box.places), float(level), points, REPEATS, random)
    half = (found.high - found.low) / 2
    plain_lanes = 1.96**2 * found.share * (1 - found.share) / half**2 if half else math.nan
    counts = {"lanes": found.evaluations, "failed": failed, "plain_lanes": plain_lanes}
    shares = {"share": found.share, "low": found.low, "high": found.high, "levels": found.levels}
    return {**shares, **counts, "points": points, "threshold": level}
