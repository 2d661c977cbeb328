"""What the page's sections are made of: tables that sort, numbers as they are read, text that opens."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape

import numpy as np
import pandas as pd

from jaxnet.view.text import tables

# Of ā, or [m] where no ā is known. Doubles carry 1e-16 of positions of tens of metres through thousands of
# ticks, some 1e-12 m: what is below this is arithmetic, and far below any error that a robot has.
ROUNDING = 1e-9


def folded(name: str, text: str) -> str:
    """Text that opens on a click."""
    return f'<details><summary>{name}</summary><pre tabindex="0">{escape(text)}</pre></details>'


def sortable(
    rows: pd.DataFrame,
    cells: Iterable[Sequence[int]] | None = None,
    scales: Mapping[str, np.ndarray] | None = None,
) -> str:
    """Rows as a table that sorts; numbers to four digits, and in full for the sorting.

    Each row may be about some cells, by which the reader chooses. Columns with scales, one of each row, hold
    errors: what is rounding to its scale is shown as such.
    """
    scales = scales or {}
    numeric = [dtype.kind in "iuf" for dtype in rows.dtypes]
    heads = "".join(
        f'<th scope="col" aria-sort="none"{NUMBER if number else ""}>'
        f'<button type="button">{escape(str(name))}</button></th>'
        for name, number in zip(rows.columns, numeric, strict=True)
    )
    by_column = [
        [
            number_cell(value, scale) if number else f"<td>{escape(str(value))}</td>"
            for value, scale in zip(
                rows.iloc[:, n].tolist(), scales.get(rows.columns[n], np.zeros(len(rows))), strict=True
            )
        ]
        for n, number in enumerate(numeric)
    ]
    lines = "\n".join(
        f'<tr data-cells="{" ".join(map(str, about))}">{"".join(line)}</tr>'
        for about, *line in zip([()] * len(rows) if cells is None else cells, *by_column, strict=True)
    )
    return (
        f'<div class="box" tabindex="0"><table><thead><tr>{heads}</tr></thead>'
        f"<tbody>{lines}</tbody></table></div>"
    )


NUMBER = ' class="number"'


def number_cell(value: float | int, scale: float = 0.0) -> str:
    """A number; a dash where there is none; zero where it is rounding to its scale."""
    if np.isnan(value):
        return f"<td{NUMBER}>–</td>"
    if np.isinf(value):
        return f'<td{NUMBER} data-value="Infinity">∞</td>'
    text = str(value) if isinstance(value, int) else measured(value, scale)
    return f'<td{NUMBER} data-value="{value!r}">{text}</td>'


def measured(value: float, scale: float = 1.0) -> str:
    """An error, or one per ā (scale 1); a scale that is not known is a metre, and 0 is of no error."""
    known = 1.0 if np.isnan(scale) else scale
    if 0 < abs(value) < ROUNDING * known:
        return "0 (rounding)"
    return "∞" if value == np.inf else tables.number(value)
