"""Cells that differ in the attack's magnitude alone: what δ̂(ā) is asked of."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from jaxnet.config.cells import Cell
from jaxnet.config.naming import MAGNITUDE
from jaxnet.kinds.fields import is_drawn


class Group(NamedTuple):
    """Cells by ascending ā, and the swept keys that they share."""

    labels: dict[str, Any]
    cells: tuple[Cell, ...]

    @property
    def attacked(self) -> dict[int, float]:
        """ā of the cells in which it is positive, by their number."""
        return {cell.number: magnitude(cell) for cell in self.cells if magnitude(cell) > 0}

    def __str__(self) -> str:
        """How tables and messages name it."""
        return ", ".join(f"{key}={value}" for key, value in self.labels.items()) or "all cells"


def swept_values_of(cells: Sequence[Cell]) -> dict[str, list[Any]]:
    """Swept keys with the values that these cells have, as they come."""
    return {key: list(dict.fromkeys(cell.labels[key] for cell in cells)) for key in cells[0].labels}


def attacked_groups(cells: Sequence[Cell]) -> list[Group]:
    """Groups of the cells with an attack whose ā is not drawn."""
    members: dict[tuple[Any, ...], list[Cell]] = {}
    for cell in cells:
        attack = cell.scenario.attack
        if attack.present and not is_drawn(attack.amplitude()):
            members.setdefault(tuple(labels_without_magnitude(cell).items()), []).append(cell)
    return [Group(dict(labels), tuple(sorted(group, key=magnitude))) for labels, group in members.items()]


def labels_without_magnitude(cell: Cell) -> dict[str, Any]:
    """The swept keys of a cell other than its ā."""
    return {key: label for key, label in cell.labels.items() if key != MAGNITUDE}


def magnitude(cell: Cell) -> float:
    """ā of an attacked cell, if it is not drawn."""
    return cell.scenario.attack.amplitude()
