"""The page `report.html`: one file about a results folder, which works offline.

`sections` writes text and tables from `elements`, `findings` and `networks`. `plots` and `trajectories` give
data for the scripts, which draw with an inlined plotly.js. `page.css` has a light and a dark theme. Each
script treats one subject and may use the scripts before it.
"""

import json
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template

from plotly.offline import get_plotlyjs
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.config.naming import key_name, value_name
from jaxnet.statistics.groups import swept_values_of
from jaxnet.store.results import Results
from jaxnet.view.figures import style
from jaxnet.view.page import sections

PAGE_FOLDER = Path(__file__).parent
SCRIPTS = ("base", "sort", "filter", "plot", "multiples", "heat", "lanes", "tables", "paper")
PALETTE = {
    "blue": style.BLUE,
    "orange": style.ORANGE,
    "green": style.GREEN,
    "red": style.RED,
    "purple": style.PURPLE,
    "sky": style.SKY,
    "black": style.BLACK,
    "band": "rgba(0, 114, 178, 0.22)",
}


def write_page(results: Results) -> UPath:
    """Write `report.html` and return its path; raise FolderError for an unfinished run."""
    data = {"name": results.study.config.name, **swept_choices(results.study.cells)}
    shown = sections.page_sections(results)
    data |= {"sections": {each.id: each.plots for each in shown if each.plots}}
    text = page_html(
        escape(results.study.config.name),
        sections.lead_sentence(results),
        shown,
        data,
        get_plotlyjs(),
        SCRIPTS,
    )
    return results.folder.put("report.html", lambda file: file.write(text.encode()))


def page_html(
    name: str,
    lead: str,
    shown: Sequence[sections.Section],
    data: object = None,
    plotly: str = "",
    scripts: Sequence[str] = ("base", "sort"),
) -> str:
    """Return a page of these sections as one HTML file, with scripts and the data that they draw."""
    return Template((PAGE_FOLDER / "page.html").read_text(encoding="utf-8")).substitute(
        name=name,
        lead=lead,
        contents=" ".join(f'<a href="#{each.id}">{each.title}</a>' for each in shown),
        sections="\n".join(map(str, shown)),
        palette=f":root {{ {' '.join(f'--{name}: {value};' for name, value in PALETTE.items())} }}",
        css=(PAGE_FOLDER / "page.css").read_text(encoding="utf-8"),
        data=json_for_script(data),
        plotly=plotly,
        script="\n".join(
            (PAGE_FOLDER / f"{each}.js").read_text(encoding="utf-8") for each in scripts
        ),
    )


def swept_choices(cells: tuple[Cell, ...]) -> dict[str, object]:
    """Return the formatted values of each swept key, and each cell's indices into these values."""
    values = swept_values_of(cells)
    places = {
        key: {value: place for place, value in enumerate(given)} for key, given in values.items()
    }
    return {
        "names": [key_name(key) for key in values],
        "keys": {key: [value_name(key, value) for value in given] for key, given in values.items()},
        "cells": [[places[key][cell.labels[key]] for key in values] for cell in cells],
    }


def json_for_script(data: object) -> str:
    """Return JSON that is safe inside a script element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")
