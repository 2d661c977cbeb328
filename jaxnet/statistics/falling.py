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
same phase. A tail that is shorter than the period of such an attack cannot tell: no mark.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.keys import Scenario
from jaxnet.kinds.fields import Listed, value_range
from jaxnet.model.wording import Named, cells_named
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results

CHANGES = (0.05, 0.2)  # of the error; what is smaller is no change
LEVEL = 0.01  # of the test for each of these changes
TOO_FEW = 7  # lanes, of which all must fall for a rejection: 2⁻⁷ < 1 %
LONGER = 3  # times the horizon


def still_falls(
    fall: Float[np.ndarray, " lanes"],
    error: Float[np.ndarray, " lanes"],
    least: float,
    swings: bool = False,
) -> float:
    """Whether lanes with these falls and errors [m] still fall: 1, 0, or NaN if it is not known.

    Errors up to `least` [m] do not count. It is not known of too few lanes, and of lanes that may
    all swing at once, `swings`.
    """
    from scipy.special import betainc  # takes long to import

    known, falls, rises = fall[error > least], 0, 0
    for change in CHANGES:
        falls, rises = int((known > change).sum()), int((known < -change).sum())
        if falls and betainc(falls, rises + 1, 0.5) <= LEVEL:  # as many falls, if both are alike
            return np.nan if swings else 1.0
    return np.nan if len(known) < TOO_FEW and falls > rises else 0.0


def unseen_period(scenario: Scenario) -> float:
    """The longest period [s] of an attack that is beyond the tail; 0 if the lanes' phases differ.

    Chirps have no period. Of a drawn frequency the lowest counts.
    """
    attack = getattr(scenario.attack, "of", scenario.attack)  # what an envelope holds
    given, phase = (getattr(attack, key, None) for key in ("frequency", "phase"))
    phases = phase.root if isinstance(phase, Listed) else [phase]
    shared = phase is not None and all(len({*value_range(each)}) == 1 for each in phases)
    if given is None or not shared or known_or(np.inf, attack.fastest) == np.inf:
        return 0.0
    slowest = min(map(abs, value_range(given)))
    period = 2 * np.pi / slowest if slowest else 0.0
    return period if period > scenario.tail else 0.0


def falling_words(results: Results, cells: Sequence[Cell], named: Named | None = None) -> str:
    """Tell which cells still fall or may; "" of none, and of a folder of an earlier version."""
    if "falling" not in results.cells:
        return ""
    falling = results.cells["falling"].to_numpy()
    periods = {c.number: unseen_period(c.scenario) for c in cells if falling[c.number] != 0}
    errors = "spreads" if is_leaderless(cells) else "errors"
    found = [cell for cell in cells if periods.get(cell.number) == 0]
    told = {
        f"{errors} still fall when the run ends": [c for c in found if falling[c.number] == 1],
        f"{errors} may still fall, with too few lanes to tell": [
            c for c in found if np.isnan(falling[c.number])
        ],
    }
    words = [f"{those_of(each, cells, named)}: {what}" for what, each in told.items() if each]
    longer = LONGER * max((cell.scenario.horizon for cell in found), default=0.0)
    late = any(c.scenario.channel.late and c.scenario.navigator.present for c in found)
    also = ", or follow the speed of the navigator, as messages are late" * late
    parts = [f"{'; '.join(words)}{also}. Try a longer run: horizon: {longer:g}"] * bool(found)
    swings = [cell for cell in cells if periods.get(cell.number)]
    if swings:
        period = max(periods.values())
        tail = max(cell.scenario.tail for cell in swings)
        parts.append(
            f"{those_of(swings, cells, named)}: the tail ({tail:g} s) is shorter than the period of"
            f" the attack ({period:.3g} s), so {errors} may fall or swing. Try"
            f" {longer_tail(period, swings)}"
        )
    return "; ".join(parts)


def longer_tail(period: float, cells: Sequence[Cell]) -> str:
    """A tail that holds a period [s], rounded up, and a run that holds several such tails."""
    digit = 10.0 ** np.floor(np.log10(period))
    step, horizon = (max(getattr(c.scenario, k) for c in cells) for k in ("output_step", "horizon"))
    tail = float(step * np.ceil(round(digit * np.ceil(period / digit) / step, 9)))
    longer = f", horizon: {LONGER * tail:g}" * (LONGER * tail > horizon)
    return f"tail: {tail:g}{longer}"


def those_of(found: Sequence[Cell], cells: Sequence[Cell], named: Named | None) -> str:
    numbers = [cell.number for cell in found]
    if len(found) == len(cells):
        return "in all cells"
    return f"in {named(numbers) if named else f'{cells_named(numbers)} of {len(cells):,}'}"
