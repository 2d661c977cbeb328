"""Drawings of the page: plotly figures of numbers that others computed.

A colour is a name of the style sheet, such as `--blue`, so that it follows the light. A figure is
about the cells of its panel; a trace whose `meta` has cells, one a point, shows those chosen.
"""

import io
import re
from collections.abc import Mapping, Sequence
from functools import partial
from html import escape
from math import ceil, floor, log10
from textwrap import wrap
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.colors import to_hex

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.naming import key_name, labels_title, quantity, value_alone, value_name
from jaxnet.explore.courses import Course
from jaxnet.model.wording import count, counted
from jaxnet.statistics.axes import Axes, by_hue, geometric, on_a_scale, ordered_values, panels_of
from jaxnet.statistics.bands import Band, bands_span
from jaxnet.statistics.curves import BOUND_NAMES, LOG_FLOOR, Curve, axis_ends, failed_kinds
from jaxnet.statistics.groups import Label
from jaxnet.statistics.quantities import Quantity
from jaxnet.statistics.recovery import confidence_told, share_name
from jaxnet.statistics.tiles import Tiling, blank_reasons, tile_table, tile_text
from jaxnet.store.results import Results
from jaxnet.view.figures import heat, lines, style
from jaxnet.view.figures.topology import topology_figure
from jaxnet.view.page.elements import Panel, error_text, packed, panels_html, plain, views_html

COLOUR_NAMES = ("BLUE", "ORANGE", "GREEN", "RED", "PURPLE", "SKY", "BLACK")
COLOURS = {getattr(style, name): f"--{name.lower()}" for name in COLOUR_NAMES}
LINES: dict[str, dict[str, Any]] = {
    "static": {"color": "--green"},
    "peak_gain": {"color": "--blue", "dash": "8px,3px"},
    "star_norm": {"color": "--purple", "dash": "2px,2px"},
    "lyapunov_best": {"color": "--orange", "dash": "4px,2px"},
    "lyapunov_corrected": {"color": "--red", "dash": "8px,3px,2px,3px"},
    "lyapunov_printed": {"color": "--sky", "dash": "8px,3px,2px,3px,2px,3px"},
    "least squares": {"color": "--muted", "width": 1.0},
    "95 % of lanes": {"color": "--muted", "dash": "1px,3px", "width": 1.5},
}
FIT_QUANTILES = {"least squares": None, "95 % of lanes": 0.95}
CURVE_STATISTICS = ("q05", "median", "q95", "max", "mean", "low", "high")
HUE_SYMBOLS = ("circle", "square", "triangle-up", "diamond", "triangle-down", "cross", "x", "star")
DASHES = ("solid", "6px,2px", "2px,2px", "5px,2px,1px,2px", "9px,3px", "4px,2px,1px,2px,1px,2px")
TIME_AXIS = {"title": {"text": "t [s]"}, "rangemode": "tozero"}
LONE_HEIGHT = 340  # [px] of the only panel
LETTERS = 26  # of a line of a name on an axis
ROOM = 1.25  # at the ends of a log axis
MOST_INTERVALS = 400  # tiles that have room for theirs


def curve(
    name: str,
    x: Any,
    y: Any,
    color: str,
    *,
    hover: str = "",
    symbol: str | list[str] = "",
    ends: tuple[np.ndarray, np.ndarray] | None = None,
    across: bool = False,
    **look: Any,
) -> dict[str, Any]:
    """A trace: a line, or markers where there is a symbol, with error bars from `ends`.

    `hover` is a template of what a point tells. Error bars are along x if `across`.
    """
    trace = {"type": "scatter", "name": name, "x": x, "y": y, "mode": "lines"}
    trace |= {"line": {"color": color, **look}, "cliponaxis": False}
    trace |= {"hovertemplate": f"{hover}<extra></extra>"} if hover else {"hoverinfo": "skip"}
    if symbol:
        trace |= {"mode": "markers", "marker": {"color": color, "symbol": symbol, "size": 6}}
    if ends:
        middle = x if across else y
        above, below = (np.nan_to_num(each) for each in (ends[1] - middle, middle - ends[0]))
        bars = {"symmetric": False, "array": above, "arrayminus": below, "color": color}
        trace["error_x" if across else "error_y"] = bars | {"thickness": 1.3, "width": 2}
    return trace


