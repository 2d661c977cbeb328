"""The page `report.html`: one file about a results folder, which works offline.

`sections` lists what the page says, in the words of `findings` and `setting`. `plots` and
`trajectories` make the figures, `elements` the HTML. The scripts draw and filter; they compute
nothing that is shown.
"""

from collections.abc import Sequence
from html import escape
from string import Template

from plotly.offline import get_plotlyjs
from upath import UPath

from jaxnet.config.naming import key_name, value_name
from jaxnet.statistics.groups import swept_values_of
from jaxnet.store.results import Results
from jaxnet.view.page import sections
from jaxnet.view.page.elements import Section, file_text, filter_html, script_json
from jaxnet.view.page.plots import COLOURS


def write_page(results: Results) -> UPath:
    """Write `report.html` and return its path; raise FolderError for an unfinished run."""
    cells, name = results.study.cells, results.study.config.name
    swept = swept_values_of(cells)
    texts = {key: [value_name(key, value) for value in values] for key, values in swept.items()}
    data = {
        "name": name,
        "cells": [[swept[key].index(cell.labels[key]) for key in swept] for cell in cells],
    }
    shown = sections.page_sections(results)
    choice = filter_html({key: (key_name(key), values) for key, values in texts.items()})
    text = page_html(escape(name), sections.lead_sentence(results), shown, choice, data)
    return results.folder.put("report.html", lambda file: file.write(text.encode()))


def page_html(
    name: str, lead: str, shown: Sequence[Section], choice: str = "", data: object = None
) -> str:
    """A page of these sections as one HTML file; with `data`, scripts that draw plots."""
    files = ("page.js",) if data is None else ("page.js", "plot.js", "lanes.js")
    return Template(file_text("page.html")).substitute(
        name=name,
        lead=lead,
        contents=" ".join(f'<a href="#{each.id}">{each.title}</a>' for each in shown),
        sections="\n".join(map(str, shown)),
        choice=choice,
        palette=f":root {{ {' '.join(f'{name}: {given};' for given, name in COLOURS.items())} }}",
        css=file_text("page.css"),
        data=script_json({"cells": []} if data is None else data, ' id="data"'),
        plotly="" if data is None else get_plotlyjs(),
        script="\n".join(map(file_text, files)),
    )
