"""Where the lanes of each cell end: their tail errors, with median and 5 to 95 %."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxnet.config.cells import Cell
from jaxnet.statistics.curves import GREATEST_SHOWN, LOG_FLOOR
from jaxnet.store import rows
from jaxnet.store.results import Results
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

MOST_SHOWN = 24  # cells that one figure takes
DOTS = 1000  # lanes of a cell that it takes: more lie on top of each other, and each is drawn


def figure(results: Results, cells: Sequence[Cell], width: float = style.WIDTH) -> Figure:
    """`tail_mean` of the ok lanes of the first MOST of these cells."""
    labels = [cell.labels for cell in cells]
    most = multiples.rows_room(labels, width, MOST_SHOWN)
    shown = {cell.number: place for place, cell in enumerate(cells[:most])}
    drawn, panel = multiples.named_rows(labels[:most], width)
    for cell, lanes in results.by_cell("tail_mean", where=rows.OK, cells=shown):
        number = shown[cell]
        values = lanes["tail_mean"].to_numpy().clip(LOG_FLOOR, GREATEST_SHOWN)
        dots = some(values)
        jitter = np.random.default_rng(0).uniform(-0.22, 0.22, len(dots))
        panel.plot(dots, number + jitter, ".", color=style.SKY, markersize=3, zorder=1)
        low, median, high = np.quantile(values, [0.05, 0.5, 0.95])
        panel.plot([low, high], [number] * 2, color=style.BLACK, zorder=2)
        panel.plot(median, number, "D", color=style.BLACK, markersize=4, zorder=3)
    panel.set_xscale("log")
    panel.autoscale_view()
    multiples.log_ticks(panel.xaxis)
    dot = "one dot per lane" if results.manifest["samples"] <= DOTS else f"{DOTS:,} dots evenly by rank"
    panel.set_xlabel(multiples.axis_name("mean error over the tail and the vehicles [m]", width))
    multiples.note(drawn, f"{dot}; median and 5 to 95 %")
    multiples.note_left_out(drawn, (len(shown), len(cells), "cells"), where="lanes/")
    return drawn


def some(values: Float[np.ndarray, " lanes"]) -> Float[np.ndarray, " dots"]:
    """DOTS of them at most, evenly by rank, with the least and the greatest."""
    ranks = np.linspace(0, len(values) - 1, min(len(values), DOTS)).round().astype(int)
    return np.sort(values)[ranks]
