"""The ultimate error δ̂(ā): quantiles of simulated lanes, bounds, and fitted lines."""

from collections.abc import Sequence

import numpy as np

from jaxnet.statistics.curves import BOUND_NAMES, NO_SLOPE, Curve, axis_ends
from jaxnet.view.drawings.drawing import (
    Drawing,
    Look,
    Panel,
    Scale,
    Trace,
)
from jaxnet.view.figures import style

BOUND_LOOKS = {
    "static": Look(style.GREEN),
    "peak_gain": Look(style.BLUE, (6, 2)),
    "star_norm": Look(style.PURPLE, (1, 1.2)),
    "lyapunov_best": Look(style.ORANGE, (3, 1.2)),
    "lyapunov_corrected": Look(style.RED, (6, 1.5, 1, 1.5)),
    "lyapunov_printed": Look(style.SKY, (6, 1.5, 1, 1.5, 1, 1.5)),
}
FITS = {
    "least squares s·ā": (None, Look(style.GREY, width=0.7)),
    "95 % of lanes": (0.95, Look(style.GREY, (1, 2), width=0.9)),
}
OF_PAGE = ("95 % of lanes",)  # not in print
MEDIAN = Look(style.BLACK, marker="o", size=3)
MEAN = Look(style.GREY, marker="D", hollow=True)
MAXIMUM = Look(style.BLACK, marker="_", size=6)
CURVE_STATISTICS = ("q05", "median", "q95", "max", "mean", "low", "high")
ULTIMATE_WORDS = {"tail_max": "greatest tail error [m]", "tail_mean": "mean tail error [m]"}


def ultimate_drawing(found: Sequence[Curve], metric: str) -> Drawing:
    """δ̂(ā): a panel a curve, with quantiles of its lanes, and bounds and fits as lines s·ā."""
    ends = axis_ends(found, metric)
    panels = []
    for curve in found:
        slopes = {
            BOUND_NAMES[name]: (slope, BOUND_LOOKS[name])
            for name, slope in curve.limits(metric).items()
        }
        for name, (quantile, look) in FITS.items():
            fitted = curve.fit(metric, quantile)
            if fitted and not (quantile is None and curve.is_bent(metric)):
                slopes[name] = fitted[0], look
        lines = []
        for name, (slope, look) in slopes.items():
            line = Trace(name, look, curve.sizes, slope * curve.sizes, "slope")
            lines.append(line._replace(of_page=name in OF_PAGE))
        labels, about = curve.group.labels, [*curve.group.attacked]
        panels.append(Panel(labels, about, [*lines, *lane_series(curve, metric, ends[0])]))
    x = Scale("attack magnitude ā [m]", log=True)
    flat = any(curve.is_flat(metric) for curve in found)
    y = Scale(ULTIMATE_WORDS[metric], ends, log=True)
    return Drawing(panels, x, y, [NO_SLOPE] * flat, there=(len(found), "groups"))


def lane_series(curve: Curve, metric: str, floor: float) -> list[Trace]:
    """Median, 5 to 95 %, maximum and mean; a triangle marks a median below the axis."""
    sizes, statistics = curve.sizes, curve.spread(metric, *CURVE_STATISTICS)
    q05, median, q95, most, mean, low, high = statistics
    about = {"form": "points", "cells": [*curve.group.attacked]}
    below = median <= floor
    found = [
        Trace("mean, 95 % interval", MEAN, 1.1 * sizes, mean, low=low, high=high, of_page=True)
    ]
    seen = np.where(below, np.nan, median)
    found.append(Trace("median, 5 to 95 %", MEDIAN, sizes, seen, low=q05, high=q95))
    if below.any():
        look = MEDIAN._replace(marker="v")
        hidden = np.where(below, median, np.nan)
        found.append(Trace("median below the axis", look, sizes, hidden, low=q05, high=q95))
    found.append(Trace("maximum", MAXIMUM, sizes, most))
    return [each._replace(**about) for each in found]
