"""`report.html`: one file with all about a results folder, which works offline and asks nobody for anything.

`sections` writes its text and tables out of `elements`, `findings` and `networks`; `plots` and `trajectories`
give the numbers of what the scripts draw with plotly.js, which is inlined; `page.css` has the light and the
dark look. Each script is about one thing, and uses those before it.
"""

import json
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from plotly.offline import get_plotlyjs
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.config.naming import value_name
from jaxnet.statistics.groups import values_of
from jaxnet.store.results import Results
from jaxnet.view.figures import style
from jaxnet.view.page import sections

HERE = Path(__file__).parent
SCRIPTS = ("base", "sort", "filter", "plot", "multiples", "heat", "lanes", "tables", "paper")
COLOURS = {
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
    """Write `report.html`; raises FolderError for an unfinished run."""
    data = {"name": results.study.config.name, **choices(results.study.cells)}
    shown = sections.every(results)
    data |= {"sections": {each.id: each.plots for each in shown if each.plots}}
    text = whole(
        escape(results.study.config.name), sections.lead(results), shown, data, get_plotlyjs(), SCRIPTS
    )
    return results.folder.put("report.html", lambda file: file.write(text.encode()))


def whole(
    name: str,
    lead: str,
    shown: Sequence[sections.Section],
    data: object = None,
    plotly: str = "",
    scripts: Sequence[str] = ("base", "sort"),
) -> str:
    """A page of these sections, in one file, with what its scripts draw."""
    return Template((HERE / "page.html").read_text(encoding="utf-8")).substitute(
        name=name,
        lead=lead,
        contents=" ".join(f'<a href="#{each.id}">{each.title}</a>' for each in shown),
        sections="\n".join(map(str, shown)),
        palette=f":root {{ {' '.join(f'--{name}: {value};' for name, value in COLOURS.items())} }}",
        css=(HERE / "page.css").read_text(encoding="utf-8"),
        data=encode(data),
        plotly=plotly,
        script="\n".join((HERE / f"{each}.js").read_text(encoding="utf-8") for each in scripts),
    )


def choices(cells: tuple[Cell, ...]) -> dict[str, Any]:
    """Swept keys with their values as the page tells them, and the place of each cell's values among them."""
    values = values_of(cells)
    places = {key: {value: place for place, value in enumerate(given)} for key, given in values.items()}
    return {
        "keys": {key: [value_name(key, value) for value in given] for key, given in values.items()},
        "cells": [[places[key][cell.labels[key]] for key in values] for cell in cells],
    }


def encode(data: object) -> str:
    """JSON that can stand in a script element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")
