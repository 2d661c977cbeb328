"""Which cells' errors still fall when the run ends, so that they are not ultimate (validation.md).

Rows tell of each lane by which share the mean error in the last half of its tail is below the least
in any window of that length before it (`tail_fall`; without a navigator the spread). Only lanes
with an error above what a recovery asks for, or above the engine's accuracy, are counted.

McNemar's test, one-sided and exact, compares the lanes that fell in the last window with those that
rose. Lanes that changed by less are left out. A cell still falls if the test rejects at 1 % for
changes of over 5 %, of the typical lane, or for changes of over a fifth, of the lanes that have not
recovered yet. Below seven lanes the test cannot reject: such a cell may still fall, if more lanes
fell by over a fifth than rose.

Where each window of a settled lane is equally likely to be the lowest, a lane falls at most as
often as it rises. At most 2 % of settled cells with independent lanes are then marked. An error
that swings with one phase in all lanes is not marked either, once an earlier window has seen the
same phase.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.model.wording import Named, cells_named
from jaxnet.store.results import Results

CHANGES = (0.05, 0.2)  # of the error; what is smaller is no change
LEVEL = 0.01  # of the test for each of these changes
TOO_FEW = 7  # lanes, of which all must fall for a rejection: 2⁻⁷ < 1 %
LONGER = 3  # times the horizon


def still_falls(
    fall: Float[np.ndarray, " lanes"], error: Float[np.ndarray, " lanes"], least: float
) -> float:
    """Whether lanes with these falls and errors [m] still fall: 1, 0, or NaN of too few lanes.

    Errors up to `least` [m] do not count.
    """
    from scipy.special import betainc  # takes long to import

    known, falls, rises = fall[error > least], 0, 0
    for change in CHANGES:
        falls, rises = int((known > change).sum()), int((known < -change).sum())
        if falls and betainc(falls, rises + 1, 0.5) <= LEVEL:  # as many falls, if both are alike
            return 1.0
    return np.nan if len(known) < TOO_FEW and falls > rises else 0.0


def falling_words(results: Results, cells: Sequence[Cell], named: Named | None = None) -> str:
    """Tell which cells still fall or may; "" of none, and of a folder of an earlier version."""
    if "falling" not in results.cells:
        return ""
    falling = results.cells["falling"].to_numpy()
    errors = "spreads" if is_leaderless(cells) else "errors"
    told = {
        f"{errors} still fall when the run ends": [c for c in cells if falling[c.number] == 1],
        f"{errors} may still fall, with too few lanes to tell": [
            c for c in cells if np.isnan(falling[c.number])
        ],
    }
    found = [cell for each in told.values() for cell in each]
    if not found:
        return ""
    words = [f"{those_of(each, cells, named)}: {what}" for what, each in told.items() if each]
    longer = LONGER * max(cell.scenario.horizon for cell in found)
    return f"{'; '.join(words)}. Try a longer run: horizon: {longer:g}"


def those_of(found: Sequence[Cell], cells: Sequence[Cell], named: Named | None) -> str:
    numbers = [cell.number for cell in found]
    if len(found) == len(cells):
        return "in all cells"
    return f"in {named(numbers) if named else f'{cells_named(numbers)} of {len(cells):,}'}"
