"""Selection of a study's cells by the values of their swept keys."""

from collections.abc import Mapping, Sequence
from typing import Any

from jaxnet.config.cells import Cell
from jaxnet.statistics.curves import canonical_value
from jaxnet.statistics.groups import swept_values_of
from jaxnet.store.folder import FolderError

Where = Mapping[str, Any]  # swept key: the wanted value, or a list of wanted values


def select_cells(cells: Sequence[Cell], where: Where) -> list[Cell]:
    """Return the cells whose swept keys have one of the wanted values.

    Raises FolderError for a key that is not swept, and for a value without a cell.
    """
    swept = swept_values_of(cells)
    listing = "; ".join(f"{key}: {', '.join(map(str, values))}" for key, values in swept.items())
    found = list(cells)
    for key, wanted in where.items():
        if key not in swept:
            raise FolderError(f"where: {key} is not swept (swept are {listing or 'no keys'})")
        for value in as_list(wanted):
            if not any(matches_label(value, label) for label in swept[key]):
                raise FolderError(f"where: {key} has no value {value} (swept are {listing})")
        found = [
            cell for cell in found if any(matches_label(value, cell.labels[key]) for value in as_list(wanted))
        ]
    return found


def as_list(values: object) -> list[object]:
    """Return one value or several values as a list."""
    return list(values) if isinstance(values, list | tuple) else [values]


def matches_label(value: object, label: object) -> bool:
    """Return whether a value equals a label.

    A number may also equal the label to the four digits that tables show.
    """
    if isinstance(label, float) and canonical_value(value) == canonical_value(f"{label:.4g}"):
        return True
    return canonical_value(value) == canonical_value(label)
