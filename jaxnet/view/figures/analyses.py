"""Results of a search, and Sobol's indices of a sensitivity analysis."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.explore.courses import Course
from jaxnet.statistics.curves import LOG_FLOOR, MOST_PANELS
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

AXIS_RANGE = 1e3  # of an axis, at most: what is below is next to nothing
SEARCH_MARKS: dict[str, dict[str, Any]] = {
    "random lanes": {"marker": "o", "markersize": 4, "markerfacecolor": "none", "color": style.RED},
    "found": {"marker": "o", "markersize": 4, "color": style.BLUE},
    "late": {"marker": "x", "markersize": 5, "color": style.BLUE},
    "bound": {"marker": "|", "markersize": 8, "color": style.BLACK},
}
QUANTITY_HEIGHT = 0.24  # [in] of a quantity
CELL_TITLE_HEIGHT = 0.35  # [in] of a panel, and its gap
CELLS_PER_ROW = 3  # panels in a row across two columns, beside the quantities' names
HOLLOW = {"markersize": 3.5, "markerfacecolor": "white"}
INDEX_STYLES: dict[str, dict[str, Any]] = {
    "first": {"color": style.BLUE, "fmt": "o", "markersize": 3.5, "label": "first-order: alone"},
    "total": HOLLOW | {"color": style.RED, "fmt": "s", "label": "total: with interactions"},
}
AXIS_MARGIN = 0.08
INDEX_OFFSETS = {"first": -0.16, "total": 0.16}  # of a row's middle


def least_drawn(drawn: Figure, values: np.ndarray) -> float:
    """Least value that is drawn; what is far below the greatest stands there with a note."""
    known = np.nan_to_num(values, nan=0.0, posinf=0.0)
    least = max(LOG_FLOOR, float(known.max(initial=0.0)) / AXIS_RANGE)
    if (values < least).any():
        multiples.write_note(drawn, f"values below {least:.1g} are drawn there")
    return least


def course_figure(found: Sequence[Course], there: int, words: str, width: float) -> Figure:
    """Draw the best value against the number of lanes, a panel per cell."""
    labels = [each.cell.labels for each in found]
    drawn, panels = multiples.panel_grid(labels, "lanes", words, width)
    best = [value for each in found for value in (*each.best, *each.random_best)]
    least = least_drawn(drawn, np.array(best, float))
    for panel, each in zip(panels, found, strict=True):
        lines = (
            (each.lanes, each.best, "search"),
            (each.random_lanes, each.random_best, "random lanes"),
        )
        for look, (lanes, values, name) in zip(style.SERIES_STYLES, lines, strict=False):
            panel.step(lanes, np.maximum(values, least), where="post", label=name, **look)
        if np.isfinite(each.bound):
            panel.axhline(each.bound, label="bound", color=style.BLACK, linestyle=":")
        panel.set(xscale="log", yscale="log")
    top = max(panel.get_ylim()[1] for panel in panels)
    multiples.log_axis(panels[0], "y", (0.7 * least, top))
    known = [panel.get_legend_handles_labels() for panel in panels]
    entries = {
        name: line for lines, names in known for line, name in zip(lines, names, strict=True)
    }
    drawn.legend([*entries.values()], [*entries], loc="outside lower center", ncols=3)
    multiples.write_left_out(drawn, (len(found), there, "cells"), where="search.csv")
    return drawn


def bounds_figure(table: pd.DataFrame, cells: Sequence[Cell], words: str, width: float) -> Figure:
    """Draw a row per cell of the table: random lanes, the choice found, late too, the bound."""
    there, cells = len(cells), [cell for cell in cells if cell.number in set(table["cell"])]
    labels = [cell.labels for cell in cells]
    shown = multiples.rows_fitting(labels, width, MOST_PANELS)
    rows = table.set_index("cell").loc[[cell.number for cell in cells[:shown]]]
    drawn, panel = multiples.named_rows(labels[:shown], width, words)
    marks = {name: look for name, look in SEARCH_MARKS.items() if name in rows}
    least = least_drawn(drawn, rows[[*marks]].to_numpy(dtype=float))
    for name, look in marks.items():
        panel.plot(rows[name].clip(lower=least), range(shown), linestyle="none", label=name, **look)
    panel.set(xscale="log", xlim=(0.7 * least, None))
    multiples.log_ticks(panel.xaxis)
    drawn.legend(loc="outside lower center", ncols=4)
    multiples.write_left_out(drawn, (shown, there, "cells"), where="worst.csv")
    return drawn


def sensitivity_figure(
    table: pd.DataFrame, cells: Sequence[Cell], width: float = style.FIGURE_WIDTH
) -> Figure:
    """Draw a panel per cell and a row per quantity, for as many cells as the page holds."""
    there = [cell for cell in cells if cell.number in set(table["cell"])]
    names, labels = list(dict.fromkeys(table["quantity"])), [cell.labels for cell in there]
    height = QUANTITY_HEIGHT * len(names) + CELL_TITLE_HEIGHT
    most = max(1, round(CELLS_PER_ROW * width / style.FIGURE_WIDTH))
    shown = there[: max(1, multiples.panels_fitting(labels, width, height, most))]
    metric = table["metric"].iloc[0]
    words, few = f"part of the variance of {metric}", labels[: len(shown)]
    drawn, panels = multiples.panel_grid(few, words, "", width, height, most, margin=1.2)
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
    places = np.array([names.index(name) for name in rows["quantity"]])
    for order, look in INDEX_STYLES.items():
        value, low, high = (rows[f"{order}{end}"].to_numpy(float) for end in ("", "_low", "_high"))
        ends, rows_at = np.stack([value - low, high - value]), places + INDEX_OFFSETS[order]
        panel.errorbar(value, rows_at, xerr=ends, elinewidth=0.9, capsize=1.5, **look)
    if rows["first"].isna().to_numpy().all():
        panel.text(0.5, 0.5, "nothing varies", transform=panel.transAxes, ha="center", color="0.4")
