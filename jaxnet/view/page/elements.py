"""Elements of the page as HTML: sections, tables that sort, plots with their keys, the filter."""

import base64
import json
import re
from collections.abc import Container, Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from jaxnet.config.naming import NO_BREAK
from jaxnet.model.wording import NAME_DIGITS, RESULT_DIGITS
from jaxnet.view.drawings.words import BEFORE_UNIT, NO_LANE, error_text

PAGE_FOLDER = Path(__file__).parent
LARGEST_SINGLE = np.finfo(np.float32).max
NUMBER_CLASS = ' class="number"'
MENU_ITEMS = (
    '<button type="button" data-keep="png">Save as PNG</button>'
    '<button type="button" data-keep="svg">Save as SVG</button>'
    '<button type="button" data-keep="csv">Save data as CSV</button>'
    '<button type="button" data-keep="zoom">Reset zoom</button>'
)
NO_WRAP = r'<span style="white-space: nowrap">\g<0></span>'  # W-MSR, 1e-08
PAGER = (
    '<div class="controls pager" hidden><output></output><button type="button">Previous</button>'
    '<button type="button">Next</button></div>'
)
# Symbols of plotly as SVG paths, in the middle of a swatch of 34 by 14.
SYMBOL_PATHS = {
    "circle": "M13 7a4 4 0 1 0 8 0a4 4 0 1 0-8 0",
    "square": "M13 3H21V11H13z",
    "triangle-up": "M17 2L22 11H12z",
    "triangle-down": "M12 3H22L17 12z",
    "cross": "M15.5 2h3v3.5H22v3h-3.5V12h-3V8.5H12v-3h3.5z",
    "x": "M13 2l4 4 4-4 1 1-4 4 4 4-1 1-4-4-4 4-1-1 4-4-4-4z",
    "star": "M17 1l1.8 3.9 4.2.5-3.1 2.9.8 4.2-3.7-2.1-3.7 2.1.8-4.2L11 5.4l4.2-.5z",
    "diamond": "M17 2l5 5-5 5-5-5z",
    "line-ew": "M12 7H22",
    "cross-thin": "M17 2V12M12 7H22",
    "x-thin": "M13 3L21 11M13 11L21 3",
}


class Section(NamedTuple):
    """A section of the page: HTML below a title."""

    id: str
    title: str
    body: str

    def __str__(self) -> str:
        return f'<section id="{self.id}"><h2>{self.title}</h2>\n{self.body}</section>'


def sentence_case(words: str) -> str:
    """Words with a capital first letter, unless a symbol comes first."""
    return words if words[:1] in "āϑδ" else words[:1].upper() + words[1:]


def unbroken(text: str) -> str:
    """Text as HTML in which no line ends between a number and its unit, or at a hyphen."""
    return re.sub(r"\S+-\S+", NO_WRAP, BEFORE_UNIT.sub(NO_BREAK, escape(text)))


def unbroken_names(section: Section) -> Section:
    """A section in which no line ends inside a name such as W-MSR, which no tag or script has."""
    return section._replace(body=re.sub(r"\b[A-Z]-[A-Z]+\b", NO_WRAP, section.body))


def paragraph(text: str) -> str:
    return f"<p>{text}</p>"


def notes_html(notes: Iterable[str]) -> str:
    """What a table leaves open, below it."""
    told = "".join(f"<li>{unbroken(sentence_case(each))}.</li>" for each in notes if each)
    return f'<ul class="notes">{told}</ul>' if told else ""


class Plot(NamedTuple):
    """A figure for plotly about some cells.

    Colours are names of the style sheet, such as `--blue`. Beside `data` and `layout` a figure has
    `columns` that are saved as CSV, or `x` of all traces, their `names` in CSV, a `floor` of y.
    """

    title: str
    cells: Sequence[int] | None
    figure: dict[str, Any]


def file_text(name: str) -> str:
    return (PAGE_FOLDER / name).read_text(encoding="utf-8")


def plain(text: str) -> str:
    """Text that plotly, too, shows as it is: no markup, no formula."""
    return escape(text).replace("$", "&#36;")


