"""Progress of searches next to as many random lanes, for a figure and for the page."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxnet.config.cells import Cell
from jaxnet.statistics.curves import LOG_FLOOR
from jaxnet.store import rows
from jaxnet.store.results import Results

MOST_POINTS = 200  # of a line


class Course(NamedTuple):
    """Greatest value so far, by the number of lanes, in a search and among random lanes.

    Values are LOG_FLOOR at least, as their axes are logarithmic.
    """

    cell: Cell
    lanes: Float[np.ndarray, " generations"]
    best: Float[np.ndarray, " generations"]
    random_lanes: Float[np.ndarray, " points"]
    random_best: Float[np.ndarray, " points"]
    bound: float  # of theory; not-a-number if unknown


def search_courses(results: Results, cells: Sequence[Cell]) -> Iterator[Course]:
    """Yield the course of each of these cells whose search has ended."""
    settings = results.study.config.search
    assert settings is not None
    generations, bounds = results.searched, dict(results.worst[["cell", "bound"]].to_numpy(float))
    is_share = settings.maximise == "unrecovered"
    for cell in (each for each in cells if each.number in bounds):
        progress: Any = generations[generations["cell"] == cell.number]
        lanes, best = progress["lanes"].to_numpy(float), progress["best"].to_numpy(float)
        thinned = np.unique(np.geomspace(1, len(lanes), MOST_POINTS).round().astype(int)) - 1
        random = np.empty(0) if is_share else random_course(results, cell.number, settings.maximise)
        places = np.unique(np.geomspace(1, max(1, len(random)), MOST_POINTS).round().astype(int))[
            : len(random)
        ]
        best, random_best = (
            np.maximum(each, LOG_FLOOR) for each in (best[thinned], random[places - 1])
        )
        yield Course(
            cell, lanes[thinned], best, places.astype(float), random_best, bounds[cell.number]
        )


def random_course(results: Results, cell: int, metric: str) -> Float[np.ndarray, " lanes"]:
    """Return the greatest value so far of a cell's random lanes, lane by lane."""
    found = list(results.by_cell(metric, where=rows.OK, cells=[cell]))
    return np.maximum.accumulate(found[0][1][metric].to_numpy()) if found else np.empty(0)
