"""Axes of a sweep: a key alone, or several with commas between, which take values together."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from jaxnet.config.document import Keys, Plain
from jaxnet.kinds.refusals import shorten_value

LABELLED = {"values", "label"}  # keys of an entry that has a label


def is_joint(key: str) -> bool:
    """Whether a key of the sweep, or a column, is of several keys."""
    return "," in key


def joint_key(keys: Sequence[object]) -> str:
    """Return the key of several keys, which names the column of their labels."""
    return ", ".join(map(str, keys))


def keys_in(written: object) -> tuple[str, ...]:
    """Return the dotted keys in a key of the sweep, which a script may give as a tuple."""
    parts = written if isinstance(written, tuple) else str(written).split(",")
    return tuple(str(part).strip() for part in parts) if len(parts) > 1 else (str(written),)


def holders(sweep: Mapping[Any, Any], key: str) -> Iterator[tuple[Any, Keys]]:
    """Yield the list that holds each value of a key, and the keys that lead to the value."""
    for written, listed in sweep.items():
        keys = keys_in(written)
        if key not in keys or not isinstance(listed, list | tuple):
            continue
        for number, entry in enumerate(listed):
            inside = ("values",) if len(keys) > 1 and isinstance(entry, Mapping) else ()
            row = entry.get("values") if inside else entry
            if len(keys) == 1:
                yield listed, (written, number)
            elif isinstance(row, list | tuple) and len(row) == len(keys):
                yield row, (written, number, *inside, keys.index(key))


def values_in(sweep: Mapping[Any, Any], key: str) -> list[Any]:
    """Return the values of a key; none of one that is swept by a spacing."""
    return [row[way[-1]] for row, way in holders(sweep, key)]


class SweptColumn(NamedTuple):
    """Values of a key, or labels of keys that take values together, along an axis of the grid."""

    written: str  # the key of the sweep
    axis: int
    values: list[Plain]
    firsts: Sequence[int]  # by value, the number of the first that equals it
    ways: Sequence[Keys] = ()  # by value, the keys that lead to it; none if the key is alone


class Sweep:
    """The grid of a sweep, by columns: keys, and joint keys with labels. It leaves out `faults`."""

    def __init__(self, given: Mapping[str, list[Plain]]):
        self.sizes: list[int] = []  # of the axes
        self.columns: dict[str, SweptColumn] = {}
        self.faults: list[tuple[Keys, str]] = []
        for written, listed in given.items():
            keys = keys_in(written)
            taken = [key for n, key in enumerate(keys) if key in self.columns or key in keys[:n]]
            found = [((), f"{key} is swept twice") for key in taken]
            if "" in keys:
                found = [((), "a key is missing before or after a comma")]
            found = found or [*entry_faults(len(keys), listed)]
            self.faults += [((written, *way), told) for way, told in found]
            if not found:
                self.add_axis(written, keys, listed)

    def add_axis(self, written: str, keys: tuple[str, ...], listed: list[Plain]) -> None:
        axis, every = len(self.sizes), range(len(listed))
        self.sizes.append(len(listed))
        if len(keys) == 1:
            self.columns[written] = SweptColumn(written, axis, listed, every)
            return
        if isinstance(listed[0], dict):
            labels = [entry["label"] for entry in listed]
            self.columns[joint_key(keys)] = SweptColumn(written, axis, labels, every)
        for key in keys:
            rows = [*holders({written: listed}, key)]
            values, ways = [row[way[-1]] for row, way in rows], [way for _, way in rows]
            self.columns[key] = SweptColumn(written, axis, values, first_equal(values), ways)


def first_equal(values: Sequence[Plain]) -> list[int]:
    """Return the number of the first equal value of each value; 1 and 1.0 are equal."""
    numbers: dict[object, int] = {}
    keys = (value if type(value) in (int, float) else repr(value) for value in values)
    return [numbers.setdefault(key, number) for number, key in enumerate(keys)]


def entry_faults(many: int, listed: list[Plain]) -> Iterator[tuple[Keys, str]]:
    """Yield place and message of what is wrong with the entries of so many keys."""
    allowed = f"must be a list of {many} values, one for each key, or {{values: [...], label: ...}}"
    for number, entry in enumerate(listed if many > 1 else ()):
        named = isinstance(entry, dict)
        row, label = (entry.get("values"), entry.get("label")) if named else (entry, "none")
        right = isinstance(row, list) and len(row) == many and isinstance(label, str)
        if not right or (named and {*entry} != LABELLED):
            yield (number,), f"{allowed} (got {shorten_value(entry)})"
        elif named != isinstance(listed[0], dict):
            yield (number,), "give each entry a label, or none"
        if not isinstance(entry, list | dict):
            return
