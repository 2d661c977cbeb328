"""ā of each cell, the amplitude in force, and notes where it is below ā."""

import functools
from collections.abc import Sequence

import numpy as np

from jaxnet.config.amplitude import known_amplitude
from jaxnet.config.cells import Cell
from jaxnet.kinds.fields import is_drawn
from jaxnet.store.looking import known_or

MOST_CELLS = 3_000  # whose amplitudes are worked out
# Of ā, or [m] where no ā is known. Doubles carry 1e-16 of positions of tens of metres through
# thousands of ticks, some 1e-12 m: smaller errors are rounding, and far below what a robot has.
ROUNDING_ERROR = 1e-9
LEAST_UNRECOVERED = 1e-6  # of ā; less is a transient or rounding


def is_rounding(value: float, size: float) -> bool:
    """Whether an error is rounding beside an attack of this size.

    An unknown size counts as 1 m. A size of 0 switches the test off.
    """
    return bool(0 < abs(value) < ROUNDING_ERROR * (1.0 if np.isnan(size) else size))


def without_rounding(value: float, size: float) -> float:
    return 0.0 if is_rounding(value, size) else value


def attack_size(cell: Cell) -> float:
    """Magnitude ā of the cell [m]; not-a-number without an attack, or if ā is drawn."""
    amplitude = cell.scenario.attack.amplitude()
    return float(amplitude) if not is_drawn(amplitude) and amplitude > 0 else np.nan


def reduced_amplitudes(cells: Sequence[Cell]) -> dict[int, float]:
    """Amplitude in force [m] of the cells in which it is below ā; of too many cells none."""
    if len(cells) > MOST_CELLS:
        return {}
    found = {}
    for cell in cells:
        amplitude = known_or(np.nan, functools.partial(known_amplitude, cell.scenario))
        if amplitude < (1 - 1e-12) * known_or(np.nan, functools.partial(attack_size, cell)):
            found[cell.number] = amplitude
    return found


def amplitude_note(cells: Sequence[Cell]) -> str:
    """What has to be said where τ ā is compared with errors of a smaller attack, "" if nowhere."""
    reduced = reduced_amplitudes(cells)
    if not reduced:
        return ""
    sizes = {cell.number: attack_size(cell) for cell in cells if cell.number in reduced}
    least = min(each / sizes[number] for number, each in reduced.items())
    shifted = f"a position is shifted by less, {least:.2g} ā at least"
    return f"ā bounds the attack's derivatives too: {shifted}"
