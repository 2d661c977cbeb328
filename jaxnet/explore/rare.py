"""Probability of rare failures of the defence, by subset simulation: `rare.csv`, one row per cell.

Subset simulation (Au and Beck, 2001) takes standard normal numbers. The probability of exceeding a
level is a product of conditional probabilities that are not small: a tenth of the points over one
threshold is over the next threshold. Markov chains start from that tenth. They preserve the normal
distribution and stay over the threshold: the proposal x ← √(1 − b²) x + b ξ is rejected below it
(Papaioannou, Betz, Zwirglmaier and Straub, 2015). The step b adapts to the share of accepted steps.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.config.study import Study
from jaxnet.engine import batch
from jaxnet.engine.batch import EVERYTHING
from jaxnet.explore.box import Box, places_of
from jaxnet.explore.cells import AnalysisRow, CellTable
from jaxnet.lanes.uniforms import Keyed
from jaxnet.lazy import special
from jaxnet.statistics.recovery import CONFIDENCE, threshold
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.store.folder import Folder, FolderError

RARE_FILE = "rare.csv"
REPEATS = 10  # independent runs of subset simulation
PART = 0.1  # share of the points that start chains
CHAIN = round(1 / PART)  # points of a chain, the first included
MOST_LEVELS = 12
TARGET_ACCEPTANCE = 0.44  # share of accepted steps

Normals = Float[np.ndarray, "points coordinates"]
Heights = Float[np.ndarray, " points"]
Chains = Int[np.ndarray, " points"]  # number of each point's chain
Height = Callable[[Normals, Chains], Heights]


def count_rare(study: Study, folder: Folder, points: int, progress: Steps = no_progress) -> UPath:
    """Write `rare.csv` cell by cell; a stored row with as many points is not computed again."""
    if study.config.recovery is None:
        raise FolderError("needs to know what has recovered: give recovery: {tau: 0.01}")
    table = CellTable(study, folder, RARE_FILE, "points", points)
    for number, cell in enumerate(study.cells):
        progress("cells", number, len(study.cells))
        if cell.number not in table.known and threshold(cell, study.config.recovery) > 0:
            found = rare_row(study, cell, points)
            table.add([{"cell": cell.number, **cell.labels, **found}])
    return table.path


def rare_row(study: Study, cell: Cell, points: int) -> AnalysisRow:
    """Share unrecovered of a cell and its interval.

    `plain_lanes` is the number of random lanes that give an interval as narrow. Random graphs take
    no fixed number of draws. A chain keeps the graph of its first sample.
    """
    source, failed = Keyed(study.config.seed), 0
    box = Box(cell.scenario, source, places_of(cell.scenario, source))

    def height(where: np.ndarray, chains: np.ndarray) -> np.ndarray:
        nonlocal failed
        outcome = batch.simulate(box.lanes(special.ndtr(where), chains), EVERYTHING)
        failed += int(np.count_nonzero(outcome.status))
        return np.where(outcome.status == 0, outcome.metrics[cell.scenario.judged], -math.inf)

    random = np.random.default_rng([study.config.seed, cell.number])
    level = float(threshold(cell, study.config.recovery))
    found = estimate(height, len(box.places), level, points, REPEATS, random)
    half = (found.high - found.low) / 2
    plain_lanes = 1.96**2 * found.share * (1 - found.share) / half**2 if half else math.nan
    counts = {"failed": failed, "plain_lanes": plain_lanes, "points": points, "threshold": level}
    return {**found._asdict(), **counts}


class Estimate(NamedTuple):
    """Mean share over independent repeats, its t interval, and the effort."""

    share: float
    low: float
    high: float
    levels: int  # greatest of the repeats
    lanes: int


def estimate(
    height: Height,
    coordinates: int,
    level: float,
    points: int,
    repeats: int,
    random: np.random.Generator,
) -> Estimate:
    """Share of points whose height exceeds a level; that of a failed lane is minus infinity."""

    def once(repeat: int) -> tuple[float, int, int]:
        """Share, number of levels and number of evaluations of one repeat."""
        where = random.standard_normal((points, coordinates))
        chains = repeat * points + np.arange(points)
        heights, share, step, spent = height(where, chains), 1.0, 0.5, points
        levels = 1
        while True:
            order = np.argsort(-heights, kind="stable")
            seeds = order[: points // CHAIN]
            threshold = heights[order[points // CHAIN]]
            if threshold >= level or levels == MOST_LEVELS:
                break
            levels += 1
            share *= float((heights > threshold).mean())
            where, heights, chains = where[seeds], heights[seeds], chains[seeds]
            parts = [(where, heights, chains)]
            for _ in range(CHAIN - 1):
                proposed = np.sqrt(1 - step**2) * where + step * random.standard_normal(where.shape)
                proposed_heights = height(proposed, chains)
                over = proposed_heights > threshold
                where = np.where(over[:, None], proposed, where)
                heights = np.where(over, proposed_heights, heights)
                step = float(np.clip(step * np.exp(over.mean() - TARGET_ACCEPTANCE), 0.02, 1.0))
                parts.append((where, heights, chains))
                spent += len(proposed)
            where, heights, chains = (np.concatenate(each) for each in zip(*parts, strict=True))
        return share * float((heights > level).mean()), levels, spent

    shares, levels, spent = zip(*map(once, range(repeats)), strict=True)
    half = special.stdtrit(repeats - 1, (1 + CONFIDENCE) / 2) * np.std(shares, ddof=1)
    half, mean = float(half / np.sqrt(repeats)), float(np.mean(shares))
    return Estimate(mean, max(0.0, mean - half), mean + half, max(levels), sum(spent))