def packed(values: np.ndarray, kind: str = "f4") -> dict[str, str]:
    """Pack an array as plotly does, in base64; clipped to single precision if it is of floats."""
    if kind == "f4":
        values = np.clip(values, -LARGEST_SINGLE, LARGEST_SINGLE)
    content = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
    found = {"dtype": kind, "bdata": base64.b64encode(content).decode()}
    return found | ({"shape": ",".join(map(str, values.shape))} if values.ndim > 1 else {})


def script_json(data: object, marks: str = "") -> str:
    """Data as a script element; not-a-number and infinities, which JSON does not have, are null."""

    def finite(array: Any) -> Any:
        known = np.asarray(array)
        if known.dtype.kind == "f":
            known = np.where(np.isfinite(known), known.astype(object), np.array(None))
        return known.tolist()

    text = json.dumps(data, separators=(",", ":"), allow_nan=False, default=finite)
    text = text.replace("<", "\\u003c")
    return f'<script type="application/json"{marks}>{text}</script>'


def about(cells: Iterable[int] | None) -> str:
    """The attribute by which the page's filter shows an element, if any of its cells is chosen."""
    return "" if cells is None else f' data-cells="{" ".join(map(str, cells))}"'


def plot_html(plot: Plot, look: str = "", height: int = 0, begins: bool = False) -> str:
    title = escape(plot.title)
    style = f' style="height: {height}px"' if height else ""
    heading = f"<h3>{unbroken(plot.title)}</h3>" if title else ""
    return (
        f'<div class="panel{" begins" * begins}"{about(plot.cells)}><div class="head">{heading}'
        f'<details class="menu"><summary aria-label="Keep the plot {title}">⋯</summary>'
        f"<div>{MENU_ITEMS}</div></details></div>"
        f'<div class="plot {look}" role="img" aria-label="{title or "all cells"}"{style}></div>'
        f"{script_json(plot.figure)}</div>"
    )


def key_html(traces: Iterable[Mapping[str, Any]]) -> str:
    """The key of these traces; a click on an entry hides the traces of its name."""
    named: dict[str, Mapping[str, Any]] = {}
    for trace in traces:
        if trace.get("showlegend", True) and trace.get("name"):
            named.setdefault(trace["name"], trace)
    if not named:
        return ""
    entries = "".join(
        f'<li><button type="button" aria-pressed="true" title="click to hide or show"'
        f' data-name="{name}">{swatch(trace)}{name}</button></li>'
        for name, trace in sorted(named.items(), key=lambda entry: entry[0] == NO_LANE)
    )
    return f'<ul class="key">{entries}</ul>'


def swatch(trace: Mapping[str, Any]) -> str:
    """A sample of a trace's line, area and marker as SVG."""
    line, marker, mode = trace.get("line", {}), trace.get("marker", {}), trace.get("mode", "")
    parts = []
    if "fillcolor" in trace:
        parts.append(f'<path d="M0 2H34V12H0z" fill="{painted(trace["fillcolor"])}"/>')
    elif "lines" in mode:
        dashes = line.get("dash", "solid").replace("solid", "none").replace("px", "")
        parts.append(
            f'<path d="M0 7H34" fill="none" stroke="{painted(line["color"])}"'
            f' stroke-width="{line.get("width", 1.6)}" stroke-dasharray="{dashes}"/>'
        )
    if "markers" in mode:
        symbol, colour = marker["symbol"], painted(marker["color"])
        fill = "none" if "open" in symbol else colour
        path = SYMBOL_PATHS[symbol.removesuffix("-open")]
        parts.append(f'<path d="{path}" fill="{fill}" stroke="{colour}" stroke-width="1.6"/>')
    return f'<svg viewBox="0 0 34 14" aria-hidden="true">{"".join(parts)}</svg>'


def painted(colour: str) -> str:
    return f"var({colour})" if colour.startswith("--") else colour


def views_html(views: Mapping[str, str]) -> str:
    """Several views of a section, of which a menu shows one."""
    first, *others = views.values()
    if not others:
        return first
    options = "".join(f"<option>{escape(name)}</option>" for name in views)
    hidden = "".join(each.replace("<div ", "<div hidden ", 1) for each in others)
    menu = f'<label>Show the <select class="views">{options}</select></label>'
    return f'<div class="controls">{menu}</div>{first}{hidden}'


