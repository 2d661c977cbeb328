"""Text no wider than a terminal, and notes on what was shortened or left out."""

import shutil
from collections.abc import Mapping, Sequence
from textwrap import fill, wrap
from typing import NamedTuple, TypeVar

import pandas as pd
from pandas.api.types import is_numeric_dtype

from jaxnet.config.cells import Cell

LEAST_WIDTH, GREATEST_WIDTH = 40, 200  # of a terminal, in letters
Value = TypeVar("Value")

LEAST_TITLE = 9  # letters of a line of a title
MOST_ROWS = 60
LABEL_LENGTHS = range(40, 9, -1)  # characters that long labels are cut to, the first that fits


def terminal_width() -> int:
    """Return the width of the terminal in letters, 80 where there is none."""
    return min(max(shutil.get_terminal_size((80, 24)).columns, LEAST_WIDTH), GREATEST_WIDTH)


def cut_text(text: Value, room: int) -> Value | str:
    """Shorten a text with an ellipsis; return other values unchanged."""
    return text if not isinstance(text, str) or len(text) <= room else f"{text[: room - 1]}…"


def cell_title(cell: Cell, room: int) -> str:
    """Return a cell's name; where it is too long, the number and the shortened values alone."""
    values, shown = [str(value) for value in cell.labels.values()], str(cell)
    for longest in range(max(map(len, values), default=0), 3, -1):
        if len(shown) <= room:
            break
        shown = f"cell {cell.number}: {', '.join(cut_text(value, longest) for value in values)}"
    return cut_text(shown, room)


def four_digits(value: float) -> str:
    """Return a number to four significant digits."""
    return f"{value:.4g}"


def table_text(table: pd.DataFrame) -> str:
    """Return a table as text: numbers to four digits at the right, text at the left, titles wrapped."""
    columns = [
        Lettered(
            str(name),
            [shown(value) for value in table.iloc[:, place]],
            is_numeric_dtype(table.iloc[:, place]),
        )
        for place, name in enumerate(table)
    ]
    return lettered_text(columns)


class Lettered(NamedTuple):
    """A column of text: its title, its values, and whether these stand at the right."""

    title: str
    values: list[str]
    right: bool


def lettered_text(columns: Sequence[Lettered]) -> str:
    """Return columns of text as lines, titles first; a title has as many lines as its values are narrow."""
    titles = [title_lines(each) for each in columns]
    high = max(map(len, titles), default=0)
    filled = [
        [*[""] * (high - len(lines)), *lines, *each.values]
        for lines, each in zip(titles, columns, strict=True)
    ]
    widths = [max(map(len, each)) for each in filled]
    lines = [
        "  ".join(
            text.rjust(width) if each.right else text.ljust(width)
            for text, width, each in zip(row, widths, columns, strict=True)
        )
        for row in zip(*filled, strict=True)
    ]
    return "\n".join(line.rstrip() for line in lines)


def title_lines(column: Lettered) -> list[str]:
    """Return a title on lines about as long as the values; no word is broken."""
    room = max([LEAST_TITLE, *map(len, column.values)])
    return wrap(column.title, room, break_long_words=False, break_on_hyphens=False) or [""]


def shown(value: object) -> str:
    """Return a value as tables show it."""
    if not isinstance(value, float):
        return str(value)
    return "-" if value != value else four_digits(value)


def table_width(table: pd.DataFrame) -> int:
    """Return the width of a table in characters."""
    return max(map(len, table_text(table).splitlines()))


def fit_terminal(
    table: pd.DataFrame, labels: Sequence[str], least_wanted: Sequence[Sequence[str]]
) -> tuple[pd.DataFrame, list[str], bool]:
    """Return a table that fits a terminal, the columns left out, and whether labels were cut.

    The table loses the least wanted columns first. Then the keys of the `labels` keep only their last words,
    and long labels lose their ends. Finally, label columns go, from the last on.
    """
    shown, keys, is_cut = table, {name: name for name in table}, False
    for names in least_wanted:
        if table_width(shown) > terminal_width():
            shown = shown.drop(columns=list(names), errors="ignore")
    if table_width(shown) > terminal_width():
        keys |= short_labels(labels)
        shown = shown.rename(columns=keys)
    whole, named = shown, [keys[name] for name in labels]
    for room in LABEL_LENGTHS:
        if table_width(shown) > terminal_width():
            shown, is_cut = (
                whole.assign(
                    **{
                        name: whole[name].map(lambda text, room=room: cut_text(text, room))
                        for name in named
                    }
                ),
                True,
            )
    while table_width(shown) > terminal_width() and any(name in shown for name in named):
        shown = shown.drop(columns=next(name for name in reversed(named) if name in shown))
    return shown, [name for name in table if keys[name] not in shown], is_cut


def short_labels(labels: Sequence[str]) -> Mapping[str, str]:
    """Map dotted keys to their last words, where these are unique."""
    last = [key.rpartition(".")[2] for key in labels]
    return {key: word for key, word in zip(labels, last, strict=True) if last.count(word) == 1}


def table_notes(left_out: Sequence[str], is_cut: bool, file: str) -> list[str]:
    """Return a note below a table that lacks columns or shows shortened labels."""
    between = "; " if any("," in each for each in left_out) else ", "
    words = [f"left out: {between.join(left_out)}"] * bool(left_out) + [
        "… stands where a label is cut short"
    ] * is_cut
    return [fill(f"{'; '.join(words)}; all are in {file}", terminal_width())] if words else []
