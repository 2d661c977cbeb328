"""How wide a terminal is, and text that fits it."""

import math
import shutil
from collections.abc import Sequence
from textwrap import fill
from typing import TypeVar

from jaxnet.config.cells import Cell
from jaxnet.model.wording import RESULT_DIGITS, number_text

LEAST_WIDTH, GREATEST_WIDTH = 40, 200  # of a terminal, in letters
MOST_ROWS = 60
Value = TypeVar("Value")


def terminal_width() -> int:
    """Width of the terminal in letters, 80 where there is none."""
    return min(max(shutil.get_terminal_size((80, 24)).columns, LEAST_WIDTH), GREATEST_WIDTH)


def filled(words: str) -> str:
    return fill(words, terminal_width())


def cut_text(text: Value, room: int) -> Value | str:
    """Shorten a text with an ellipsis; other values stay."""
    return text if not isinstance(text, str) or len(text) <= room else f"{text[: room - 1]}…"


def cell_title(cell: Cell, room: int) -> str:
    """A cell's name; where it is too long, the number and the shortened values alone."""
    values, shown = [str(value) for value in cell.labels.values()], str(cell)
    for longest in range(max(map(len, values), default=0), 3, -1):
        if len(shown) <= room:
            break
        shown = f"cell {cell.number}: {', '.join(cut_text(value, longest) for value in values)}"
    return cut_text(shown, room)


def digits_text(value: object, digits: int = RESULT_DIGITS, whole: float = math.inf) -> str:
    """A number as `number_text` has it, a dash for not-a-number, other values as text."""
    if not isinstance(value, float):
        return str(value)
    return "-" if math.isnan(value) else number_text(value, digits, whole)


def left_out_note(left_out: Sequence[str], file: str) -> list[str]:
    between = "; " if any("," in each for each in left_out) else ", "
    return [filled(f"left out: {between.join(left_out)}; all are in {file}")] * bool(left_out)
