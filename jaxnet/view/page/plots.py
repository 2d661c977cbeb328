"""A drawing on the page: a plotly figure a panel, with a key and a pager for all of them.

A colour is a name of the style sheet, such as `--blue`, so that it follows the light. A figure is
about the cells of its panel; a trace whose `meta` has cells, one a point, shows those chosen.
"""

import io
import itertools
import re
from collections.abc import Callable, Sequence
from html import escape
from math import ceil, floor, log10
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.colors import to_hex
from matplotlib.ticker import MaxNLocator

from jaxnet.config.cells import Cell
from jaxnet.config.naming import labels_title
from jaxnet.model.wording import number_text
from jaxnet.statistics.curves import LOG_FLOOR
from jaxnet.view.drawings.drawing import DODGE, OUTSIDE, Drawing, Look, Panel, Scale, Trace
from jaxnet.view.drawings.heat import COLOUR_MAP, PALETTE, colour_norm, text_colour
from jaxnet.view.drawings.words import error_text, lines_within
from jaxnet.view.figures import style
from jaxnet.view.figures.multiples import most_in_row, panel_columns, sharing_first
from jaxnet.view.figures.printed import value_ticks
from jaxnet.view.figures.topology import topology_figure
from jaxnet.view.page.elements import PAGER, Plot, key_html, notes_html, packed, plain, plot_html

COLOUR_NAMES = ("BLUE", "ORANGE", "GREEN", "RED", "PURPLE", "SKY", "BLACK", "BROWN")
COLOURS = {getattr(style, name): f"--{name.lower()}" for name in COLOUR_NAMES}
PLOTLY_SYMBOLS = {
    "o": "circle",
    "s": "square",
    "D": "diamond",
    "P": "cross",
    "X": "x",
    "*": "star",
    "^": "triangle-up",
    "v": "triangle-down",
    "_": "line-ew",
    "x": "x-thin",
}
DASH_SCALE, LEAST_DASH = 1.2, 2.0  # [px] of a dash of one width of the line, and of any
WIDTH_SCALE = 1.6  # [px] of a line of 1 pt
MARKER_SIZE, RIM = 6, 1.4  # [px] of a marker, and of its rim, all that is seen of a hollow one
TIME_AXIS = {"title": {"text": "t [s]"}, "rangemode": "tozero"}
LONE_HEIGHT = 340  # [px] of the only panel
LETTERS, ACROSS = 26, 40  # of a line of a name on an axis, and of the title along x
LOG_ROOM = 1.25  # at the ends of a log axis
TICKS_APART = {"x": 1.5, "y": 0.5}  # decades from the tick of an end of a log axis to the next
MAP_FRAME, MAP_ROW = 100, 34  # [px] of a map, and of each of its rows
ROOM_OF_TICKS = 2.0  # [in] of an axis with ticks at swept values
MOST_IN_ROW, DESK, TILE = 4, 1140, 42  # panels in a row; [px] of a row, and of a tile in it
MOST_INTERVALS = 400  # tiles that have room for theirs
LINE, LEAST_ROW, ROW_OF_SERIES, FRAME = 36, 26, 13, 34  # [px] of a panel of named rows


def plotted(drawing: Drawing) -> str:
    """The plots of a drawing as HTML."""
    layout = {"xaxis": axis(drawing, "x"), "yaxis": axis(drawing, "y")}
    plots = [plot_of(drawing, panel, layout) for panel in drawing.panels]
    title = f'<p class="key-title">{escape(drawing.key)}</p>' if drawing.key else ""
    height = LONE_HEIGHT if len(plots) == 1 else 0
    if names := drawing.y.names:
        row = max(LEAST_ROW, ROW_OF_SERIES * drawing.beside)
        lines = on_lines(drawing.x.title, ACROSS).count("<br>") + 1
        height = FRAME + LINE * lines + row * len(names)
    return plots_html(drawing, plots, MOST_IN_ROW, height, title)


