"""The printer of all tables: numbers at the right, labels wrapped, as many columns as fit."""

import io
import re
from collections.abc import Mapping, Sequence
from textwrap import wrap

import pandas as pd
from rich.console import Console
from rich.table import Table

from jaxnet.view.text.width import GREATEST_WIDTH, four_digits, terminal_width

LEAST_TITLE = 9  # letters of a line of a title
LEAST_LABEL = 20  # letters that a label is wrapped to, at least
GAP = 2  # letters between columns
NUMBER = re.compile(r"-?(\d|inf|nan).*|-|")

# A step of narrowing: the titles of columns that go, or shorter texts of columns.
Narrowing = Sequence[str] | Mapping[str, Sequence[str]]


def shown(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    return "-" if value != value else four_digits(value)


def table_text(
    table: pd.DataFrame, labels: Sequence[str] = (), width: int = 2 * GREATEST_WIDTH
) -> str:
    """Table as text of this width; the columns of `labels` are wrapped to fit."""
    drawn = Table(box=None, padding=(0, GAP, 0, 0), pad_edge=False, header_style="")
    columns = texts_of(table)
    titles = [title_lines(name, texts) for name, texts in columns.items()]
    high = max(map(len, titles), default=0)
    for lines, (name, texts) in zip(titles, columns.items(), strict=True):
        is_number = name not in labels and all(map(NUMBER.fullmatch, texts))
        drawn.add_column(
            "\n".join([""] * (high - len(lines)) + lines),
            justify="right" if is_number else "left",
            no_wrap=name not in labels,
            overflow="fold",
        )
    for row in zip(*columns.values(), strict=True):
        drawn.add_row(*row)
    page = io.StringIO()
    Console(file=page, width=width, markup=False, highlight=False, emoji=False).print(drawn)
    return "\n".join(line.rstrip() for line in page.getvalue().rstrip("\n").split("\n"))


def texts_of(table: pd.DataFrame) -> dict[str, list[str]]:
    return {
        str(name): [shown(value) for value in table.iloc[:, place].tolist()]
        for place, name in enumerate(table)
    }


def title_lines(title: str, texts: Sequence[str]) -> list[str]:
    """A title on lines about as long as the values; no word is broken."""
    room = max([LEAST_TITLE, *map(len, texts)])
    return wrap(title, room, break_long_words=False, break_on_hyphens=False) or [""]


def least_width(table: pd.DataFrame, labels: Sequence[str]) -> int:
    """Letters that a table takes with its labels wrapped."""
    total = -GAP
    for name, texts in texts_of(table).items():
        whole = max(map(len, [*title_lines(name, texts), *texts]))
        total += GAP + (min(whole, LEAST_LABEL) if name in labels else whole)
    return total


def fit_columns(
    table: pd.DataFrame, labels: Sequence[str], steps: Sequence[Narrowing]
) -> pd.DataFrame:
    """Table that fits the terminal: take the steps in turn, then drop labels from the last on."""
    for step in [*steps, *([label] for label in reversed(labels))]:
        if least_width(table, labels) <= terminal_width():
            break
        if isinstance(step, Mapping):
            table = table.assign(**step)
        else:
            table = table.drop(columns=list(step), errors="ignore")
    return table


def fitted_text(
    table: pd.DataFrame, labels: Sequence[str], steps: Sequence[Narrowing]
) -> tuple[str, list[str]]:
    """Table that fits the terminal as text, and the titles of the columns left out."""
    narrow = fit_columns(table, labels, steps)
    left_out = [str(name) for name in table if name not in narrow]
    return table_text(narrow, labels, terminal_width()), left_out
