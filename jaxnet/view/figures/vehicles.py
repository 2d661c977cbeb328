"""Who tracks: the mean error of each vehicle over the tail, by its number."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Recovery
from jaxnet.statistics.curves import LOG_FLOOR
from jaxnet.statistics.recovery import share_definition, threshold
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

MEDIAN: dict[str, Any] = {"color": style.BLACK, "marker": "o", "markersize": 3, "linestyle": "none"}
ATTACKED: dict[str, Any] = {
    "color": style.ORANGE,
    "marker": "s",
    "markersize": 4,
    "linestyle": "none",
}
GREATEST: dict[str, Any] = {"color": "0.5", "marker": "_", "markersize": 5, "linestyle": "none"}
LIMIT: dict[str, Any] = {"color": style.RED, "linestyle": "--", "linewidth": 0.8}


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
    axis = "mean error over the tail [m]"
    drawn, panels = multiples.panel_grid(labels[: len(shown)], "vehicle", axis, width)
    limits = [threshold(cell, recovery) for cell in shown]
    for panel, cell, limit in zip(panels, shown, limits, strict=True):
        draw_vehicles(
            panel, found[found["cell"].to_numpy() == cell.number], cell.scenario.attack.targets()
        )
        if np.isfinite(limit):
            panel.axhline(limit, **LIMIT)
    panels[0].set_yscale("log")
    multiples.log_ticks(panels[0].yaxis)
    handles = [
        Line2D([], [], label="median of lanes", **MEDIAN),
        Line2D([], [], label="of an attacked vehicle", **ATTACKED),
        Line2D([], [], color=style.SKY, linewidth=3, label="5 to 95 %"),
        Line2D([], [], label="maximum", **GREATEST),
    ]
    if recovery is not None and np.isfinite(limits).any():
        handles.append(Line2D([], [], label="threshold of recovery", **LIMIT))
        multiples.write_note(drawn, share_definition(recovery, cells))
    drawn.legend(
        handles=handles, loc="outside lower center", ncols=multiples.legend_columns(width, 5)
    )
    multiples.write_left_out(drawn, (len(shown), len(cells), "cells"), where="vehicles.zarr")
    return drawn


def draw_vehicles(panel: Axes, found: Any, attacked: Sequence[int]) -> None:
    """Draw the vehicles of one cell, clipped from below at LOG_FLOOR, the level of rounding."""
    numbers = found["vehicle"].to_numpy(dtype=int)
    names = ("low", "median", "q95", "greatest")
    low, median, high, greatest = (
        np.maximum(LOG_FLOOR, found[name].to_numpy(dtype=float)) for name in names
    )
    panel.vlines(numbers, low, high, color=style.SKY, linewidth=3)
    panel.plot(numbers, greatest, **GREATEST)
    lied = np.isin(numbers, attacked)
    panel.plot(numbers[~lied], median[~lied], **MEDIAN)
    panel.plot(numbers[lied], median[lied], **ATTACKED)
    panel.xaxis.set_major_locator(MaxNLocator(integer=True))
