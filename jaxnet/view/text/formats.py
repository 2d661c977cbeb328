"""Tables for other programs: CSV with all digits, Markdown and LaTeX with four."""

from collections.abc import Callable, Iterator

import pandas as pd

from jaxnet.view.text.width import four_digits

LATEX_ESCAPES = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        **{character: f"\\{character}" for character in "&%$#_{}"},
    }
)


def in_format(table: pd.DataFrame, name: str) -> str:
    """Return a table in the named format."""
    return FORMAT_WRITERS[name](table).rstrip("\n")


def csv(table: pd.DataFrame) -> str:
    """Return a table as CSV, with all digits."""
    return table.to_csv(index=False)


def markdown(table: pd.DataFrame) -> str:
    """Return a table as Markdown, for GitHub, pandoc and notebooks."""
    rule = ["---:" if pd.api.types.is_numeric_dtype(table[name]) else "---" for name in table]
    names, *rows = ([cell.replace("|", r"\|") for cell in row] for row in displayed_rows(table))
    return "\n".join(f"| {' | '.join(row)} |" for row in (names, rule, *rows))


def latex(table: pd.DataFrame) -> str:
    """Return a LaTeX `tabular` with plain rules, which needs no package."""
    sides = "".join("r" if pd.api.types.is_numeric_dtype(table[name]) else "l" for name in table)
    names, *rows = (
        f"{' & '.join(cell.translate(LATEX_ESCAPES) for cell in row)} \\\\" for row in displayed_rows(table)
    )
    start, end = rf"\begin{{tabular}}{{{sides}}}", r"\end{tabular}"
    return "\n".join([start, r"\hline", names, r"\hline", *rows, r"\hline", end])


def displayed_rows(table: pd.DataFrame) -> Iterator[list[str]]:
    """Yield the column names, then each row as a terminal shows it."""
    yield list(table)
    for row in table.itertuples(index=False):
        yield [displayed_value(value) for value in row]


def displayed_value(value: object) -> str:
    """Return a number to four digits, a dash for NaN, and other values as text."""
    if not isinstance(value, float):
        return str(value)
    return "-" if pd.isna(value) else four_digits(value)


FORMAT_WRITERS: dict[str, Callable[[pd.DataFrame], str]] = {"csv": csv, "markdown": markdown, "latex": latex}
