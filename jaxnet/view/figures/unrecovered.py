"""The share of lanes that do not recover, with its interval: what a median hides."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from jaxnet.statistics.curves import MOST_PANELS, Curve, magnitude_is_swept, shares
from jaxnet.store.results import Results
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.multiples import as_text, title
from jaxnet.view.figures.style import Figure

LOOK: dict[str, Any] = {
    "color": style.BLUE,
    "ecolor": style.BLUE,
    "markersize": 3,
    "fmt": "o",
    "elinewidth": 0.9,
    "capsize": 1.5,
}


def figure(results: Results, found: Sequence[Curve]) -> Figure:
    """Against ā, a panel per group, where ā is swept; else a row per cell; the first MOST."""
    if not magnitude_is_swept(found):
        return rows(results)
    shown = found[:MOST_PANELS]
    labels = [curve.group.labels for curve in shown]
    drawn, panels = multiples.panels(labels, "attack magnitude ā [m]", "unrecovered [%]", height=1.15)
    for panel, curve in zip(panels, shown, strict=True):
        draw_share(panel, curve)
    panels[0].set_xscale("log")
    panels[0].autoscale_view()
    multiples.log_ticks(panels[0].xaxis)
    panels[0].set_ylim(-4, 104)
    multiples.note_left_out(drawn, (len(shown), len(found), "groups"), where="cells.csv")
    return drawn


def draw_share(panel: Axes, curve: Curve) -> None:
    """One group's share against ā."""
    share, low, high = curve.shares()
    sizes = curve.sizes
    panel.errorbar(sizes, share, np.stack([share - low, high - share]), **LOOK)


def rows(results: Results) -> Figure:
    """A row per cell."""
    there = shares(results)
    found = there.head(MOST_PANELS)
    share, low, high = (100 * found[name].to_numpy() for name in found)
    places = np.arange(len(found))
    drawn = Figure(figsize=(style.WIDTH, 0.28 * len(found) + 0.7))
    panel = drawn.add_subplot()
    panel.errorbar(share, places, xerr=np.stack([share - low, high - share]), **LOOK)
    names = [title(results.study.cells[int(number)].labels) for number in found.index]
    panel.set_yticks(places, [as_text(name) for name in names])
    panel.set_ylim(len(found) - 0.4, -0.6)
    panel.set_xlim(-2, 102)
    panel.set_xlabel("lanes unrecovered, with interval [%]")
    panel.grid(True, axis="x", color="0.9", linewidth=0.5)
    multiples.note_left_out(drawn, (len(found), len(there), "cells"), where="cells.csv")
    return drawn
