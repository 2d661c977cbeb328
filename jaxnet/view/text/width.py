"""Text no wider than a terminal: what is cut short or left out, and the words that say so."""

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import pandas as pd

from jaxnet.config.cells import Cell

WIDTH = 80
MOST_ROWS = 60
CUTS = range(40, 9, -1)  # characters that long labels are cut to, the first that fits


def cut(text: Any, room: int) -> Any:
    """The beginning of a text, with a sign that it is no more than that; a number as it is."""
    return text if not isinstance(text, str) or len(text) <= room else f"{text[: room - 1]}…"


def clipped(cell: Cell, room: int) -> str:
    """A cell by its name; where that is too long by its number and values alone, the longest cut short."""
    values, shown = [str(value) for value in cell.labels.values()], str(cell)
    for longest in range(max(map(len, values), default=0), 3, -1):
        if len(shown) <= room:
            break
        shown = f"cell {cell.number}: {', '.join(cut(value, longest) for value in values)}"
    return cut(shown, room)


def number(value: float) -> str:
    """A number to four significant digits."""
    return f"{value:.4g}"


def as_lines(table: pd.DataFrame) -> str:
    """A line per row."""
    return table.to_string(index=False, float_format=number, na_rep="-")


def width(table: pd.DataFrame) -> int:
    """Columns of a terminal that a table takes."""
    return max(map(len, as_lines(table).splitlines()))


def narrow(
    table: pd.DataFrame, labels: Sequence[str], least_wanted: Sequence[Sequence[str]]
) -> tuple[pd.DataFrame, list[str], bool]:
    """A table that fits; the columns that it had no room for; whether labels are cut short.

    First go the least wanted columns, then all but the last words of the keys that the `labels` stand under,
    then the ends of long labels, and at last labels, from the last on.
    """
    shown, keys, is_cut = table, {name: name for name in table}, False
    for names in least_wanted:
        if width(shown) > WIDTH:
            shown = shown.drop(columns=list(names), errors="ignore")
    if width(shown) > WIDTH:
        keys |= short(labels)
        shown = shown.rename(columns=keys)
    whole, named = shown, [keys[name] for name in labels]
    for room in CUTS:
        if width(shown) > WIDTH:
            shown, is_cut = (
                whole.assign(
                    **{name: whole[name].map(lambda text, room=room: cut(text, room)) for name in named}
                ),
                True,
            )
    while width(shown) > WIDTH and any(name in shown for name in named):
        shown = shown.drop(columns=next(name for name in reversed(named) if name in shown))
    return shown, [name for name in table if keys[name] not in shown], is_cut


def short(labels: Sequence[str]) -> Mapping[str, str]:
    """The last words of dotted keys, where no two of them are the same."""
    last = [key.rpartition(".")[2] for key in labels]
    return {key: word for key, word in zip(labels, last, strict=True) if last.count(word) == 1}


def notes(left_out: Sequence[str], is_cut: bool, file: str) -> list[str]:
    """What is said below a table that has not all that the file has."""
    words = [f"left out: {', '.join(left_out)}"] * bool(left_out) + [
        "… stands where a label is cut short"
    ] * is_cut
    return [fill(f"{'; '.join(words)}; all are in {file}", WIDTH)] if words else []