def decades_axis(low: float, high: float, title: str) -> dict[str, object]:
    """A log axis with ticks at powers of ten, all or every other one."""
    first, last = ceil(log10(low) - 1e-9), floor(log10(high) + 1e-9)
    powers = range(first, last + 1, 2 if last - first > 4 else 1)
    return {
        "type": "log",
        "range": [log10(low), log10(high)],
        "tickvals": [10.0**power for power in powers],
        "ticktext": [power_text(power) for power in powers],
        "title": {"text": title},
    }


def power_text(power: int) -> str:
    """A power of ten, in decimals where it is short."""
    return f"{10.0**power:g}" if -4 < power < 5 else f"10<sup>{power}</sup>".replace("-", "−")


def roomy_axis(low: float, high: float, title: str) -> dict[str, object]:
    """A log axis with room at its ends; of few decades, with ticks at round numbers."""
    low, high = low / ROOM, high * ROOM
    span, powers = log10(high / low), range(floor(log10(low)), floor(log10(high)) + 1)
    digits = (1, 3) if span > 1 else (1, 2, 5)
    ticks = [float(f"{digit}e{power}") for power in powers for digit in digits]
    given = {"tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks]}
    return decades_axis(low, high, title) | (given if span <= 2 else {})


def linear_axis(low: float, high: float, title: str) -> dict[str, object]:
    room = 0.04 * ((high - low) or 1.0)
    return {"range": [low - room, high + room], "nticks": 6, "title": {"text": title}}


def names_axis(key: str | None, values: Sequence[Label], falling: bool) -> dict[str, object]:
    """An axis of names at 0, 1, …, from the top if `falling`."""
    names = [on_lines(value_alone(key, value)) for value in values] if key else [""]
    ends = [-0.5, len(names) - 0.5]
    reach = ends[::-1] if falling else ends
    return {"tickvals": [*range(len(names))], "ticktext": names, "range": reach}


def on_lines(name: str) -> str:
    """A name as plotly's HTML, on several short lines."""
    return "<br>".join(plain(line) for line in wrap(name, LETTERS, break_on_hyphens=False))


def three_digits(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.3g}"


def in_a_row(panels: Sequence[Panel], cells: Sequence[Cell]) -> int:
    """Number of panels in a row: those that share the first swept value, if they are few."""
    first = [
        next(iter(cells[panel.cells[0]].labels.values()), None) for panel in panels if panel.cells
    ]
    same = first.count(first[0])
    return same if 2 <= same <= 4 and len(first) % same == 0 else min(len(first), 4)


def answer_html(found: Quantity, axes: Axes, cells: Sequence[Cell]) -> str:
    """Draw a quantity against the key on x: a series a hue, a panel each choice of the other keys.

    Numbers are on a scale across. Other values have rows of their own.
    """
    values, hues = ordered_values(cells, axes.x), ordered_values(cells, axes.hue)
    numbers = axes.x is not None and on_a_scale(values)
    title = on_lines(found.axis)
    layout = {"yaxis": (decades_axis if found.log else linear_axis)(*found.ends, title)}
    height = LONE_HEIGHT
    if numbers:
        scale, known = roomy_axis if geometric(values) else linear_axis, np.array(values, float)
        layout["xaxis"] = scale(known.min(), known.max(), plain(quantity(axes.x or "")))
    else:
        layout = {"xaxis": layout["yaxis"], "yaxis": names_axis(axes.x, values, True)}
        rows = max(26, 13 * max(1, len(hues))) * max(1, len(values))
        height = 34 + 36 * len(title.split("<br>")) + rows
    looks, hue = lines.hue_looks(axes.hue, hues), key_name(axes.hue) if axes.hue else ""
    panels = []
    for labels, mine in panels_of(cells, axes):
        traces, rows = [], []
        for place, (look, some) in enumerate(zip(looks, by_hue(mine, axes, hues), strict=True)):
            shift = 0.0 if numbers else 0.7 * ((place + 0.5) / len(looks) - 0.5)
            points = sorted((x_place(cell, axes.x, values, numbers), cell.number) for cell in some)
            at, about = np.array([x for x, _ in points], float), [cell for _, cell in points]
            names = [x_name(x, axes.x, values, numbers) for x in at]
            table = found.values.reindex(about).to_numpy(dtype=float)
            series = answer_series(found, look, place, at + shift, table, numbers)
            words = map(partial(answer_text, found, axes, look.label), names, table)
            traces.append(series | {"text": [*words], "meta": {"cells": about}})
            rows.append(pd.DataFrame(table, columns=[found.name, "low", "high"]))
            rows[-1][[axes.x or "all", hue or "series", "cell"]] = [
                *zip(names, [look.label] * len(at), about, strict=True)
            ]
        columns = dict(pd.concat(rows))
        about = [cell.number for cell in mine]
        panels.append(Panel(labels_title(labels), about, traces, layout, columns))
    title = f'<p class="key-title">{escape(hue)}</p>' if hue else ""
    tall = height if not numbers or len(panels) == 1 else 0
    return panels_html(panels, in_a_row(panels, cells), tall, title)


def x_place(cell: Cell, x: str | None, values: Sequence[Label], numbers: bool) -> Label:
    if x is None:
        return 0
    return cell.labels[x] if numbers else values.index(cell.labels[x])


def x_name(place: float, x: str | None, values: Sequence[Label], numbers: bool) -> Label:
    """A number on a scale, or the name of a row."""
    if numbers or x is None:
        return place if numbers else ""
    return value_alone(x, values[int(place)])


def answer_series(
    found: Quantity, look: lines.Look, place: int, at: np.ndarray, table: np.ndarray, numbers: bool
) -> dict[str, object]:
    """Values with intervals; on a log axis what lies below stands on it."""
    given: Any = look.look["color"]
    colour = COLOURS.get(given, given) if isinstance(given, str) else to_hex(given)
    middle, low, high = np.maximum(table, found.ends[0] if found.log else -np.inf).T
    drawn = {
        "hover": "%{text}",
        "symbol": HUE_SYMBOLS[place % len(HUE_SYMBOLS)],
        "ends": (low, high),
    }
    name, dash = plain(look.label), DASHES[place % len(DASHES)]
    if not numbers:
        return curve(name, middle, at, colour, across=True, **drawn)
    line = curve(name, at, middle, colour, dash=dash, width=1.6, **drawn)
    return line | {"mode": "lines+markers", "connectgaps": True}


def answer_text(found: Quantity, axes: Axes, hue: str, name: Label, row: np.ndarray) -> str:
    value, low, high = row
    unit = " %" if found.share else ""
    ends = (
        "" if np.isnan(row[1:]).all() else f" ({three_digits(low)} to {three_digits(high)}{unit})"
    )
    where = name if isinstance(name, str) else f"{quantity(axes.x or '')}: {three_digits(name)}"
    return "<br>".join(
        [*map(plain, filter(None, [hue, where])), f"{three_digits(value)}{unit}{ends}"]
    )


def ultimate_html(found: Sequence[Curve], metric: str, words: str, cells: Sequence[Cell]) -> str:
    """Draw δ̂(ā): a panel a curve, with bounds and fits as lines s·ā."""
    least, most = axis_ends(found, metric)
    every = np.concatenate([each.sizes for each in found])
    across = roomy_axis(every.min(), every.max(), "attack magnitude ā [m]")
    layout = {"xaxis": across, "yaxis": decades_axis(least, most, words)}
    panels = []
    for each in found:
        sizes, statistics = each.sizes, each.spread(metric, *CURVE_STATISTICS)
        fits = {name: each.fit(metric, quantile) for name, quantile in FIT_QUANTILES.items()}
        slopes = each.limits(metric) | {name: fit[0] for name, fit in fits.items() if fit}
        drawn = {BOUND_NAMES.get(name, name): (name, slope) for name, slope in slopes.items()}
        q05, median, q95, most, mean, low, high = np.maximum(statistics, least)
        symbols = np.where(median <= least, "triangle-down", "circle")
        text = [ultimate_text(*row) for row in zip(sizes, *statistics, strict=True)]
        traces = [
            curve(name, sizes, slope * sizes, hover=f"{name}: {slope:.3g} ā", **LINES[look])
            for name, (look, slope) in drawn.items()
        ] + [
            curve("mean, 95 % interval", 1.1 * sizes, mean, "--muted", symbol="diamond-open",
                  ends=(low, high), hover="%{text}") | {"text": text},
            curve("median, 5 to 95 %", sizes, median, "--black", symbol=symbols.tolist(),
                  ends=(q05, q95), hover="%{text}") | {"text": text},
            curve("maximum", sizes, most, "--black", symbol="line-ew-open", hover="%{text}")
            | {"text": text},
        ]  # fmt: skip
        names = [f"{metric}_{name}" for name in CURVE_STATISTICS]
        columns = {"attack.magnitude": sizes} | dict(zip(names, statistics, strict=True))
        columns |= {name: slope * sizes for name, (_, slope) in drawn.items()}
        title = labels_title(each.group.labels)
        panels.append(Panel(title, [*each.group.attacked], traces, layout, columns))
    return panels_html(panels, in_a_row(panels, cells))


def ultimate_text(size: float, *statistics: float) -> str:
    q05, median, q95, most, mean, low, high = (error_text(value, size) for value in statistics)
    known = [end.replace("nan", "?") for end in (low, high)]
    interval = "" if np.isnan(statistics[-2]) else f" ({known[0]} to {known[1]})"
    return (
        f"ā = {three_digits(size)} m<br>median {median} m<br>5 to 95 %: {q05} to {q95} m<br>"
        f"maximum {most} m<br>mean {mean} m{interval}"
    )


def bands_html(found: Mapping[int, Band], label: str, cells: Sequence[Cell]) -> str:
    """Draw errors or spreads over time, a panel a cell."""
    layout = {"xaxis": TIME_AXIS, "yaxis": decades_axis(*bands_span(found), label)}
    panels = []
    for number, band in found.items():
        q05, median, q95, most = map(packed, (band.low, band.median, band.high, band.greatest))
        extra = {"x": packed(band.time), "floor": LOG_FLOOR}
        middle = over_time("median of lanes", median, color="--blue", width=2)
        columns = {"time": "x", "q05": 0, "q95": 1, "max": 2, "median": 3}
        edges = [curve("5 to 95 %", [], each, "--blue", width=0) for each in (q05, q95)]
        filled = {"fill": "tonexty", "fillcolor": "--band"}
        traces = [
            edges[0] | {"showlegend": False},
            edges[1] | filled,
            over_time("maximum", most, color="--red", width=1.4, dash="5px,3px"),
            middle,
        ]
        if band.lanes == 1:
            traces = [middle | {"name": "one lane"}]
            columns = {"time": "x"} | dict.fromkeys(("q05", "q95", "max", "median"), 0)
        title = labels_title(cells[number].labels)
        panels.append(Panel(title, [number], traces, layout, columns, extra))
    return panels_html(panels, in_a_row(panels, cells))


def over_time(name: str, y: Any, **look: Any) -> dict[str, object]:
    return curve(name, [], y, hover=f"{name} %{{y:.3~g}} m at %{{x:.3~g}} s", **look)


def searches_html(found: Sequence[Course], words: str, cells: Sequence[Cell]) -> str:
    """Draw the best value until then by the number of lanes: of each search and of random lanes."""
    lanes = np.concatenate([[*each.lanes, *each.random_lanes] for each in found])
    best = np.concatenate([[*each.best, *each.random_best, each.bound] for each in found])
    best, ends = best[best > 0], (lanes.min(), lanes.max())
    layout = {
        "xaxis": roomy_axis(*ends, "lanes"),
        "yaxis": roomy_axis(best.min(), best.max(), words),
    }
    panels = []
    for each in found:
        drawn = {
            "bound": (
                np.array(ends),
                np.full(2, each.bound),
                "--black",
                {"width": 1.4, "dash": "2px,2px"},
            ),
            "random lanes": (each.random_lanes, each.random_best, "--red", {"dash": "5px,3px"}),
            "search": (each.lanes, each.best, "--blue", {"width": 2}),
        }
        traces = [
            curve(
                name,
                x,
                y,
                colour,
                hover=f"{name} %{{y:.3~g}} after %{{x}} lanes",
                shape="hv",
                **look,
            )
            for name, (x, y, colour, look) in drawn.items()
            if np.isfinite(y).all()
        ]
        what = ["search"] * len(each.lanes) + ["random lanes"] * len(each.random_lanes)
        columns = {
            "what": what,
            "lanes": [*each.lanes, *each.random_lanes],
            "best": [*each.best, *each.random_best],
        }
        title, number = labels_title(each.cell.labels), each.cell.number
        panels.append(Panel(title, [number], traces, layout, columns))
    return panels_html(panels, in_a_row(panels, cells))


def heat_html(results: Results, tiling: Tiling) -> str:
    """Draw tiles over two swept keys, a view a metric; "" if no cell has a number."""
    found: Any = tile_table(results)
    known = [metric for metric in heat.METRICS if found[metric].notna().any()]
    cells = results.study.cells
    views = {heat.metric_label(each, cells): heat_view(results, tiling, each) for each in known}
    return views_html(views) if views else ""


def heat_view(results: Results, tiling: Tiling, metric: str) -> str:
    found: Any = tile_table(results)
    cells = results.study.cells
    norm, palette = heat.colour_scale(metric, found[metric]), [c for c, _ in heat.palette()]
    failed = {cell: counted(kinds) for cell, kinds in failed_kinds(results).items()}
    places = np.append(np.ma.filled(norm(found[metric].to_numpy(dtype=float)), np.nan), np.nan)
    few = tiling.cells.size <= MOST_INTERVALS
    beside = "<br>" + found["interval"] if metric == "unrecovered" and few else [""] * len(found)
    text = [
        (f"{tile_text(metric, value)}{interval}" if np.isfinite(value) else "–")
        + "*" * (cell in failed)
        for (cell, value), interval in zip(found[metric].items(), beside, strict=True)
    ]
    words = [tile_words(results, metric, row, failed) for _, row in found.iterrows()]
    scale = [[n / (len(palette) - 1), colour] for n, colour in enumerate(palette)]
    layout = {
        "xaxis": names_axis(tiling.column, tiling.columns, False)
        | {"title": {"text": plain(quantity(tiling.column))}, "showgrid": False},
        "yaxis": names_axis(tiling.row, tiling.rows, True)
        | {"title": {"text": plain(quantity(tiling.row))}, "showgrid": False},
    }
    panels = []
    for labels, numbers in zip(tiling.panels, tiling.cells, strict=True):
        tiles = {
            "type": "heatmap",
            "z": places[numbers],
            "zmin": 0,
            "zmax": 1,
            "xgap": 1,
            "ygap": 1,
        }
        tiles |= {"colorscale": scale, "showscale": False, "meta": {"cells": numbers}}
        tiles |= {"text": np.array([*text, ""])[numbers].tolist()}
        tiles |= {"texttemplate": "%{text}"}
        tiles |= {
            "hovertext": np.array([*words, "Not run."])[numbers].tolist(),
            "hoverinfo": "text",
        }
        given = numbers[numbers >= 0]
        columns = {"cell": given, metric: found[metric].to_numpy(dtype=float)[given]}
        panels.append(Panel(labels_title(labels), given.tolist(), [tiles], layout, columns))
    reasons = blank_reasons(found, tiling.cells, metric)
    ends = [f"{end:.3g}" for end in np.asarray(norm.inverse([0.0, 1.0]))]
    bar = f"<i style='background: linear-gradient(to right, {', '.join(palette)})'></i>"
    blank = f"<span>no number: {', '.join(reasons)}</span>" if reasons else ""
    title = escape(heat.metric_label(metric, cells))
    key = f'<div class="scale"><span>{title}</span>{ends[0]} {bar} {ends[1]} {blank}</div>'
    row = max(1, min(len(panels), 24 // len(tiling.columns)))
    drawn = panels_html(panels, row, 100 + 34 * len(tiling.rows), key, "tiles")
    return drawn.replace('role="img"', 'role="group" tabindex="0"')  # arrow keys walk over it


def tile_words(results: Results, metric: str, row: Any, failed: Mapping[int, str]) -> str:
    """What a tile tells when it is reached: where, its number, its lanes, and those that failed."""
    cell, cells = int(row.name), results.study.cells
    what = row["blank"]
    if np.isfinite(row[metric]) and metric == "unrecovered":
        ends = (
            f"{three_digits(row['unrecovered_low'])} to {three_digits(row['unrecovered_high'])} %"
        )
        sure = f"{100 * confidence_told(results.study.config.samples):g} % interval {ends}"
        what = f"{three_digits(row[metric])} % {share_name(cells)}, {sure}"
    elif np.isfinite(row[metric]):
        size = error_text(row[metric])
        alone = is_leaderless(cells)
        what = f"greatest spread {size} m" if alone else f"greatest tail error {size} ā"
    lanes = f", of {count(int(row['ok']), 'lane')}" if np.isfinite(row[metric]) else ""
    lost = f"failed: {failed[cell]}" if cell in failed else "none failed"
    where = ", ".join(value_name(key, value) for key, value in cells[cell].labels.items())
    return f"{plain(where)} (cell {cell}): {what}{lanes}; {lost}."


def networks_html(cells: Sequence[Cell]) -> str:
    """The figure of the networks as SVG, in the colours of the style sheet."""
    look: style.Style = {**style.PRINT_STYLE, "svg.fonttype": "none"}
    content = io.BytesIO()
    with rc_context(look):
        topology_figure(cells).savefig(content, format="svg")
    drawn = re.sub(r"<(metadata|style).*?</\1>", "", content.getvalue().decode(), flags=re.DOTALL)
    drawn = drawn[drawn.index("<svg") :].replace("<svg", '<svg role="img" aria-label="networks"', 1)
    for colour, name in {**COLOURS, "#ffffff": "--paper", "#262626": "--text"}.items():
        drawn = drawn.replace(colour.lower(), f"var({name})")
    return f'<div class="networks">{drawn}</div>'
