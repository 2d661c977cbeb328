"""ẽ(t) over the lanes: median, 5 to 95 % and maximum."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxnet.config.cells import Cell
from jaxnet.statistics.bands import Band, bands_span, scenes
from jaxnet.statistics.curves import LOG_FLOOR, magnitude_words
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

SIZES = 3  # of ā shown in one panel: the least, a middle one and the greatest


def figure(cells: Sequence[Cell], bands: Mapping[int, Band], width: float = style.WIDTH) -> Figure:
    """A panel per group of cells that differ in ā alone, the first that there is room for."""
    there = scenes(cells)
    groups = there[: multiples.room([group.labels for group in there], width)]
    labels = [group.labels for group in groups]
    drawn, panels = multiples.panels(labels, "t [s]", r"$\tilde{e}$ [m]", width)
    looks: dict[str, Any] = {}
    for panel, group in zip(panels, groups, strict=True):
        for cell in few(group.cells):
            look = looks.setdefault(magnitude_words(cell), style.SERIES[len(looks) % len(style.SERIES)])
            if cell.number in bands:
                draw_band(panel, bands[cell.number], look)
    if bands:
        panels[0].set(yscale="log", ylim=bands_span(bands))
        multiples.log_ticks(panels[0].yaxis)
    handles: list[Any] = [Line2D([], [], label=name, **look) for name, look in looks.items()]
    handles.append(Patch(facecolor="0.8", label="5 to 95 % of lanes"))
    handles.append(Line2D([], [], color="0.5", linewidth=0.5, label="maximum"))
    drawn.legend(
        handles=handles,
        loc="outside lower center",
        ncols=multiples.legend_columns(width, 5),
        handlelength=2.6,
    )
    sizes = max(len(group.cells) for group in groups)
    multiples.note_left_out(
        drawn,
        (len(groups), len(there), "groups"),
        (min(SIZES, sizes), sizes, "sizes ā"),
        where="errors.zarr",
    )
    return drawn


def few(cells: Sequence[Cell]) -> list[Cell]:
    """SIZES of them, spread evenly."""
    chosen = np.unique(np.linspace(0, len(cells) - 1, min(SIZES, len(cells))).round().astype(int))
    return [cells[number] for number in chosen]


def draw_band(panel: Axes, band: Band, look: Any) -> None:
    """One cell's lanes; below FLOOR a log axis shows rounding."""
    low, median, high, greatest = (np.maximum(LOG_FLOOR, values) for values in band[1:])
    panel.fill_between(band.time, low, high, color=look["color"], alpha=0.2, linewidth=0)
    panel.plot(band.time, greatest, color=look["color"], linewidth=0.5)
    panel.plot(band.time, median, **look)
