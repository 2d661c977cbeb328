"""Groups of cells that differ only in the attack's magnitude: the data of δ̂(ā)."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from jaxnet.config.cells import Cell
from jaxnet.config.naming import MAGNITUDE
from jaxnet.config.sweep import keys_in
from jaxnet.kinds.fields import is_drawn
from jaxnet.statistics.amplitude import attack_size

Label = int | float | str  # a swept value as tables show it
T = TypeVar("T")


class Group(NamedTuple):
    """Cells by ascending ā, and the labels that they share."""

    labels: dict[str, Label]
    cells: tuple[Cell, ...]

    @property
    def attacked(self) -> dict[int, float]:
        sizes = {cell.number: attack_size(cell) for cell in self.cells}
        return {number: size for number, size in sizes.items() if size > 0}

    def __str__(self) -> str:
        return ", ".join(f"{key}={value}" for key, value in self.labels.items()) or "all cells"


def swept_values_of(cells: Sequence[Cell]) -> dict[str, list[Label]]:
    """Swept keys with the values that these cells have, in the cells' order."""
    return {key: list(dict.fromkeys(cell.labels[key] for cell in cells)) for key in cells[0].labels}


def evenly(values: Sequence[T], most: int) -> list[T]:
    """At most so many of the values, evenly spaced, with the first and the last."""
    places = np.linspace(0, len(values) - 1, min(most, len(values))).round().astype(int)
    return [values[place] for place in places]


def evenly_over(labels: Sequence[Mapping[str, Label]], most: int) -> list[int]:
    """Places of at most so many choices of swept values: all of few values evenly along each key.

    Names stay while numbers can go. The key with the most numbers loses some first; its ends stay,
    then its last; then the key with the most names loses some, the defence last. Where that leaves
    less than half of `most`, as in a sweep of pairs, the places are spaced evenly.
    """

    def spare(key: str) -> tuple[bool, bool, bool, int]:
        return len(kept[key]) > 1, numeric(there[key]), key != "defence", len(kept[key])

    there = {key: list(dict.fromkeys(each[key] for each in labels)) for key in labels[0]}
    kept = dict(there)
    while math.prod(map(len, kept.values())) > most and len(labels) > most:
        longest = max(kept, key=spare)
        kept[longest] = evenly(there[longest][::-1], len(kept[longest]) - 1)
    whole = [all(each[key] in kept[key] for key in kept) for each in labels]
    found = np.flatnonzero(whole).tolist()
    return found if 2 * len(found) > min(most, len(labels)) else evenly(range(len(labels)), most)


def numeric(values: Iterable[Label]) -> bool:
    return all(isinstance(value, int | float) for value in values)


def is_decided(cells: Sequence[Cell], keys: Sequence[str], key: str) -> bool:
    """Whether the values of some keys decide that of another, as of keys swept together."""
    found = {(tuple(cell.labels[each] for each in keys), cell.labels[key]) for cell in cells}
    return len(found) == len({those for those, _ in found})


def scenes(cells: Sequence[Cell]) -> list[Group]:
    """Groups of cells that differ only in ā, fixed or drawn, in the study's order."""
    members: dict[tuple[tuple[str, Label], ...], list[Cell]] = {}
    for cell in cells:
        members.setdefault(tuple(labels_without_magnitude(cell).items()), []).append(cell)
    return [Group(dict(labels), tuple(group)) for labels, group in members.items()]


def attacked_groups(cells: Sequence[Cell]) -> list[Group]:
    """Groups of the attacked cells whose ā is not drawn."""
    attacks = [(cell, cell.scenario.attack) for cell in cells]
    fixed = [cell for cell, each in attacks if each.present and not is_drawn(each.amplitude())]
    return [
        group._replace(
            cells=tuple(sorted(group.cells, key=lambda one: one.scenario.attack.amplitude()))
        )
        for group in scenes(fixed)
    ]


def labels_without_magnitude(cell: Cell) -> dict[str, Label]:
    """Labels of a cell without its ā; a label that is no number, as of a list, stays."""
    return {
        key: label
        for key, label in cell.labels.items()
        if MAGNITUDE not in keys_in(key) or (key == MAGNITUDE and isinstance(label, str))
    }
