"""Results of a search, and Sobol's indices of a sensitivity analysis."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.explore.courses import Course
from jaxnet.statistics.curves import MOST_PANELS, log_ends
from jaxnet.statistics.groups import evenly
from jaxnet.view.drawings.drawing import Drawing, Look, Panel, Scale, Trace
from jaxnet.view.drawings.words import distinct_titles
from jaxnet.view.figures import style

SEARCH, RANDOM, BOUND = (
    Look(style.BLUE, width=1.4),
    Look(style.RED, (5, 1.5)),
    Look(style.BLACK, (1, 1.2)),
)
SEARCH_MARKS = {
    "worst random lane": Look(style.RED, marker="s", size=4),
    "greatest tried": Look(style.BLUE, marker="o", size=4),
    "found, later": Look(style.BLUE, marker="x", size=5),
    "bound of theory": Look(style.BLACK, marker="|", size=8),
}
INDICES = {
    "first": ("first-order: alone", -0.16, Look(style.BLUE, marker="o")),
    "total": ("total: with interactions", 0.16, Look(style.RED, marker="s", hollow=True)),
}
AXIS_MARGIN = 0.08


def course_drawing(found: Sequence[Course], cells: Sequence[Cell], words: str) -> Drawing:
    """The best value against the number of lanes: of each search and of random lanes."""
    best = np.concatenate([[*each.best, *each.random_best] for each in found])
    lanes = [float(n) for each in found for n in (*each.lanes, *each.random_lanes)]
    panels, known = [], [*best]
    for each in found:
        series = [
            Trace("search", SEARCH, each.lanes, each.best, "steps"),
            Trace("random lanes", RANDOM, each.random_lanes, each.random_best, "steps"),
        ]
        if np.isfinite(each.bound):
            ends = np.array([min(lanes), max(lanes)])
            known.append(each.bound)
            series.append(Trace("bound", BOUND, ends, np.full(2, each.bound), "level"))
        panels.append(Panel(each.cell.labels, [each.cell.number], series))
    y = Scale(words, log_ends(known), log=True)
    x = Scale("lanes", log=True)
    return Drawing(
        panels, x, y, there=([cell.labels for cell in cells], "cells"), where="search.csv"
    )


def worst_drawing(table: pd.DataFrame, cells: Sequence[Cell], words: str) -> Drawing:
    """A row per cell of the table: random lanes, the choice found, late too, the bound."""
    searched = set(table["cell"])
    shown = evenly([cell for cell in cells if cell.number in searched], MOST_PANELS)
    rows = table.set_index("cell").loc[[cell.number for cell in shown]]
    marks = {name: look for name, look in SEARCH_MARKS.items() if name in rows}
    values = rows[[*marks]].to_numpy(dtype=float)
    at = np.arange(len(shown))
    series = [
        Trace(name, look, value, at, "points")
        for (name, look), value in zip(marks.items(), values.T, strict=True)
    ]
    labels = [cell.labels for cell in shown]
    titles, common = distinct_titles(labels)
    x = Scale(words, log_ends(values), log=True)
    panel = Panel({}, [cell.number for cell in shown], series)
    y, there = Scale("", names=titles, labels=labels), [cell.labels for cell in cells]
    return Drawing([panel], x, y, [common], there=(there, "cells"), where="worst.csv")


def sensitivity_drawing(table: pd.DataFrame, cells: Sequence[Cell]) -> Drawing:
    """A panel per cell, a row per quantity: first-order and total indices with intervals."""
    shown = [cell for cell in cells if cell.number in set(table["cell"])]
    names, metric = list(dict.fromkeys(table["quantity"])), table["metric"].iloc[0]
    panels = []
    for cell in shown:
        mine = table.loc[table["cell"] == cell.number]
        places = np.array([names.index(name) for name in mine["quantity"]])
        series = []
        for order, (name, shift, look) in INDICES.items():
            value, low, high = (
                mine[f"{order}{end}"].to_numpy(float) for end in ("", "_low", "_high")
            )
            series.append(Trace(name, look, value, places + shift, "points", low, high))
        words = "nothing varies" if mine["first"].isna().to_numpy().all() else ""
        panels.append(Panel(cell.labels, [cell.number], series, words))
    notes = []
    if metric == "unrecovered":
        over = table["threshold"]
        ends = " to ".join(dict.fromkeys(f"{end:.4g}" for end in (over.min(), over.max())))
        judged = "spread" if is_leaderless(cells) else "mean error"
        notes = [f"unrecovered: {judged} over the tail > {ends} m"]
    estimates = table[[*INDICES]].to_numpy(float)  # an interval may end beyond
    low, high = np.nanmin(estimates, initial=0.0), np.nanmax(estimates, initial=1.0)
    x = Scale(f"part of the variance of {metric}", (low - AXIS_MARGIN, high + AXIS_MARGIN))
    y = Scale("", names=names)
    there = [cell.labels for cell in shown], "cells"
    return Drawing(panels, x, y, notes, beside=2, there=there, where="sensitivity.csv")
