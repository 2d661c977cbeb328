"""Progress of searches next to as many random lanes, for a figure and for the page."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

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
    settings = results.study.config.search
    assert settings is not None
    generations, bounds = results.searched, dict(results.worst[["cell", "bound"]].to_numpy(float))
    metric = settings.maximise
    for cell in (each for each in cells if each.number in bounds):
        progress: Any = generations[generations["cell"] == cell.number]
        lanes, best = (progress[each].to_numpy(float) for each in ("lanes", "best"))
        some, greatest = thinned(len(lanes)), np.empty(0)
        if metric != "unrecovered":  # a share has no greatest lane
            for _, found in results.by_cell(metric, where=rows.OK, cells=[cell.number]):
                greatest = np.maximum.accumulate(found[metric].to_numpy())
        places = thinned(max(1, len(greatest)))[: len(greatest)]
        best, random_best = (
            np.maximum(each, LOG_FLOOR) for each in (best[some - 1], greatest[places - 1])
        )
        bound = bounds[cell.number]
        yield Course(cell, lanes[some - 1], best, places.astype(float), random_best, bound)


def thinned(count: int) -> Int[np.ndarray, " points"]:
    """Numbers from 1 to a count, at most MOST_POINTS of them, evenly over the logarithm."""
    return np.unique(np.geomspace(1, count, MOST_POINTS).round().astype(int))
