"""The amplitude in force of each cell, and notes where it is below ā."""

import functools
from collections.abc import Sequence

import numpy as np

from jaxnet.config.amplitude import known_amplitude
from jaxnet.config.cells import Cell
from jaxnet.config.keys import Scenario
from jaxnet.store.looking import known_or

MOST_CELLS = 3_000  # whose amplitudes are worked out


def amplitude_in_force(scenario: Scenario) -> float:
    """Return the amplitude of `known_amplitude` [m]; not-a-number also where the attack's code is
    missing.

    Examples
    --------
    >>> from jaxnet import load
    >>> fast = load({"attack": {"kind": "rotating", "magnitude": 8.0, "frequency": 2.0}})
    >>> amplitude_in_force(fast.cells[0].scenario)
    1.0
    """
    return known_or(np.nan, functools.partial(known_amplitude, scenario))


def reduced_amplitudes(cells: Sequence[Cell]) -> dict[int, float]:
    """Amplitude in force [m] of the cells in which it is below ā; of too many cells none."""
    if len(cells) > MOST_CELLS:
        return {}
    found = {cell.number: amplitude_in_force(cell.scenario) for cell in cells}
    return {
        cell.number: found[cell.number]
        for cell in cells
        if found[cell.number] < (1 - 1e-12) * magnitude_of(cell)
    }


def magnitude_of(cell: Cell) -> float:
    """Ā of a cell [m]; not-a-number where ā is drawn or not known."""
    amount = known_or(np.nan, lambda: cell.scenario.attack.amplitude())
    return float(amount) if isinstance(amount, int | float) else np.nan


def amplitude_note(cells: Sequence[Cell]) -> str:
    """What has to be said where τ ā is compared with errors of a smaller attack, "" if nowhere."""
    reduced = reduced_amplitudes(cells)
    if not reduced:
        return ""
    sizes = {cell.number: magnitude_of(cell) for cell in cells}
    least = min(reduced[number] / sizes[number] for number in reduced)
    shifted = f"a position is shifted by less, {least:.2g} ā at least"
    return f"ā bounds the attack's derivatives too: {shifted}"
