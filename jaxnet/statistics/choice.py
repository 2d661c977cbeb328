"""Some of a study's cells, chosen by the values of their swept keys."""

from collections.abc import Mapping, Sequence
from typing import Any

from jaxnet.config.cells import Cell
from jaxnet.statistics.curves import alike
from jaxnet.statistics.groups import values_of
from jaxnet.store.folder import FolderError

Where = Mapping[str, Any]  # swept key: the value that is wanted, or a list of those


def chosen(cells: Sequence[Cell], where: Where) -> list[Cell]:
    """The cells whose swept keys have one of the values wanted; raises FolderError where there is none."""
    there = values_of(cells)
    told = "; ".join(f"{key}: {', '.join(map(str, values))}" for key, values in there.items())
    found = list(cells)
    for key, wanted in where.items():
        if key not in there:
            raise FolderError(f"where: {key} is not swept (swept are {told or 'no keys'})")
        for value in listed(wanted):
            if not any(meant(value, label) for label in there[key]):
                raise FolderError(f"where: {key} has no value {value} (swept are {told})")
        found = [cell for cell in found if any(meant(value, cell.labels[key]) for value in listed(wanted))]
    return found


def listed(values: Any) -> list[Any]:
    """One value or several, as a list."""
    return list(values) if isinstance(values, list | tuple) else [values]


def meant(value: Any, label: Any) -> bool:
    """Whether a value is a label, as it is stored or, of a number, as tables show it: to four digits."""
    if isinstance(label, float) and alike(value) == alike(f"{label:.4g}"):
        return True
    return alike(value) == alike(label)
