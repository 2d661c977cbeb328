"""How lanes spread: tail errors by cell, errors over time, errors by vehicle."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from jaxnet.config.cells import Cell, is_leaderless, judged_metric
from jaxnet.config.keys import Recovery
from jaxnet.statistics.bands import Band, bands_span, variable_over_time
from jaxnet.statistics.curves import GREATEST_SHOWN, LOG_FLOOR, magnitude_words
from jaxnet.statistics.groups import scenes
from jaxnet.statistics.quantities import SPREAD_WORDS
from jaxnet.statistics.recovery import share_definition, threshold
from jaxnet.store import rows
from jaxnet.store.results import Results
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

JUDGED_WORDS = {
    "tail_mean": "mean error over the tail and the vehicles [m]",
    "spread": "spread of honest vehicles over the tail [m]",
}
MOST_TAIL_ROWS = 24  # cells that one figure takes
MOST_DOTS = 1000  # lanes of a cell that it takes: more lie on top of each other
OVER_TIME = {"tracking": r"$\tilde{e}$ [m]", "spread": "spread [m]"}
MOST_MAGNITUDES = 3  # of ā shown in one panel: the least, a middle one and the greatest
ALONE: dict[str, Any] = {"linestyle": "none"}
VEHICLE_MARKS: dict[str, dict[str, Any]] = {
    "median of lanes": ALONE | {"color": style.BLACK, "marker": "o", "markersize": 3},
    "of an attacked vehicle": ALONE | {"color": style.ORANGE, "marker": "s", "markersize": 4},
    "5 to 95 %": {"color": style.SKY, "linewidth": 3},
    "maximum": ALONE | {"color": "0.5", "marker": "_", "markersize": 5},
}
LIMIT: dict[str, Any] = {"color": style.RED, "linestyle": "--", "linewidth": 0.8}


def tails_figure(
    results: Results, cells: Sequence[Cell], width: float = style.FIGURE_WIDTH
) -> Figure:
    """Draw the judged metric of the lanes that ended, a row per cell, as many as the page holds."""
    labels, metric = [cell.labels for cell in cells], judged_metric(cells)
    most = multiples.rows_fitting(labels, width, MOST_TAIL_ROWS)
    shown = {cell.number: place for place, cell in enumerate(cells[:most])}
    drawn, panel = multiples.named_rows(labels[:most], width, JUDGED_WORDS[metric])
    is_cut = False
    for cell, lanes in results.by_cell(metric, where=rows.OK, cells=shown):
        place = shown[cell]
        is_cut |= bool((lanes[metric] < LOG_FLOOR).any())
        values = lanes[metric].to_numpy().clip(LOG_FLOOR, GREATEST_SHOWN)
        dots = thin_by_rank(values)
        jitter = np.random.default_rng(0).uniform(-0.22, 0.22, len(dots))
        panel.plot(dots, place + jitter, ".", color=style.SKY, markersize=3, zorder=1)
        low, median, high = np.quantile(values, [0.05, 0.5, 0.95])
        panel.plot([low, high], [place] * 2, color=style.BLACK, zorder=2)
        panel.plot(median, place, "D", color=style.BLACK, markersize=4, zorder=3)
    multiples.log_axis(panel, "x")
    many = max(results.samples) > MOST_DOTS
    dot = f"{MOST_DOTS:,} dots evenly by rank" if many else "one dot per lane"
    told = [f"{dot}; median and 5 to 95 %", *[SPREAD_WORDS] * (metric == "spread")]
    below = f"values below {LOG_FLOOR:g} m are drawn there"
    multiples.write_note(drawn, "; ".join(told + [below] * is_cut))
    multiples.write_left_out(drawn, (len(shown), len(cells), "cells"), where="lanes/")
    return drawn


def thin_by_rank(values: Float[np.ndarray, " lanes"]) -> Float[np.ndarray, " dots"]:
    """At most MOST_DOTS sorted values, evenly spaced in rank, with minimum and maximum."""
    ranks = np.linspace(0, len(values) - 1, min(len(values), MOST_DOTS)).round().astype(int)
    return np.sort(values)[ranks]


def bands_figure(
    cells: Sequence[Cell], bands: Mapping[int, Band], width: float = style.FIGURE_WIDTH
) -> Figure:
    """Draw errors over time, a panel per group of cells that differ only in ā."""
    there = scenes(cells)
    groups = there[: multiples.panels_fitting([group.labels for group in there], width)]
    labels, words = [group.labels for group in groups], OVER_TIME[variable_over_time(cells)]
    drawn, panels = multiples.panel_grid(labels, "t [s]", words, width)
    looks: dict[str, style.LineStyle] = {}
    for panel, group in zip(panels, groups, strict=True):
        few = np.linspace(0, len(group.cells) - 1, min(MOST_MAGNITUDES, len(group.cells)))
        for place in np.unique(few.round().astype(int)):
            cell = group.cells[place]
            look = style.SERIES_STYLES[len(looks) % len(style.SERIES_STYLES)]
            look = looks.setdefault(magnitude_words(cell), look)
            if cell.number in bands:
                draw_error_band(panel, bands[cell.number], look)
    if bands:
        multiples.log_axis(panels[0], "y", bands_span(bands))
    handles: list[Any] = [Line2D([], [], label=name, **look) for name, look in looks.items()]
    lanes = {band.lanes for band in bands.values()}
    if lanes - {1}:
        handles.append(Patch(facecolor="0.8", label="5 to 95 % of lanes"))
        handles.append(Line2D([], [], color="0.5", linewidth=0.5, label="maximum"))
    if 1 in lanes:
        handles.append(Line2D([], [], linestyle="none", label="without a band: one lane"))
    multiples.write_legend(drawn, handles, 5)
    if is_leaderless(cells):
        multiples.write_note(drawn, SPREAD_WORDS)
    sizes = max(len(group.cells) for group in groups)
    parts = (len(groups), len(there), "groups"), (min(MOST_MAGNITUDES, sizes), sizes, "sizes ā")
    multiples.write_left_out(drawn, *parts, where="errors.zarr")
    return drawn


def draw_error_band(panel: Axes, band: Band, look: style.LineStyle) -> None:
    """Draw one cell's band, from LOG_FLOOR up, the level of rounding; one lane is a line."""
    low, median, high, greatest = (np.maximum(LOG_FLOOR, values) for values in band[1:5])
    if band.lanes > 1:
        panel.fill_between(band.time, low, high, color=look["color"], alpha=0.2, linewidth=0)
        panel.plot(band.time, greatest, color=look["color"], linewidth=0.5)
    panel.plot(band.time, median, **look)


