"""Elements of the page: sortable tables, formatted numbers, text that unfolds."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape

import numpy as np
import pandas as pd

from jaxnet.view.columns import is_rounding
from jaxnet.view.text.width import four_digits


def folded_text(name: str, text: str) -> str:
    """Return text that unfolds on a click, as HTML."""
    return f'<details><summary>{name}</summary><pre tabindex="0">{escape(text)}</pre></details>'


def sortable_table(
    rows: pd.DataFrame,
    cells: Iterable[Sequence[int]] | None = None,
    scales: Mapping[str, np.ndarray] | None = None,
    intervals: Mapping[str, Sequence[str]] | None = None,
) -> str:
    """Return rows as a sortable HTML table: numbers to four digits, exact values for the sort.

    `cells` lists the cells of each row, for the page's filter. Columns named in `scales` hold errors. Errors
    below rounding, relative to the row's scale, are marked. `intervals` stand beside the values of a column.
    """
    scales, intervals = scales or {}, intervals or {}
    numeric = [dtype.kind in "iuf" for dtype in rows.dtypes]
    heads = "".join(
        f'<th scope="col" aria-sort="none"{NUMBER_CLASS if number else ""}>'
        f'<button type="button">{escape(str(name))}</button></th>'
        for name, number in zip(rows.columns, numeric, strict=True)
    )
    by_column = [
        [
            number_cell(value, scale, interval) if number else f"<td>{escape(str(value))}</td>"
            for value, scale, interval in zip(
                rows.iloc[:, n].tolist(),
                scales.get(rows.columns[n], np.zeros(len(rows))),
                intervals.get(rows.columns[n], [""] * len(rows)),
                strict=False,
            )
        ]
        for n, number in enumerate(numeric)
    ]
    lines = "\n".join(
        f'<tr data-cells="{" ".join(map(str, about))}">{"".join(line)}</tr>'
        for about, *line in zip(
            [()] * len(rows) if cells is None else cells, *by_column, strict=True
        )
    )
    return (
        f'<div class="box" tabindex="0"><table><thead><tr>{heads}</tr></thead>'
        f"<tbody>{lines}</tbody></table></div>"
    )


NUMBER_CLASS = ' class="number"'


def number_cell(value: float | int, scale: float = 0.0, interval: str = "") -> str:
    """Return a number as a table cell: a dash for NaN, "0 (rounding)" below rounding, then its interval."""
    if np.isnan(value):
        return f"<td{NUMBER_CLASS}>–</td>"
    if np.isinf(value):
        return f'<td{NUMBER_CLASS} data-value="Infinity">∞</td>'
    beside = f" <small>{escape(interval)}</small>" if interval else ""
    text = str(value) if isinstance(value, int) else error_text(value, scale)
    return f'<td{NUMBER_CLASS} data-value="{value!r}">{text}{beside}</td>'


def error_text(value: float, scale: float = 1.0) -> str:
    """Return an error, or an error per ā with scale 1; below rounding "0 (rounding)".

    An unknown scale counts as 1 m. A scale of 0 switches the test for rounding off.
    """
    if is_rounding(value, scale):
        return "0 (rounding)"
    return "∞" if value == np.inf else four_digits(value)
