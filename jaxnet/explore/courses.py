"""How searches went, beside as many random lanes: what a figure and the page draw."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxnet.config.cells import Cell
from jaxnet.store import rows
from jaxnet.store.results import Results

MOST_POINTS = 200  # points of a line


class Course(NamedTuple):
    """The best until then, by lanes, of a search and of random lanes; and what theory bounds it by."""

    cell: Cell
    lanes: Float[np.ndarray, " generations"]
    best: Float[np.ndarray, " generations"]
    random_lanes: Float[np.ndarray, " points"]
    random_best: Float[np.ndarray, " points"]
    bound: float  # not a number where none is known


def search_courses(results: Results, cells: Sequence[Cell]) -> Iterator[Course]:
    """Of each of these cells."""
    asked = results.study.config.search
    assert asked is not None
    generations, bounds = results.searched, dict(results.worst[["cell", "bound"]].to_numpy(float))
    shares = asked.maximise == "unrecovered"
    for cell in cells:
        mine: Any = generations[generations["cell"] == cell.number]
        lanes, best = mine["lanes"].to_numpy(float), mine["best"].to_numpy(float)
        thinned = np.unique(np.geomspace(1, len(lanes), MOST_POINTS).round().astype(int)) - 1
        random = np.empty(0) if shares else random_course(results, cell.number, asked.maximise)
        places = np.unique(np.geomspace(1, max(1, len(random)), MOST_POINTS).round().astype(int))[
            : len(random)
        ]
        yield Course(
            cell, lanes[thinned], best[thinned], places.astype(float), random[places - 1], bounds[cell.number]
        )


def random_course(results: Results, cell: int, metric: str) -> Float[np.ndarray, " lanes"]:
    """The greatest until then, lane by lane."""
    found = list(results.by_cell(metric, where=rows.OK, cells=[cell]))
    return np.maximum.accumulate(found[0][1][metric].to_numpy()) if found else np.empty(0)
