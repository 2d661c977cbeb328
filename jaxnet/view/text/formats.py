"""Tables for other programs: CSV with all digits, Markdown and LaTeX as people read them."""

from collections.abc import Callable, Iterator
from typing import Any

import pandas as pd

from jaxnet.view.text.width import number

LATEX = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        **{character: f"\\{character}" for character in "&%$#_{}"},
    }
)


def in_format(table: pd.DataFrame, name: str) -> str:
    """A table in the format of that name."""
    return WRITERS[name](table).rstrip("\n")


def csv(table: pd.DataFrame) -> str:
    """All rows, with all digits."""
    return table.to_csv(index=False)


def markdown(table: pd.DataFrame) -> str:
    """A table as GitHub, pandoc and notebooks read it."""
    rule = ["---:" if pd.api.types.is_numeric_dtype(table[name]) else "---" for name in table]
    names, *rows = ([cell.replace("|", r"\|") for cell in row] for row in shown(table))
    return "\n".join(f"| {' | '.join(row)} |" for row in (names, rule, *rows))


def latex(table: pd.DataFrame) -> str:
    """A `tabular` between plain rules, which needs no package."""
    sides = "".join("r" if pd.api.types.is_numeric_dtype(table[name]) else "l" for name in table)
    names, *rows = (f"{' & '.join(cell.translate(LATEX) for cell in row)} \\\\" for row in shown(table))
    start, end = rf"\begin{{tabular}}{{{sides}}}", r"\end{tabular}"
    return "\n".join([start, r"\hline", names, r"\hline", *rows, r"\hline", end])


def shown(table: pd.DataFrame) -> Iterator[list[str]]:
    """The columns' names, then row by row what the terminal shows."""
    yield list(table)
    for row in table.itertuples(index=False):
        yield [entry(value) for value in row]


def entry(value: Any) -> str:
    """A number to four digits, a dash for none, a label as it is."""
    if not isinstance(value, float):
        return str(value)
    return "-" if pd.isna(value) else number(value)


WRITERS: dict[str, Callable[[pd.DataFrame], str]] = {"csv": csv, "markdown": markdown, "latex": latex}
