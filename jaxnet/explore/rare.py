"""How rarely the defence fails, where plain lanes would hardly show it: a row a cell in `rare.csv`."""

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
from jaxnet.statistics.recovery import threshold
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.results import read_table

RARE_FILE = "rare.csv"
REPEATS = 10


def count_rare(
    study: Study, folder: Folder, points: int, machine: Machine = EVERYTHING, told: Steps = no_progress
) -> UPath:
    """Write `rare.csv`, cell by cell; one that is there, of as many points, is not done again.

    Raises FolderError if the study does not say what has recovered.
    """
    if study.config.recovery is None:
        raise FolderError("needs to know what has recovered: give recovery: {tau: 0.01}")
    tau, rows = study.config.recovery.tau, known_rare_rows(folder, points, study.config.recovery.tau)
    known = {row["cell"] for row in rows}
    for number, cell in enumerate(study.cells):
        told("cells", number, len(study.cells))
        if cell.number not in known and threshold(cell, tau) > 0:
            rows.append({"cell": cell.number, **cell.labels, **rare_row(study, cell, points, tau, machine)})
            table = pd.DataFrame(rows).sort_values("cell", kind="stable")
            folder.put(RARE_FILE, lambda file, table=table: table.to_csv(file, index=False))
    return folder.path / RARE_FILE


def known_rare_rows(folder: Folder, points: int, tau: float) -> list[dict[str, Any]]:
    """Rows that the folder holds of the same question."""
    if not (folder.path / RARE_FILE).exists():
        return []
    table: Any = read_table(folder.path / RARE_FILE)
    return table[(table["points"] == points) & (table["tau"] == tau)].to_dict("records")


def rare_row(study: Study, cell: Cell, points: int, tau: float, machine: Machine) -> dict[str, Any]:
    """The share of a cell, its interval, and what plain lanes would have taken for one as narrow.

    What no fixed number of draws can make, a random graph, stays that of the sample that a chain began from.
    """
    source, failed = Keyed(study.config.seed), 0
    box = Box(cell.scenario, source, places_of(cell.scenario, source))

    def height(where: np.ndarray, chains: np.ndarray) -> np.ndarray:
        nonlocal failed
        outcome = batch.simulate(box.lanes(special.ndtr(where), chains), machine)
        failed += int(np.count_nonzero(outcome.status))
        return np.where(outcome.status == 0, outcome.metrics["tail_mean"], -math.inf)

    random, level = np.random.default_rng([study.config.seed, cell.number]), threshold(cell, tau)
    found = subsets.estimate(height, len(box.places), float(level), points, REPEATS, random)
    half = (found.high - found.low) / 2
    plain = 1.96**2 * found.share * (1 - found.share) / half**2 if half else math.nan
    counts = {"lanes": found.evaluations, "failed": failed, "plain_lanes": plain}
    shares = {"share": found.share, "low": found.low, "high": found.high, "levels": found.levels}
    return {**shares, **counts, "points": points, "tau": tau}
