"""Tail errors, or spreads, of the lanes of each cell, with median and 5 to 95 %."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxnet.config.cells import Cell, judged_metric
from jaxnet.statistics.curves import GREATEST_SHOWN, LOG_FLOOR
from jaxnet.statistics.quantities import SPREAD_WORDS
from jaxnet.store import rows
from jaxnet.store.results import Results
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

JUDGED_WORDS = {
    "tail_mean": "mean error over the tail and the vehicles [m]",
    "spread": "spread of honest vehicles over the tail [m]",
}
MOST_TAIL_ROWS = 24  # cells that one figure takes
MOST_DOTS = 1000  # lanes of a cell that it takes: more lie on top of each other, and each is drawn


def tails_figure(
    results: Results, cells: Sequence[Cell], width: float = style.FIGURE_WIDTH
) -> Figure:
    """Draw the judged metric of the lanes that ended, a row per cell, for as many cells as the page holds."""
    labels = [cell.labels for cell in cells]
    most = multiples.rows_fitting(labels, width, MOST_TAIL_ROWS)
    shown = {cell.number: place for place, cell in enumerate(cells[:most])}
    drawn, panel = multiples.named_rows(labels[:most], width)
    metric, is_cut = judged_metric(cells), False
    for cell, lanes in results.by_cell(metric, where=rows.OK, cells=shown):
        number = shown[cell]
        is_cut |= bool((lanes[metric] < LOG_FLOOR).any())
        values = lanes[metric].to_numpy().clip(LOG_FLOOR, GREATEST_SHOWN)
        dots = thin_by_rank(values)
        jitter = np.random.default_rng(0).uniform(-0.22, 0.22, len(dots))
        panel.plot(dots, number + jitter, ".", color=style.SKY, markersize=3, zorder=1)
        low, median, high = np.quantile(values, [0.05, 0.5, 0.95])
        panel.plot([low, high], [number] * 2, color=style.BLACK, zorder=2)
        panel.plot(median, number, "D", color=style.BLACK, markersize=4, zorder=3)
    panel.set_xscale("log")
    panel.autoscale_view()
    multiples.log_ticks(panel.xaxis)
    dot = (
        "one dot per lane"
        if max(results.samples) <= MOST_DOTS
        else f"{MOST_DOTS:,} dots evenly by rank"
    )
    panel.set_xlabel(multiples.axis_name(JUDGED_WORDS[metric], width))
    told = [f"{dot}; median and 5 to 95 %", *[SPREAD_WORDS] * (metric == "spread")]
    below = f"values below {LOG_FLOOR:g} m are drawn there"
    multiples.write_note(drawn, "; ".join(told + [below] * is_cut))
    multiples.write_left_out(drawn, (len(shown), len(cells), "cells"), where="lanes/")
    return drawn


def thin_by_rank(values: Float[np.ndarray, " lanes"]) -> Float[np.ndarray, " dots"]:
    """Return at most MOST_DOTS sorted values, evenly spaced in rank, with minimum and maximum."""
    ranks = np.linspace(0, len(values) - 1, min(len(values), MOST_DOTS)).round().astype(int)
    return np.sort(values)[ranks]
