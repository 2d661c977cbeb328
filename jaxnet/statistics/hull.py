"""The share of lanes in which no vehicle leaves the hull of the starts, attacked vehicles aside.

A lane stays in the hull if its metric `outside` is at most the accuracy of the engine, 1e-8 m for the exact
engine and 1e-5 m for others.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxnet.config.cells import Cell
from jaxnet.statistics.recovery import clopper_pearson

HULL_COLUMNS = ["in_hull", "in_hull_low", "in_hull_high"]
HULL_WORDS = "in the hull"


def hull_share(
    cell: Cell, outside: Float[np.ndarray, " lanes"], confidence: float
) -> dict[str, float]:
    """Return the share of a cell's ok lanes that stay in the hull, with both ends of its exact interval.

    The numbers are not-a-number where a navigator leads, and without a lane.
    """
    if not (cell.scenario.leaderless and len(outside)):
        return dict.fromkeys(HULL_COLUMNS, np.nan)
    stay = np.count_nonzero(outside <= cell.scenario.engine.accuracy)
    ends = clopper_pearson(np.array([stay]), np.array([len(outside)]), confidence)
    shares = stay / len(outside), *(float(end[0]) for end in ends)
    return dict(zip(HULL_COLUMNS, shares, strict=True))


def hull_definition(cells: Sequence[Cell]) -> str:
    """Return which lanes count as in the hull."""
    tolerance = max(cell.scenario.engine.accuracy for cell in cells)
    who = "no vehicle that is not attacked"
    return f"{HULL_WORDS} (in_hull): {who} leaves the convex hull of their starts by over {tolerance:g} m"
