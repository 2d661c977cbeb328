"""Which cells' errors still fall when the run ends, so that they are not ultimate (results.md).

Rows tell of each lane by which share the mean error in the last half of its tail is below the least
in any window of that length before it (`tail_fall`; without a navigator the spread). Lanes count
whose error is above what a recovery asks for, or above the engine's accuracy. Their cell still
falls if

- their median falls by over 5 %, and more of them fall than rise, by a one-sided sign test at 1 %;
- or the cell has fewer than seven lanes, too few for the test, and each falls by over a fifth.

Where each window of a settled lane is as likely to be the lowest, a lane falls at most every second
time: two windows or more are there. At most 1 % of settled cells with independent lanes are then
marked. An error that swings with one phase in all lanes is not marked either, once an earlier
window has seen the same phase.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxnet.config.cells import Cell
from jaxnet.model.wording import cells_named, count
from jaxnet.store.results import Results

LEAST_FALL, GREAT_FALL = 0.05, 0.2  # of the error: the median of many lanes; each of a few
LEVEL = 0.01  # of the sign test
TOO_FEW = 7  # lanes, of which all must fall for a rejection: 2⁻⁷ < 1 %
LONGER = 3  # times the horizon


def still_falls(
    fall: Float[np.ndarray, " lanes"], error: Float[np.ndarray, " lanes"], least: float
) -> bool:
    """Whether the lanes of a cell with these falls and errors [m] are still on their way.

    Errors up to `least` [m] do not count.
    """
    known = fall[error > least]
    if len(fall) < TOO_FEW:
        return bool(len(known) == len(fall) > 0 and (known > GREAT_FALL).all())
    if not len(known) or np.median(known) <= LEAST_FALL:
        return False
    from scipy.special import betainc  # takes long to import

    falls, rises = int((known > 0).sum()), int((known < 0).sum())
    return bool(betainc(falls, rises + 1, 0.5) <= LEVEL)  # of as many falls, each as likely as not


def falling_cells(results: Results, cells: Sequence[Cell]) -> list[Cell]:
    """The cells that still fall; none in a folder of an earlier version, which has no mark."""
    table = results.cells
    if "falling" not in table:
        return []
    return [cell for cell in cells if table.loc[cell.number, "falling"] == 1]


def falling_words(results: Results, cells: Sequence[Cell]) -> str:
    """One sentence about the cells that still fall; "" if none does."""
    found = falling_cells(results, cells)
    if not found:
        return ""
    many = f"{len(found)} of {count(len(cells), 'cell')}"
    many += f" ({cells_named([cell.number for cell in found])})" * (len(found) < len(cells))
    one = len(found) == 1
    longer = LONGER * max(cell.scenario.horizon for cell in found)
    return (
        f"{many} still {'falls' if one else 'fall'} when the run ends:"
        f" {'its' if one else 'their'} errors are not ultimate. Longer: horizon: {longer:g}"
    )
