"""The share of lanes that do not recover, with its interval."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from jaxnet.config.cells import Cell
from jaxnet.statistics.curves import MOST_PANELS, Curve, no_magnitudes, unrecovered_shares
from jaxnet.store.results import Results
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

SHARE_PANEL_HEIGHT = 1.15  # [in] of a panel
INTERVAL_STYLE: dict[str, Any] = {
    "color": style.BLUE,
    "ecolor": style.BLUE,
    "markersize": 3,
    "fmt": "o",
    "elinewidth": 0.9,
    "capsize": 1.5,
}


def unrecovered_figure(
    results: Results, cells: Sequence[Cell], found: Sequence[Curve], width: float = style.FIGURE_WIDTH
) -> Figure:
    """Draw a panel per group against ā, or a row per cell where ā is not swept."""
    if no_magnitudes(found):
        return rows_figure(results, cells, width)
    shown = found[
        : multiples.panels_fitting([curve.group.labels for curve in found], width, SHARE_PANEL_HEIGHT)
    ]
    labels = [curve.group.labels for curve in shown]
    drawn, panels = multiples.panel_grid(
        labels, "attack magnitude ā [m]", "unrecovered [%]", width, SHARE_PANEL_HEIGHT
    )
    for panel, curve in zip(panels, shown, strict=True):
        draw_share(panel, curve)
    panels[0].set_xscale("log")
    panels[0].autoscale_view()
    multiples.log_ticks(panels[0].xaxis)
    panels[0].set_ylim(-5, 108)
    multiples.write_left_out(drawn, (len(shown), len(found), "groups"), where="cells.csv")
    return drawn


def draw_share(panel: Axes, curve: Curve) -> None:
    """Draw one group's share against ā."""
    share, low, high = curve.shares()
    sizes = curve.sizes
    panel.errorbar(sizes, share, np.stack([share - low, high - share]), **INTERVAL_STYLE)


def rows_figure(results: Results, cells: Sequence[Cell], width: float = style.FIGURE_WIDTH) -> Figure:
    """Draw the share of each cell in a named row."""
    asked = {cell.number: cell for cell in cells}
    there = unrecovered_shares(results, cells)
    labels = [asked[int(number)].labels for number in there.index]
    found = there.head(multiples.rows_fitting(labels, width, MOST_PANELS))
    share, low, high = (100 * found[name].to_numpy() for name in found)
    places = np.arange(len(found))
    drawn, panel = multiples.named_rows(labels[: len(found)], width)
    panel.errorbar(share, places, xerr=np.stack([share - low, high - share]), **INTERVAL_STYLE)
    panel.set_xlim(-2, 102)
    panel.set_xlabel("lanes unrecovered, with interval [%]")
    multiples.write_left_out(drawn, (len(found), len(there), "cells"), where="cells.csv")
    return drawn
