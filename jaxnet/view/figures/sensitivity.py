"""What matters: first-order and total Sobol indices of each quantity drawn, with their intervals."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from jaxnet.config.cells import Cell
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

ROW = 0.24  # [in] of a quantity
TITLE = 0.35  # [in] of a panel, and its gap
ACROSS = 3  # panels in a row across two columns, beside the quantities' names
LOOKS: dict[str, dict[str, Any]] = {
    "first": {"color": style.BLUE, "fmt": "o", "markersize": 3.5, "label": "first-order: alone"},
    "total": {
        "color": style.RED,
        "fmt": "s",
        "markersize": 3.5,
        "markerfacecolor": "white",
        "label": "total: with interactions",
    },
}
MARGIN = 0.08
BESIDE = {"first": -0.16, "total": 0.16}  # of a row's middle


def figure(table: Any, cells: Sequence[Cell], width: float = style.WIDTH) -> Figure:
    """A panel per cell and a row per quantity, of the first cells that there is room for."""
    there = [cell for cell in cells if cell.number in set(table["cell"])]
    names = list(dict.fromkeys(table["quantity"]))
    labels, height = [cell.labels for cell in there], ROW * len(names) + TITLE
    most = max(1, round(ACROSS * width / style.WIDTH))
    shown = there[: max(1, multiples.room(labels, width, height, most))]
    words = f"part of the variance of {table['metric'].iloc[0]}"
    drawn, panels = multiples.panels(labels[: len(shown)], words, "", width, height, most, margin=1.2)
    for panel, cell in zip(panels, shown, strict=True):
        draw_cell(panel, table[table["cell"] == cell.number], names)
    panels[0].set_yticks(range(len(names)), names)
    panels[0].set_ylim(len(names) - 0.5, -0.5)
    estimates = table[[*LOOKS]].to_numpy(float)
    ends = np.nanmin(estimates, initial=0.0), np.nanmax(estimates, initial=1.0)
    panels[0].set_xlim(ends[0] - MARGIN, ends[1] + MARGIN)  # an interval may end beyond
    drawn.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    multiples.note_left_out(drawn, (len(shown), len(there), "cells"), where="sensitivity.csv")
    return drawn


def draw_cell(panel: Axes, rows: Any, names: Sequence[str]) -> None:
    """One cell's indices."""
    places = np.array([names.index(name) for name in rows["quantity"]])
    for order, look in LOOKS.items():
        value, low, high = (rows[f"{order}{end}"].to_numpy(float) for end in ("", "_low", "_high"))
        ends = np.stack([value - low, high - value])
        panel.errorbar(value, places + BESIDE[order], xerr=ends, elinewidth=0.9, capsize=1.5, **look)
    if rows["first"].isna().all():
        panel.text(0.5, 0.5, "nothing varies", transform=panel.transAxes, ha="center", color="0.4")