def plots_html(
    drawing: Drawing, plots: Sequence[Plot], most: int, height: int, above: str, kind: str = ""
) -> str:
    """Small multiples, at most so many in a row, with key, pager and notes; a `kind` has a style.

    Panels of one first swept value that fill a row begin a row, also where a window is narrow.
    """
    labels = [panel.labels for panel in drawing.panels]
    across, run = panel_columns(labels, most_in_row(labels, most)), sharing_first(labels)
    begin = range(0, len(plots), max(run, across)) if run > 1 else ()
    drawn = "".join(plot_html(each, "", height, n in begin) for n, each in enumerate(plots))
    key = key_html(trace for plot in plots for trace in plot.figure["data"])
    grid = f'<div class="grid" style="--columns: {across}">{drawn}</div>'
    told = f'{notes_html(drawing.told(drawing.panels))}<output class="told"></output>'
    return f'<div class="view {kind}">{above}{key}{PAGER}{grid}{told}</div>'


def tiled(drawing: Drawing) -> str:
    """The maps of a drawing as HTML, which arrow keys walk over, with their scale of colours."""
    assert drawing.colours is not None
    norm, title, last = colour_norm(drawing.colours), drawing.colours.title, len(PALETTE) - 1
    layout = {}
    for letter, scale in (("x", drawing.x), ("y", drawing.y)):
        named = {"title": {"text": plain(scale.title)}, "showgrid": False}
        layout[f"{letter}axis"] = names_axis(scale.names, falling=letter == "y") | named
    reach: Any = norm.vmin, norm.vmax
    signs = zip(("≤ ", "≥ "), drawing.beyond(drawing.panels), strict=True)
    named = zip(signs, map(named_powers(*reach), reach), strict=True)
    ends = [sign * there + end for (sign, there), end in named]
    bar = {"title": {"text": plain(title), "side": "right"}, "tickvals": [0, 1], "ticktext": ends}
    look = {"type": "heatmap", "zmin": 0, "zmax": 1, "xgap": 1, "ygap": 1, "showscale": False}
    look |= {"texttemplate": "%{text}", "hoverinfo": "text", "textfont": {"color": "--text"}}
    look["colorscale"] = [[n / last, colour] for n, colour in enumerate(PALETTE)]
    look["colorbar"] = bar  # of a picture that is saved
    few, plots = sum(len(panel.cells) for panel in drawing.panels) <= MOST_INTERVALS, []
    side = 40 + 7 * min(LETTERS, max(map(len, drawing.y.names)))  # [px] beside the tiles
    every = [panel.tiles for panel in drawing.panels if panel.tiles is not None]
    pairs = [(each.texts, each.intervals) for each in every]
    longest = [max(map(len, np.ravel(some))) for some in zip(*pairs, strict=True)]
    meta = {"side": side, "letters": longest}  # of numbers and of intervals
    for panel, tiles in zip(drawing.panels, every, strict=True):
        places = np.ma.filled(norm(tiles.values), np.nan)
        known, shape = tiles.cells >= 0, places.shape
        each = zip(places.flat, tiles.texts.flat, tiles.intervals.flat, strict=True)
        texts = [tile_html(place, text, interval * few) for place, text, interval in each]
        trace = look | {"z": places, "meta": meta | {"cells": tiles.cells}}
        trace["text"] = np.reshape(texts, shape).tolist()
        trace["hovertext"] = np.reshape([*map(plain, tiles.told.ravel())], shape).tolist()
        columns = {"cell": tiles.cells[known], title: tiles.values[known]}
        figure = {"data": [trace], "layout": layout, "columns": columns}
        plots.append(Plot(labels_title(panel.labels), panel.cells, figure))
    shade = f"<i style='background: linear-gradient(to right, {', '.join(PALETTE)})'></i>"
    blank = f"<span>no number: {drawing.blank}</span>" if drawing.blank else ""
    scale = (
        f"<span>{escape(title)}</span><span>{ends[0]}</span>{shade}<span>{ends[1]}</span>{blank}"
    )
    most = max(1, min(MOST_IN_ROW, DESK // (side + TILE * len(drawing.x.names))))
    height = MAP_FRAME + MAP_ROW * len(drawing.y.names)
    drawn = plots_html(drawing, plots, most, height, f'<div class="scale">{scale}</div>', "tiles")
    return drawn.replace('role="img"', 'role="group" tabindex="0"')


def tile_html(place: float, text: str, interval: str) -> str:
    """What stands in a tile at a place of the scale, in an ink that contrasts with its colour."""
    told = f"{text}<br>{interval}" if interval else text
    if np.isnan(place):
        return f"–{told}"
    return f'<span style="color:{text_colour(to_hex(COLOUR_MAP(place)))}">{told}</span>'


def plot_of(drawing: Drawing, panel: Panel, layout: dict[str, Any]) -> Plot:
    """A panel; series over a common time are packed, others have their numbers in full for CSV."""
    about, title, many = [*panel.cells], labels_title(panel.labels), panel.series
    if panel.words:
        middle = {"x": 0.5, "y": 0.5, "xref": "paper", "yref": "paper", "showarrow": False}
        layout = layout | {"annotations": [middle | {"text": plain(panel.words)}]}
    timed = [each for each in many if each.cells is None and len(each.x) > 2]
    shared = bool(timed) and all(each.x is timed[0].x for each in many)
    traces: list[dict[str, Any]] = []
    for each in many:
        for place, part in enumerate(drawing.parted(each)):
            found = traces_of(drawing, part, shared)
            traces += [trace | {"showlegend": False} for trace in found] if place else found
    if shared:
        saved = (["q05", "q95"] if each.form == "band" else [each.name] for each in many)
        names = [*itertools.chain.from_iterable(saved)]
        common = {"x": packed(timed[0].x), "names": names, "floor": LOG_FLOOR}
        return Plot(title, about, {"data": traces, "layout": layout} | common)
    found, names = [], drawing.y.names
    for series in many:
        rows = [names[round(place)] for place in series.y] if names else series.y
        columns = {drawing.key or "series": series.name, drawing.x.title: series.x}
        columns |= {drawing.y.title or "row": rows}
        columns |= {"low": series.low, "high": series.high, "cell": series.cells}
        given = {name: each for name, each in columns.items() if each is not None}
        found.append(pd.DataFrame(given))
    columns: dict[Any, Any] = {drawing.x.title: [], drawing.y.title: []}
    if found:
        columns = dict(pd.concat(found).dropna(axis="columns", how="all"))
    return Plot(title, about, {"data": traces, "layout": layout, "columns": columns})


def traces_of(drawing: Drawing, series: Trace, is_packed: bool) -> list[dict[str, Any]]:
    """A trace, or the two edges of a band."""
    look = series.look
    if series.form == "band":
        look, edges = look._replace(width=0.0), []
        for name, end in (("5 %", series.low), ("95 %", series.high)):
            edges.append(line_trace(series.name, look, [], packed(end), f"{name} %{{y:.3~g}}"))
        filled = {"fill": "tonexty", "fillcolor": "--band"}
        return [edges[0] | {"showlegend": False}, edges[1] | filled]
    if is_packed:
        hover = f"{plain(series.name)} %{{y:.3~g}} m at %{{x:.3~g}} s"
        return [line_trace(series.name, look, [], packed(series.y), hover)]
    rows = bool(drawing.y.names)
    scale = drawing.x if rows else drawing.y
    drawn = scale.within(series.x if rows else series.y, series.form)
    x, y = (drawn, series.y) if rows else (series.drawn_x, drawn)
    found = line_trace(series.name, look, x, y, "%{text}")
    found["text"] = hints(drawing, series)
    if series.form in ("points", "both", OUTSIDE):
        symbol = PLOTLY_SYMBOLS[look.marker] + "-open" * (look.hollow or look.marker in "_x")
        found["mode"] = "lines+markers" if series.form == "both" else "markers"
        colour = found["line"]["color"]
        found["marker"] = {"color": colour, "symbol": symbol, "size": MARKER_SIZE}
        found["marker"]["line"] = {"color": colour, "width": RIM}
    if series.form == "steps":
        found["line"]["shape"] = "hv"
    if series.cells is not None:
        found["meta"] = {"cells": series.cells}
    if series.low is None:
        return [found]
    middle, color = x if rows else y, found["line"]["color"]
    (low, high), beyond = scale.bars(series.low, middle, series.high)
    bars = {"symmetric": False, "array": high - middle, "thickness": 1.3, "width": 2}
    bars |= {"arrayminus": middle - low, "color": color}
    arrows, sides = [], ("left", "right") if rows else ("down", "up")
    for end, there, side in zip((low, high), beyond, sides, strict=True):
        if there.any():
            at = {"x": end[there], "y": y[there]} if rows else {"x": x[there], "y": end[there]}
            mark = {"color": color, "symbol": f"triangle-{side}", "size": MARKER_SIZE}
            arrow = at | {"mode": "markers", "marker": mark, "showlegend": False}
            if series.cells is not None:
                arrow["meta"] = {"cells": np.array(series.cells)[there]}
            arrows.append(line_trace(series.name, look, [], []) | arrow)
    return [found | {"error_x" if rows else "error_y": bars}, *arrows]


def hints(drawing: Drawing, series: Trace) -> list[str]:
    """What each point tells: its series, its place, and its value with the interval."""
    rows = bool(drawing.y.names)
    scale, across = (drawing.x, drawing.y) if rows else (drawing.y, drawing.x)
    values, at = (series.x, series.y) if rows else (series.y, series.x)
    nothing = np.full(len(values), np.nan)
    ends = zip(*(nothing if end is None else end for end in (series.low, series.high)), strict=True)
    found = []
    whole = 100.0 if scale.unit == "%" else np.inf
    sizes = np.broadcast_to(series.sizes, len(values))
    for place, value, (low, high), size in zip(at, values, ends, sizes, strict=True):
        where = across.names[int(place + 0.5)] if rows else f"{across.title}: {number_text(place)}"
        told, *both = (error_text(each, size, whole=whole) for each in (value, low, high))
        told += f" {scale.unit}"
        if not np.isnan([low, high]).all():
            told += f" ({' to '.join(both)} {scale.unit})"
        found.append("<br>".join(map(plain, filter(None, [series.name, where, told]))))
    return found


def line_trace(name: str, look: Look, x: Any, y: Any, hover: str = "") -> dict[str, Any]:
    """A line; `hover` is a template of what a point tells."""
    code = to_hex(look.color).upper()
    colour = COLOURS.get(code, "--muted" if code == style.GREY else code)
    line: dict[str, Any] = {"color": colour, "width": WIDTH_SCALE * look.width}
    if look.dash:
        line["dash"] = ",".join(f"{max(LEAST_DASH, DASH_SCALE * each):.3g}px" for each in look.dash)
    found = {"type": "scatter", "name": plain(name), "x": x, "y": y, "mode": "lines"}
    found |= {"line": line, "cliponaxis": False}
    return found | (
        {"hovertemplate": f"{hover}<extra></extra>"} if hover else {"hoverinfo": "skip"}
    )


def axis(drawing: Drawing, letter: str) -> dict[str, Any]:
    """An axis of names, of decades, of few round numbers, or of linear numbers."""
    scale: Scale = getattr(drawing, letter)
    if scale.names:
        return names_axis(scale.names, falling=letter == "y")
    letters = LETTERS if letter == "y" else ACROSS
    title: dict[str, Any] = {"title": {"text": on_lines(scale.title, letters)}}
    if texts := value_ticks(scale, ROOM_OF_TICKS):
        title |= {"tickvals": [*scale.ticks], "ticktext": texts}
    low, high = scale.ends or reach_of(drawing, letter)
    found: dict[str, Any]
    if scale.log:
        room = max(LOG_ROOM, (high / low) ** (2 * DODGE)) if letter == "x" else 1.0
        beyond = drawing.beyond(drawing.panels) if scale is drawing.values else (False, False)
        found = decades_axis(low / room, high * room, scale, beyond, TICKS_APART[letter])
    elif not scale.ends and not scale.ticks:
        found = {"rangemode": "tozero"}
    else:
        room = 0.04 * ((high - low) or 1.0)
        found = {"range": [low - room, high + room], "nticks": 6}
    if scale.band:
        middle, end = scale.beyond_end
        if not scale.log:
            ticks = [at for at in MaxNLocator(6).tick_values(low, high) if low <= at <= high]
            found |= {"tickvals": ticks, "ticktext": [f"{at:g}" for at in ticks]}
        found["tickvals"] = [*found["tickvals"], middle]
        found["ticktext"] = [*found["ticktext"], scale.band]
        found["range"][1] = log10(end) if scale.log else end
    return found | title


def reach_of(drawing: Drawing, letter: str) -> tuple[float, float]:
    """Least and greatest number of all series along an axis without fixed ends."""
    parts = [getattr(series, letter) for panel in drawing.panels for series in panel.series]
    known = np.concatenate([np.asarray(part, float) for part in parts if part is not None])
    known = known[np.isfinite(known)]
    return float(known.min()), float(known.max())


def decades_axis(low: float, high: float, *ends: Any) -> dict[str, Any]:
    """A log axis with ticks at powers of ten; between other ends with room, and ticks if short.

    `ends` are a scale and what its `named_ticks` needs. Long numbers make all powers of ten.
    """
    is_short = False
    if any(abs(log10(end) - round(log10(end))) > 1e-9 for end in (low, high)):
        low, high = low / LOG_ROOM, high * LOG_ROOM
        is_short = log10(high / low) <= 2
    first, last = ceil(log10(low) - 1e-9), floor(log10(high) + 1e-9)
    digits: tuple[int, ...] = ((1, 3) if high > 10 * low else (1, 2, 5)) if is_short else (1,)
    powers = range(first - is_short, last + 1, 2 if last - first > 4 else 1)
    ticks = [float(f"{digit}e{power}") for power in powers for digit in digits]
    scale, beyond, apart = ends or (Scale(""), (False, False), 0.0)
    found = scale.named_ticks(ticks, named_powers(min(ticks), max(ticks)), beyond, apart)
    reach = [log10(low), log10(high)]
    return {"type": "log", "range": reach, "tickvals": [*found], "ticktext": [*found.values()]}


def named_powers(low: float, high: float) -> Callable[[float], str]:
    """What names numbers such as 3e-7 within these ends: powers of ten, or decimals if short."""
    return "{:g}".format if (low == 0 or low >= 1e-3) and high < 1e5 else power_text


def power_text(number: float) -> str:
    digit, power = f"{number:.0e}".split("e")
    return f"{digit}·".removeprefix("1·") + f"10<sup>{int(power)}</sup>".replace("-", "−")


def names_axis(names: Sequence[str], falling: bool) -> dict[str, Any]:
    """An axis of names at 0, 1, …, from the top if `falling`."""
    ends = [-0.5, len(names) - 0.5]
    return {
        "tickvals": [*range(len(names))],
        "ticktext": [on_lines(name) for name in names],
        "range": ends[::-1] if falling else ends,
    }


def on_lines(name: str, letters: int = LETTERS) -> str:
    """A name as plotly's HTML, on several short lines."""
    return "<br>".join(plain(line) for line in lines_within(name, letters))


def networks_html(cells: Sequence[Cell]) -> str:
    """The figure of the networks as SVG, in the colours of the style sheet."""
    content = io.BytesIO()
    with rc_context({**style.PRINT_STYLE, "svg.fonttype": "none"}):
        topology_figure(cells).savefig(content, format="svg")
    drawn = re.sub(r"<(metadata|style).*?</\1>", "", content.getvalue().decode(), flags=re.DOTALL)
    drawn = drawn[drawn.index("<svg") :].replace("<svg", '<svg role="img" aria-label="networks"', 1)
    for colour, name in {**COLOURS, "#ffffff": "--paper", "#262626": "--text"}.items():
        drawn = drawn.replace(colour.lower(), f"var({name})")
    return f'<div class="networks">{drawn}</div>'
