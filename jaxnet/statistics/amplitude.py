"""The amplitude in force: how far an attack of magnitude ā shifts a position that is received.

ā bounds the signal and its derivatives. A fast signal therefore has a small amplitude: a harmonic of
frequency ω shifts positions by ā / max(1, ω³).
"""

import functools
from collections.abc import Sequence

import numpy as np

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Scenario
from jaxnet.kinds.attacks import own_numbers, signal_scale
from jaxnet.kinds.fields import Each
from jaxnet.kinds.kind import AnyKind, Kind, holds_drawn
from jaxnet.store.looking import known_or

MOST_CELLS = 3_000  # whose amplitudes are worked out


def amplitude_in_force(scenario: Scenario) -> float:
    """Return the greatest distance by which attacked links shift a position [m].

    The amplitude is not-a-number without an attack, where ā bounds nothing, and where lanes or vehicles
    differ.

    Examples
    --------
    >>> from jaxnet import load
    >>> fast = load({"attack": {"kind": "rotating", "magnitude": 8.0, "frequency": 2.0}})
    >>> amplitude_in_force(fast.cells[0].scenario)
    1.0
    """
    return known_or(np.nan, functools.partial(known_amplitude, scenario))


def known_amplitude(scenario: Scenario) -> float:
    """Return the amplitude of an attack whose code is available."""
    attack = scenario.attack
    if not attack.present or not attack.bounded or any(own_numbers(attack)) or draws_functions(attack):
        return np.nan
    if 0 not in attack.falsified():
        return 0.0
    alone = of_one_lane(attack)
    sizes = np.asarray(alone.sizes(scenario.horizon))
    return float((signal_scale(alone, sizes) * sizes[0]).ravel()[0])


def draws_functions(kind: Kind) -> bool:
    """Return whether numbers on which the signal's functions depend are drawn."""
    for key, field in type(kind).model_fields.items():
        value = getattr(kind, key)
        if isinstance(value, Kind) and draws_functions(value):
            return True
        own = any(isinstance(mark, Each) for mark in field.metadata)
        if holds_drawn(value) and not own and not isinstance(value, Kind):
            return True
    return False


def of_one_lane(kind: AnyKind) -> AnyKind:
    """Return a copy whose numbers are arrays of one lane."""
    values = {key: getattr(kind, key) for key in type(kind).model_fields}
    numbers = {key: np.array([value]) for key, value in values.items() if isinstance(value, float)}
    inner = {key: of_one_lane(value) for key, value in values.items() if isinstance(value, Kind)}
    return kind.filled(values | numbers | inner)


def reduced_amplitudes(cells: Sequence[Cell]) -> dict[int, float]:
    """Return the amplitude in force [m] of the cells in which it is below ā; of too many cells none."""
    if len(cells) > MOST_CELLS:
        return {}
    found = {cell.number: amplitude_in_force(cell.scenario) for cell in cells}
    return {
        cell.number: found[cell.number]
        for cell in cells
        if found[cell.number] < (1 - 1e-12) * magnitude_of(cell)
    }


def magnitude_of(cell: Cell) -> float:
    """Return ā of a cell [m]; not-a-number where ā is drawn or not known."""
    amount = known_or(np.nan, lambda: cell.scenario.attack.amplitude())
    return float(amount) if isinstance(amount, int | float) else np.nan


def amplitude_note(cells: Sequence[Cell]) -> str:
    """Return what has to be said where τ ā is compared with errors of a smaller attack, "" if nowhere."""
    reduced = reduced_amplitudes(cells)
    if not reduced:
        return ""
    sizes = {cell.number: magnitude_of(cell) for cell in cells}
    least = min(reduced[number] / sizes[number] for number in reduced)
    return f"ā bounds the attack's derivatives too: a position is shifted by less, {least:.2g} ā at least"
