"""Selection of a study's cells by the values of their swept keys."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import yaml

from jaxnet.config.cells import Cell, full_kind, to_plain, with_kind
from jaxnet.config.keys import KINDS
from jaxnet.config.naming import (
    NO_BREAK,
    format_value,
    key_name,
    quantity,
    unit,
    value_alone,
    value_name,
)
from jaxnet.kinds.refusals import suggestion, value_text
from jaxnet.statistics.curves import canonical_value
from jaxnet.statistics.groups import Label, swept_values_of
from jaxnet.store.folder import FolderError

Where = Mapping[str, Any]  # swept key: the wanted value, or a list of wanted values


def select_cells(cells: Sequence[Cell], where: Where) -> list[Cell]:
    """Return the cells whose swept keys have one of the wanted values.

    A key may be written as `swept_key` says, a value as in tables, in the config, or in
    `cells.csv`.

    Raises FolderError for a key that is not swept, and for a value without a cell.
    """
    swept, found = swept_values_of(cells), list(cells)
    for name, wanted in where.items():
        key, chosen = swept_key("where", name, swept), set[Label]()
        for value in as_list(wanted):
            labels = matching_labels(cells, key, value)
            if not labels:
                there = ", ".join(names_of(key, each) for each in swept[key])
                near = suggestion(str(value), [*map(str, swept[key])], fallback=False)
                raise FolderError(f"where: {key} has no value {value} (it has {there}){near}")
            chosen |= labels
        found = [cell for cell in found if cell.labels[key] in chosen]
    return found


def swept_key(argument: str, name: str, swept: Collection[str]) -> str:
    """Return the swept key of a name: the key, or its title in tables, with or without the unit.

    Raises FolderError, which names the argument and all swept keys.
    """
    for key in swept:
        if name in (key, key_name(key), quantity(key), quantity(key).partition(" [")[0]):
            return key
    known = "; ".join(swept) or "no keys"
    near = suggestion(name, [*swept], fallback=False)
    raise FolderError(f"{argument}: {name} is not swept (swept are {known}){near}")


def names_of(key: str, label: Label) -> str:
    """A value as a table shows it, after its name in the config where that differs."""
    alone = plain_spaces(value_alone(key, label))
    return f"'{label}' ({alone})" if isinstance(label, str) and alone != label else alone


def as_list(values: object) -> list[object]:
    return list(values) if isinstance(values, list | tuple) else [values]


def plain_spaces(words: str) -> str:
    return words.replace(NO_BREAK, " ")


def matching_labels(cells: Sequence[Cell], key: str, value: object) -> set[Label]:
    """Labels of a swept key that a wanted value means."""
    first = {cell.labels[key]: cell for cell in reversed(cells)}  # the first cell of each label
    return {
        label
        for label, cell in first.items()
        if matches_label(key, value, label) or matches_config(cell, key, value)
    }


def matches_label(key: str, value: object, label: Label) -> bool:
    """Whether a value equals a label, to four digits, or is written as tables or titles show it."""
    if isinstance(value, dict):
        return value_text(value) == label
    if isinstance(label, float) and canonical_value(value) == canonical_value(format_value(label)):
        return True
    alone = plain_spaces(value_alone(key, label))
    shown = (alone, f"{alone} {unit(key)}", plain_spaces(value_name(key, label)))
    return canonical_value(value) == canonical_value(label) or plain_spaces(str(value)) in shown


def matches_config(cell: Cell, key: str, value: object) -> bool:
    """Whether a value is what the config gives the cell, as YAML or as a mapping."""
    try:
        given = yaml.safe_load(value) if isinstance(value, str) else value
    except yaml.YAMLError:
        return False
    if isinstance(given, dict) and key in KINDS:
        mine = to_plain(getattr(cell.scenario, key))
        return full_kind(key, with_kind(key, given)) == full_kind(key, mine)
    return isinstance(given, dict | list) and value_text(given) == cell.labels[key]
