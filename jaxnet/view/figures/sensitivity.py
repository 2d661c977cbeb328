"""First-order and total Sobol indices of each drawn quantity, with intervals."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

QUANTITY_HEIGHT = 0.24  # [in] of a quantity
CELL_TITLE_HEIGHT = 0.35  # [in] of a panel, and its gap
CELLS_PER_ROW = 3  # panels in a row across two columns, beside the quantities' names
INDEX_STYLES: dict[str, dict[str, Any]] = {
    "first": {"color": style.BLUE, "fmt": "o", "markersize": 3.5, "label": "first-order: alone"},
    "total": {
        "color": style.RED,
        "fmt": "s",
        "markersize": 3.5,
        "markerfacecolor": "white",
        "label": "total: with interactions",
    },
}
AXIS_MARGIN = 0.08
INDEX_OFFSETS = {"first": -0.16, "total": 0.16}  # of a row's middle


def sensitivity_figure(
    table: pd.DataFrame, cells: Sequence[Cell], width: float = style.FIGURE_WIDTH
) -> Figure:
    """Draw a panel per cell and a row per quantity, for as many cells as the page holds."""
    there = [cell for cell in cells if cell.number in set(table["cell"])]
    names = list(dict.fromkeys(table["quantity"]))
    labels, height = (
        [cell.labels for cell in there],
        QUANTITY_HEIGHT * len(names) + CELL_TITLE_HEIGHT,
    )
    most = max(1, round(CELLS_PER_ROW * width / style.FIGURE_WIDTH))
    shown = there[: max(1, multiples.panels_fitting(labels, width, height, most))]
    metric = table["metric"].iloc[0]
    words = f"part of the variance of {metric}"
    drawn, panels = multiples.panel_grid(
        labels[: len(shown)], words, "", width, height, most, margin=1.2
    )
    for panel, cell in zip(panels, shown, strict=True):
        draw_indices(panel, table.loc[table["cell"] == cell.number], names)
    if metric == "unrecovered":
        over = table["threshold"]
        ends = " to ".join(dict.fromkeys(f"{end:.4g}" for end in (over.min(), over.max())))
        judged = "spread" if is_leaderless(cells) else "mean error"
        multiples.write_note(drawn, f"unrecovered: {judged} over the tail > {ends} m")
    panels[0].set_yticks(range(len(names)), names)
    panels[0].set_ylim(len(names) - 0.5, -0.5)
    estimates = table[[*INDEX_STYLES]].to_numpy(float)
    ends = np.nanmin(estimates, initial=0.0), np.nanmax(estimates, initial=1.0)
    panels[0].set_xlim(ends[0] - AXIS_MARGIN, ends[1] + AXIS_MARGIN)  # an interval may end beyond
    drawn.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    multiples.write_left_out(drawn, (len(shown), len(there), "cells"), where="sensitivity.csv")
    return drawn


def draw_indices(panel: Axes, rows: pd.DataFrame, names: Sequence[str]) -> None:
    """Draw the indices of one cell with their intervals."""
    places = np.array([names.index(name) for name in rows["quantity"]])
    for order, look in INDEX_STYLES.items():
        value, low, high = (rows[f"{order}{end}"].to_numpy(float) for end in ("", "_low", "_high"))
        ends = np.stack([value - low, high - value])
        panel.errorbar(
            value, places + INDEX_OFFSETS[order], xerr=ends, elinewidth=0.9, capsize=1.5, **look
        )
    if rows["first"].isna().to_numpy().all():
        panel.text(0.5, 0.5, "nothing varies", transform=panel.transAxes, ha="center", color="0.4")
