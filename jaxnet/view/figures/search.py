"""Results of a search: its progress, and the worst found beside random lanes and bounds."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from jaxnet.config.cells import Cell
from jaxnet.explore.courses import Course
from jaxnet.statistics.curves import LOG_FLOOR, MOST_PANELS
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

AXIS_RANGE = 1e3  # of an axis, at most: what is below is next to nothing
SEARCH_LINES = {"search": style.SERIES_STYLES[0], "random lanes": style.SERIES_STYLES[1]}
SEARCH_MARKS = {
    "random lanes": {"marker": "o", "markersize": 4, "markerfacecolor": "none", "color": style.RED},
    "found": {"marker": "o", "markersize": 4, "color": style.BLUE},
    "late": {"marker": "x", "markersize": 5, "color": style.BLUE},
    "bound": {"marker": "|", "markersize": 8, "color": style.BLACK},
}


def course_figure(found: Sequence[Course], there: int, words: str, width: float) -> Figure:
    """Draw the best value against the number of lanes, a panel per cell.

    Values far below the greatest are drawn at the lower end, so that no panel is empty.
    """
    drawn_values = (value for each in found for value in (*each.best, *each.random_best))
    greatest = np.nanmax([LOG_FLOOR, *drawn_values])
    least = max(greatest / AXIS_RANGE, LOG_FLOOR)
    labels = [each.cell.labels for each in found]
    drawn, panels = multiples.panel_grid(labels, "lanes", words, width)
    for panel, each in zip(panels, found, strict=True):
        best, random_best = (np.maximum(values, least) for values in (each.best, each.random_best))
        panel.step(each.lanes, best, where="post", label="search", **SEARCH_LINES["search"])
        panel.step(
            each.random_lanes,
            random_best,
            where="post",
            label="random lanes",
            **SEARCH_LINES["random lanes"],
        )
        if np.isfinite(each.bound):
            panel.axhline(each.bound, label="bound", color=style.BLACK, linestyle=":")
        panel.set_xscale("log")
        panel.set_yscale("log")
    top = max(panel.get_ylim()[1] for panel in panels)
    panels[0].set_ylim(0.7 * least, top)
    if any(np.min(each.best) <= least for each in found):
        multiples.write_note(drawn, f"values below {least:.1g} are drawn there")
    multiples.log_ticks(panels[0].yaxis)
    known = [
        entry for panel in panels for entry in zip(*panel.get_legend_handles_labels(), strict=True)
    ]
    entries = {name: line for line, name in known}
    drawn.legend([*entries.values()], [*entries], loc="outside lower center", ncols=3)
    multiples.write_left_out(drawn, (len(found), there, "cells"), where="search.csv")
    return drawn


def bounds_figure(table: pd.DataFrame, cells: Sequence[Cell], words: str, width: float) -> Figure:
    """Draw a row per cell of the table: random lanes, the choice found, its late value, and the bound."""
    there, cells = len(cells), [cell for cell in cells if cell.number in set(table["cell"])]
    labels = [cell.labels for cell in cells]
    shown = multiples.rows_fitting(labels, width, MOST_PANELS)
    rows = table.set_index("cell").loc[[cell.number for cell in cells[:shown]]]
    drawn, panel = multiples.named_rows(labels[:shown], width)
    marks = {name: look for name, look in SEARCH_MARKS.items() if name in rows}
    greatest = max(LOG_FLOOR, np.nan_to_num(rows[[*marks]].to_numpy(dtype=float), posinf=0.0).max())
    least = max(greatest / AXIS_RANGE, LOG_FLOOR)
    for name, look in marks.items():
        panel.plot(rows[name].clip(lower=least), range(shown), linestyle="none", label=name, **look)
    panel.set_xscale("log")
    panel.set_xlim(0.7 * least, None)
    if (rows[[*marks]] < least).any(axis=None):
        multiples.write_note(drawn, f"values below {least:.1g} are drawn there")
    multiples.log_ticks(panel.xaxis)
    panel.set_xlabel(words)
    drawn.legend(loc="outside lower center", ncols=4)
    multiples.write_left_out(drawn, (shown, there, "cells"), where="worst.csv")
    return drawn
