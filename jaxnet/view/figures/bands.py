"""The mean tracking error ẽ(t), or the spread without a navigator: median, 5 to 95 % and maximum of lanes."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.statistics.bands import Band, bands_span, scenes, variable_over_time
from jaxnet.statistics.curves import LOG_FLOOR, magnitude_words
from jaxnet.statistics.quantities import SPREAD_WORDS
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

OVER_TIME = {"tracking": r"$\tilde{e}$ [m]", "spread": "spread [m]"}
MOST_MAGNITUDES = 3  # of ā shown in one panel: the least, a middle one and the greatest


def bands_figure(
    cells: Sequence[Cell], bands: Mapping[int, Band], width: float = style.FIGURE_WIDTH
) -> Figure:
    """Draw a panel per group of cells that differ only in ā, as many as the page holds."""
    there = scenes(cells)
    groups = there[: multiples.panels_fitting([group.labels for group in there], width)]
    labels = [group.labels for group in groups]
    words = OVER_TIME[variable_over_time(cells)]
    drawn, panels = multiples.panel_grid(labels, "t [s]", words, width)
    looks: dict[str, style.LineStyle] = {}
    for panel, group in zip(panels, groups, strict=True):
        for cell in spread_cells(group.cells):
            look = looks.setdefault(
                magnitude_words(cell), style.SERIES_STYLES[len(looks) % len(style.SERIES_STYLES)]
            )
            if cell.number in bands:
                draw_error_band(panel, bands[cell.number], look)
    if bands:
        panels[0].set(yscale="log", ylim=bands_span(bands))
        multiples.log_ticks(panels[0].yaxis)
    handles: list[Line2D | Patch] = [
        Line2D([], [], label=name, **look) for name, look in looks.items()
    ]
    lanes = {band.lanes for band in bands.values()}
    if lanes - {1}:
        handles.append(Patch(facecolor="0.8", label="5 to 95 % of lanes"))
        handles.append(Line2D([], [], color="0.5", linewidth=0.5, label="maximum"))
    if 1 in lanes:
        handles.append(Line2D([], [], linestyle="none", label="without a band: one lane"))
    drawn.legend(
        handles=handles,
        loc="outside lower center",
        ncols=multiples.legend_columns(width, 5),
        handlelength=2.6,
    )
    if is_leaderless(cells):
        multiples.write_note(drawn, SPREAD_WORDS)
    sizes = max(len(group.cells) for group in groups)
    multiples.write_left_out(
        drawn,
        (len(groups), len(there), "groups"),
        (min(MOST_MAGNITUDES, sizes), sizes, "sizes ā"),
        where="errors.zarr",
    )
    return drawn


def spread_cells(cells: Sequence[Cell]) -> list[Cell]:
    """Return at most MOST_MAGNITUDES cells, spread evenly."""
    chosen = np.unique(
        np.linspace(0, len(cells) - 1, min(MOST_MAGNITUDES, len(cells))).round().astype(int)
    )
    return [cells[number] for number in chosen]


def draw_error_band(panel: Axes, band: Band, look: style.LineStyle) -> None:
    """Draw one cell's band, clipped from below at LOG_FLOOR, the level of rounding; one lane is a line."""
    low, median, high, greatest = (np.maximum(LOG_FLOOR, values) for values in band[1:5])
    if band.lanes > 1:
        panel.fill_between(band.time, low, high, color=look["color"], alpha=0.2, linewidth=0)
        panel.plot(band.time, greatest, color=look["color"], linewidth=0.5)
    panel.plot(band.time, median, **look)
