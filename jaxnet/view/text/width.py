"""Text no wider than a terminal, and notes on what was shortened or left out."""

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import TypeVar

import pandas as pd

from jaxnet.config.cells import Cell

Value = TypeVar("Value")

TERMINAL_WIDTH = 80
MOST_ROWS = 60
LABEL_LENGTHS = range(40, 9, -1)  # characters that long labels are cut to, the first that fits


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
    """Return a table as text, a line per row."""
    return table.to_string(index=False, float_format=four_digits, na_rep="-")


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
        if table_width(shown) > TERMINAL_WIDTH:
            shown = shown.drop(columns=list(names), errors="ignore")
    if table_width(shown) > TERMINAL_WIDTH:
        keys |= short_labels(labels)
        shown = shown.rename(columns=keys)
    whole, named = shown, [keys[name] for name in labels]
    for room in LABEL_LENGTHS:
        if table_width(shown) > TERMINAL_WIDTH:
            shown, is_cut = (
                whole.assign(
                    **{name: whole[name].map(lambda text, room=room: cut_text(text, room)) for name in named}
                ),
                True,
            )
    while table_width(shown) > TERMINAL_WIDTH and any(name in shown for name in named):
        shown = shown.drop(columns=next(name for name in reversed(named) if name in shown))
    return shown, [name for name in table if keys[name] not in shown], is_cut


def short_labels(labels: Sequence[str]) -> Mapping[str, str]:
    """Map dotted keys to their last words, where these are unique."""
    last = [key.rpartition(".")[2] for key in labels]
    return {key: word for key, word in zip(labels, last, strict=True) if last.count(word) == 1}


def table_notes(left_out: Sequence[str], is_cut: bool, file: str) -> list[str]:
    """Return a note below a table that lacks columns or shows shortened labels."""
    words = [f"left out: {', '.join(left_out)}"] * bool(left_out) + [
        "… stands where a label is cut short"
    ] * is_cut
    return [fill(f"{'; '.join(words)}; all are in {file}", TERMINAL_WIDTH)] if words else []
