"""`report.html`: one file with all about a results folder, which works offline and asks nobody for anything.

`sections` writes its text and tables out of `elements`, `plots` and `trajectories` give the numbers of its
plots, `page.js` draws them with plotly.js, which is inlined; `page.css` has the light and the dark look.
"""

import json
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template

from plotly.offline import get_plotlyjs
from upath import UPath

from jaxnet.store.folder import Folder
from jaxnet.store.results import Results
from jaxnet.view.figures import style
from jaxnet.view.page import sections

HERE = Path(__file__).parent
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
    """Write `report.html` into the results folder; raises FolderError for an unfinished run."""
    name, lead = escape(results.study.config.name), sections.lead(results)
    text = whole(name, lead, sections.every(results))
    return Folder(results.path).put("report.html", lambda file: file.write(text.encode()))


def whole(name: str, lead: str, shown: Sequence[sections.Section]) -> str:
    """A page of these sections, in one file."""
    data = {each.id: each.plots for each in shown if each.plots}
    return Template((HERE / "page.html").read_text(encoding="utf-8")).substitute(
        name=name,
        lead=lead,
        contents=" ".join(f'<a href="#{each.id}">{each.title}</a>' for each in shown),
        sections="\n".join(map(str, shown)),
        palette=f":root {{ {' '.join(f'--{name}: {value};' for name, value in COLOURS.items())} }}",
        css=(HERE / "page.css").read_text(encoding="utf-8"),
        data=encode(data),
        plotly=get_plotlyjs() if data else "",
        script=(HERE / "page.js").read_text(encoding="utf-8"),
    )


def encode(data: object) -> str:
    """JSON that can stand in a script element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")