def filter_html(keys: Mapping[str, tuple[str, Sequence[str]]]) -> str:
    """The choice of cells: a menu for each swept key with several values."""
    menus = [
        f'<label>{escape(name)} <select name="{escape(key)}" data-key="{place}">'
        f'<option value="">all</option>'
        + "".join(f'<option value="{escape(each)}">{escape(each)}</option>' for each in values)
        + "</select></label>"
        for place, (key, (name, values)) in enumerate(keys.items())
        if len(values) > 1
    ]
    if not menus:
        return ""
    every = '<button type="button">All cells</button>'
    controls = f'<div class="controls">{"".join(menus)}{every}</div>'
    return f'<details class="filter"><summary>All cells</summary>{controls}</details>'


def facts_html(facts: Mapping[str, Sequence[str]]) -> str:
    """Names, each with its lines of text."""
    told = ((escape(name), "<br>".join(map(escape, lines))) for name, lines in facts.items())
    return f"<dl>{''.join(f'<dt>{name}</dt><dd>{lines}</dd>' for name, lines in told)}</dl>"


def folded_text(name: str, text: str) -> str:
    return f'<details><summary>{name}</summary><pre tabindex="0">{escape(text)}</pre></details>'


def sortable_table(
    rows: pd.DataFrame,
    scales: Mapping[str, np.ndarray] | None = None,
    intervals: Mapping[str, Sequence[str]] | None = None,
    cells: Iterable[Iterable[int]] | None = None,
    names: Container[str] = (),
) -> str:
    """Rows as a sortable HTML table: numbers rounded, exact values for the sort.

    The page's filter looks at the column "cell", or at the `cells` of each row. Columns named in
    `scales` hold errors; those below rounding, relative to the row's scale, are marked. `intervals`
    stand beside the values of a column. `names` are the columns of swept keys.
    """
    heads, columns, nothing = [], [], [""] * len(rows)
    for name, values in rows.items():
        number = values.dtype.kind in "iuf"
        heads.append(
            f'<th scope="col" aria-sort="none"{NUMBER_CLASS if number else ""}>'
            f'<button type="button">{escape(str(name))}</button></th>'
        )
        texts = [f"<td>{escape(str(value))}</td>" for value in values]
        if number:
            sizes = (scales or {}).get(str(name), np.zeros(len(rows)))
            beside = (intervals or {}).get(str(name), nothing)
            digits = NAME_DIGITS if str(name) in names else RESULT_DIGITS
            whole = 100.0 if str(name).endswith("[%]") else np.inf
            those = zip(values.tolist(), sizes, beside, strict=True)
            texts = [number_cell(*each, digits, whole) for each in those]
        columns.append(texts)
    if cells is None and "cell" in rows:
        cells = ([cell] for cell in rows["cell"])
    marks = nothing if cells is None else map(about, cells)
    lines = "\n".join(
        f"<tr{mark}>{''.join(line)}</tr>" for mark, *line in zip(marks, *columns, strict=True)
    )
    return (
        f'<div class="box" tabindex="0"><table><thead><tr>{"".join(heads)}</tr></thead>'
        f"<tbody>{lines}</tbody></table></div>"
    )


def number_cell(
    value: float | int,
    scale: float = 0.0,
    interval: str = "",
    digits: int = RESULT_DIGITS,
    whole: float = np.inf,
) -> str:
    """A number as a table cell, then its interval: a dash for not-a-number."""
    if np.isnan(value):
        return f"<td{NUMBER_CLASS}>–</td>"
    if np.isinf(value):
        return f'<td{NUMBER_CLASS} data-value="Infinity">∞</td>'
    beside = f" <small>{escape(interval)}</small>" if interval else ""
    text = str(value) if isinstance(value, int) else error_text(value, scale, digits, whole)
    return f'<td{NUMBER_CLASS} data-value="{value!r}">{text}{beside}</td>'