def vehicles_figure(
    found: pd.DataFrame,
    cells: Sequence[Cell],
    recovery: Recovery | None,
    width: float = style.FIGURE_WIDTH,
) -> Figure:
    """Draw the rows of `vehicle_table`: a panel per cell, as many as the page holds.

    Attacked vehicles, where a study lists them, are squares. A line is the threshold of a recovery.
    """
    labels = [cell.labels for cell in cells]
    shown = cells[: multiples.panels_fitting(labels, width)]
    words = "mean error over the tail [m]"
    drawn, panels = multiples.panel_grid(labels[: len(shown)], "vehicle", words, width)
    limits = [threshold(cell, recovery) for cell in shown]
    for panel, cell, limit in zip(panels, shown, limits, strict=True):
        mine: Any = found[found["cell"] == cell.number]
        numbers = mine["vehicle"].to_numpy(dtype=int)
        columns = (mine[name].to_numpy(float) for name in ("low", "median", "q95", "greatest"))
        low, median, high, greatest = (np.maximum(LOG_FLOOR, each) for each in columns)
        lied = np.isin(numbers, cell.scenario.attack.targets())
        panel.vlines(numbers, low, high, **VEHICLE_MARKS["5 to 95 %"])
        panel.plot(numbers, greatest, **VEHICLE_MARKS["maximum"])
        panel.plot(numbers[~lied], median[~lied], **VEHICLE_MARKS["median of lanes"])
        panel.plot(numbers[lied], median[lied], **VEHICLE_MARKS["of an attacked vehicle"])
        panel.xaxis.set_major_locator(MaxNLocator(integer=True))
        if np.isfinite(limit):
            panel.axhline(limit, **LIMIT)
    multiples.log_axis(panels[0], "y")
    handles = [Line2D([], [], label=name, **look) for name, look in VEHICLE_MARKS.items()]
    if recovery is not None and np.isfinite(limits).any():
        handles.append(Line2D([], [], label="threshold of recovery", **LIMIT))
        multiples.write_note(drawn, share_definition(recovery, cells))
    multiples.write_legend(drawn, handles, 5)
    multiples.write_left_out(drawn, (len(shown), len(cells), "cells"), where="vehicles.zarr")
    return drawn
