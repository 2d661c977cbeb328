"""The axes of a figure over cells: the swept keys on x, in colours and in panels."""

import itertools
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from jaxnet.config.cells import Cell
from jaxnet.config.naming import is_kind
from jaxnet.config.sweep import is_joint, keys_in
from jaxnet.statistics.choice import swept_key
from jaxnet.statistics.curves import GREATEST_SHOWN
from jaxnet.statistics.groups import Label, is_decided, numeric, swept_values_of
from jaxnet.store.folder import FolderError

MOST_HUES = 12
MOST_CHOSEN_HUES = 6  # for a hue that the user does not name
SPREAD_OF_A_LOG_AXIS = 8.0  # least ratio of the ends of a geometric sequence


class Axes(NamedTuple):
    """The swept keys of a figure: one on x, one told apart by colour, the others by panel."""

    x: str | None
    hue: str | None
    panel: tuple[str, ...]


def choose_axes(
    cells: Sequence[Cell],
    x: str | None = None,
    hue: str | None = None,
    panel: str | Iterable[str] | None = None,
    most_hues: int = MOST_HUES,
) -> Axes:
    """Choose the axes on which these cells lie apart: swept keys, with the names of the config.

    Where a key is None, this function chooses. The key of most numbers comes on x, the last if
    several have as many. Kinds come first in colours, of at most `most_hues` values. All keys that
    are left come into panels, after those named. Keys that take values together have one axis, the
    labels' if they have labels. Raises FolderError if a key is not swept or is named twice, or if a
    hue has too many values.
    """
    values = swept_values_of(cells)
    given = [panel] if isinstance(panel, str) else list(panel or ())
    x, hue = (name and swept_key(at, name, values) for at, name in (("x", x), ("hue", hue)))
    panels = [
        swept_key("panel", name, values)
        for each in given
        for name in ([each] if each in values else each.split(","))
    ]
    taken = [key for key in (x, hue, *panels) if key]
    if twice := [key for key in taken if taken.count(key) > 1]:
        raise FolderError(f"{twice[0]} is named twice among x, hue and panel")
    told = {*taken, *(key for joint in filter(is_joint, values) for key in keys_in(joint))}
    free = [key for key, each in values.items() if len(each) > 1 and key not in told]
    if x is None:
        numbers = [key for key in free if numeric(values[key])]
        x = max(numbers[::-1] or free, key=lambda key: len(values[key]), default=None)
    free = [key for key in free if key != x and not is_decided(cells, [x or key], key)]
    if hue is None:
        few = [key for key in free if len(values[key]) <= MOST_CHOSEN_HUES]
        few = few or (free if most_hues > MOST_HUES else [])
        hue = max(few, key=lambda key: (is_kind(key), len(values[key])), default=None)
        free = [key for key in free if key != hue]
    elif len(values[hue]) > most_hues:
        raise FolderError(
            f"hue: {hue} has {len(values[hue])} values, and {most_hues} can be told apart: put it"
            f" on x, or choose values with where"
        )
    full = {str(key): key for key in values}  # keys with their names
    shown = [key for key in (x, hue) if key]
    for key in dict.fromkeys([*panels, *free, *values]):  # those of one value last
        needed = key in panels or len(values[key]) == 1 or not is_decided(cells, shown, key)
        shown += [key] if needed and key not in shown else []
    rest = tuple(full[key] for key in shown if key not in (x, hue))
    return Axes(x and full[x], hue and full[hue], rest)


def on_a_scale(values: Iterable[Label]) -> bool:
    """Whether all values are numbers for which an axis has room; other values are names."""
    return all(
        isinstance(value, int | float)
        and (value == 0 or 1 / GREATEST_SHOWN <= abs(value) <= GREATEST_SHOWN)
        for value in values
    )


def ordered_values(cells: Sequence[Cell], key: str | None) -> list[Label]:
    """Values of a key in these cells: numbers rise, other values keep the study's order."""
    values = swept_values_of(cells)[key] if key is not None else []
    return sorted(values, key=float) if numeric(values) else values


def geometric(values: Sequence[Label]) -> bool:
    """Whether positive numbers lie more evenly on a log axis, and over most of a decade."""
    steps = np.unique(np.array(values, float))
    if len(steps) < 2 or steps[0] <= 0 or steps[-1] / steps[0] < SPREAD_OF_A_LOG_AXIS:
        return False

    def unevenness(places: np.ndarray) -> float:
        gaps = np.diff(places)
        return float(gaps.std() / gaps.mean())

    return len(steps) == 2 or unevenness(np.log(steps)) < unevenness(steps)


def by_hue(cells: Sequence[Cell], axes: Axes, hues: Sequence[Label]) -> list[list[Cell]]:
    """Cells of each value of the hue; all cells in one list without a hue."""
    if axes.hue is None:
        return [list(cells)]
    return [[cell for cell in cells if cell.labels[axes.hue] == hue] for hue in hues]


def panels_of(cells: Sequence[Cell], axes: Axes) -> list[tuple[dict[str, Label], list[Cell]]]:
    """Labels and cells of each panel, the values of the first panel key slowest."""
    orders = [ordered_values(cells, key) for key in axes.panel]
    groups: dict[tuple[Label, ...], list[Cell]] = {}
    for cell in cells:
        groups.setdefault(tuple(cell.labels[key] for key in axes.panel), []).append(cell)
    return [
        (dict(zip(axes.panel, values, strict=True)), groups[values])
        for values in itertools.product(*orders)
        if values in groups
    ]
