"""How wide a terminal is, and text that fits it."""

import math
import shutil
from collections.abc import Sequence
from textwrap import fill
from typing import TypeVar

from jaxnet.config.cells import Cell
from jaxnet.config.naming import choices_words, labels_title, value_alone
from jaxnet.model.wording import RESULT_DIGITS, cells_named, number_text

LEAST_WIDTH, GREATEST_WIDTH = 40, 200  # of a terminal, in letters
MOST_ROWS = 60
WIDEST = 90  # letters that name cells by swept values
Value = TypeVar("Value")


def terminal_width() -> int:
    """Width of the terminal in letters, 80 where there is none."""
    return min(max(shutil.get_terminal_size((80, 24)).columns, LEAST_WIDTH), GREATEST_WIDTH)


def filled(words: str) -> str:
    return fill(words, terminal_width())


def cut_text(text: Value, room: int) -> Value | str:
    """Shorten a text with an ellipsis; other values stay."""
    return text if not isinstance(text, str) or len(text) <= room else f"{text[: room - 1]}…"


def cell_title(cell: Cell, room: int = 10_000) -> str:
    """A cell's number and swept values, without their keys where there is no room."""
    shown = labels_title(cell.labels)
    if len(shown) > room - len(f"cell {cell.number}: "):
        shown = ", ".join(value_alone(key, value) for key, value in cell.labels.items())
    return cut_text(f"cell {cell.number}: {shown}" if shown else f"cell {cell.number}", room)


def numbered_words(numbers: Sequence[int], cells: Sequence[Cell]) -> str:
    """Cells by their numbers, with their swept values where these are few letters."""
    words = swept_words(numbers, cells)
    return cells_named(numbers) + f" ({words})" * (0 < len(words) <= WIDEST)


def swept_words(numbers: Sequence[int], cells: Sequence[Cell]) -> str:
    """The values that cells have, or all others have if one phrase says it; "" for all cells."""
    every, told = [cell.labels for cell in cells], list[str]()
    for begin, others in (("", False), ("all but ", True)):
        some = [cell.labels for cell in cells if (cell.number not in numbers) is others]
        phrases = choices_words(some, every) if some else [""]
        if not others or len(phrases) == 1:
            told.append(begin * any(phrases) + "; ".join(phrases))
    return min(told, key=len)


def digits_text(value: object, digits: int = RESULT_DIGITS, whole: float = math.inf) -> str:
    """A number as `number_text` has it, a dash for not-a-number, other values as text."""
    if not isinstance(value, float):
        return str(value)
    return "-" if math.isnan(value) else number_text(value, digits, whole)


def left_out_note(left_out: Sequence[str], file: str) -> list[str]:
    between = "; " if any("," in each for each in left_out) else ", "
    return [filled(f"left out: {between.join(left_out)}; all are in {file}")] * bool(left_out)
