"""The ultimate error δ̂(ā): quantiles of simulated lanes, bounds, and fitted lines."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from jaxnet.statistics.curves import BOUND_NAMES, NO_SLOPE, Curve, axis_ends
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

BOUND_STYLE: dict[str, Any] = {
    "static": {"color": style.GREEN, "linestyle": "-"},
    "peak_gain": {"color": style.BLUE, "linestyle": (0, (6, 2))},
    "star_norm": {"color": style.PURPLE, "linestyle": (0, (1, 1.2))},
    "lyapunov_best": {"color": style.ORANGE, "linestyle": (0, (3, 1.2))},
    "lyapunov_corrected": {"color": style.RED, "linestyle": (0, (6, 1.5, 1, 1.5))},
    "lyapunov_printed": {"color": style.SKY, "linestyle": (0, (6, 1.5, 1, 1.5, 1, 1.5))},
}
FIT_STYLE: dict[str, Any] = {"color": "0.45", "linewidth": 0.7, "linestyle": "-"}
MEDIAN_STYLE: dict[str, Any] = {"color": style.BLACK, "markersize": 3, "linestyle": ""}
MARK_STYLE: dict[str, Any] = MEDIAN_STYLE | {"markersize": 6}


def ultimate_figure(
    found: Sequence[Curve], metric: str = "tail_max", width: float = style.FIGURE_WIDTH
) -> Figure:
    """Draw a panel per group with quantiles over lanes, bounds and the fitted line."""
    shown = found[: multiples.panels_fitting([curve.group.labels for curve in found], width)]
    ends = axis_ends(found, metric)
    words = f"{'greatest' if metric == 'tail_max' else 'mean'} tail error [m]"
    labels = [curve.group.labels for curve in shown]
    drawn, panels = multiples.panel_grid(labels, "attack magnitude ā [m]", words, width)
    for panel, curve in zip(panels, shown, strict=True):
        for bound, slope in curve.limits(metric).items():
            panel.plot(curve.sizes, slope * curve.sizes, **BOUND_STYLE[bound])
        if fitted := curve.fit(metric):
            panel.plot(curve.sizes, fitted[0] * curve.sizes, **FIT_STYLE, zorder=1)
        draw_lanes(panel, curve, metric, ends[0])
    panels[0].set(xscale="log", yscale="log", ylim=ends)
    panels[0].autoscale_view(scaley=False)
    multiples.log_ticks(panels[0].xaxis)
    multiples.log_ticks(panels[0].yaxis)
    multiples.write_legend(drawn, ultimate_legend(shown, metric, ends[0]), 4)
    if any(curve.is_flat(metric) for curve in shown):
        multiples.write_note(drawn, NO_SLOPE)
    multiples.write_left_out(drawn, (len(shown), len(found), "groups"), where="cells.csv")
    return drawn


def draw_lanes(panel: Axes, curve: Curve, metric: str, floor: float) -> None:
    """Draw median, 5 to 95 % and maximum; a triangle marks a median below the axis."""
    sizes = curve.sizes
    spread = curve.spread(metric, "q05", "median", "q95", "max")
    low, median, high, greatest = (np.maximum(floor, values) for values in spread)
    panel.vlines(sizes, low, high, color=style.BLACK, linewidth=0.9)
    for marker, chosen in (("o", median > floor), ("v", median <= floor)):
        if chosen.any():
            panel.plot(sizes[chosen], median[chosen], marker, **MEDIAN_STYLE, clip_on=False)
    panel.plot(sizes, greatest, "_", **MARK_STYLE)


def ultimate_legend(shown: Sequence[Curve], metric: str, floor: float) -> list[Line2D]:
    present = {bound for curve in shown for bound in curve.limits(metric)}
    handles = [
        Line2D([], [], marker="o", label="median of lanes", **MEDIAN_STYLE),
        Line2D([], [], marker="|", label="5 to 95 %", **MARK_STYLE),
        Line2D([], [], marker="_", label="maximum", **MARK_STYLE),
    ]
    if any((curve.spread(metric, "median")[0] <= floor).any() for curve in shown):
        handles.append(Line2D([], [], marker="v", label="median below the axis", **MEDIAN_STYLE))
    if any(curve.fit(metric) for curve in shown):
        handles.append(Line2D([], [], label="least squares s·ā", **FIT_STYLE))
    bounds = [(name, look) for name, look in BOUND_STYLE.items() if name in present]
    return handles + [Line2D([], [], label=BOUND_NAMES[name], **look) for name, look in bounds]
