"""The ultimate error δ̂(ā) per ā: quantiles of simulated lanes, bounds, and fitted slopes."""

from collections.abc import Mapping, Sequence
from itertools import compress
from typing import Any

import numpy as np

from jaxnet.model.wording import number_text
from jaxnet.statistics.curves import BOUND_NAMES, Curve, log_ends
from jaxnet.view.drawings.drawing import Drawing, Look, Panel, Scale, Trace, moved_sideways
from jaxnet.view.drawings.words import NO_LANE
from jaxnet.view.figures import style

BOUND_LOOKS = {
    "static": Look(style.GREEN, width=1.6),
    "harmonic": Look(style.BROWN, (8, 2)),
    "peak_gain": Look(style.BLUE, (4, 1.5)),
    "star_norm": Look(style.PURPLE, (1, 1.2)),
    "lyapunov_best": Look(style.ORANGE, (6, 1.5, 1, 1.5, 1, 1.5)),
    "lyapunov_corrected": Look(style.RED, (6, 1.5, 1, 1.5)),
}  # without lyapunov_printed, which is false
FITS = {
    "fit of the means": (None, Look(style.GREY, width=0.7)),
    "fit below which 95 % of lanes are": (0.95, Look(style.GREY, (3, 3), width=0.9)),
}
MEDIAN = Look(style.BLACK, marker="o", size=3)
MEAN = Look(style.GREY, marker="D")
MAXIMUM = Look(style.BLACK, marker="_", size=6)
MOST_OF_WORST = 30.0  # times the worst error found, below which all bounds are drawn
NO_INTERVAL = "some means have no interval: too few lanes, or a few great errors make them up"
FEW_STATISTICS = ("q05", "median", "max")
CURVE_STATISTICS = ("q05", "median", "q95", "max", "mean", "low", "high")
ULTIMATE_WORDS = {"tail_max": "greatest tail error / ā", "tail_mean": "mean tail error / ā"}


def ultimate_drawing(found: Sequence[Curve], metric: str) -> Drawing:
    """δ̂(ā) / ā: a panel a curve, with quantiles of its lanes, and slopes of bounds and fits.

    A line of a fit ends with the magnitudes at which lanes ended.
    """
    shown, lows, lines = list[Any](), list[Any](), list[list[Trace]]()
    every = (curve.limits(metric).items() for curve in found)
    limits = [{name: slope for name, slope in each if name in BOUND_LOOKS} for each in every]
    least = [min(each.values()) for each in limits if each]  # of each curve's bounds: drawn
    top = max([MOST_OF_WORST * np.nan_to_num(curve.worst) for curve in found] + least)
    for curve, bounds in zip(found, limits, strict=True):
        drawn = [name for name, slope in bounds.items() if slope <= top]
        slopes = {BOUND_NAMES[name]: (bounds[name], BOUND_LOOKS[name]) for name in drawn}
        for name, (quantile, look) in FITS.items():
            fitted = curve.fit(metric, quantile)
            if fitted:
                slopes[name] = fitted[0], look
        lines.append([])
        for name, (slope, look) in slopes.items():
            x = curve.sizes[curve.ended] if name in FITS else curve.sizes
            lines[-1].append(Trace(name, look, x, np.full(len(x), slope), "slope"))
        low, median, most = (each / curve.sizes for each in curve.spread(metric, *FEW_STATISTICS))
        shown += [median, most, [slope for slope, _ in slopes.values()]]
        lows.append(low)
    every = np.concatenate(shown)
    first, last = log_ends(every, *lows)
    last = min(last, 1.5 * every[np.isfinite(every)].max(initial=first))
    y = Scale(ULTIMATE_WORDS[metric], (first, last), log=True).cut(every)
    drawn = [curve.sizes[curve.ended] for curve in found]
    drawn += [each.x for some in lines for each in some]
    x = Scale("attack magnitude ā [m]", log=True, ticks=np.unique(np.concatenate(drawn)).tolist())
    panels = []
    for curve, some in zip(found, lines, strict=True):
        within = [each for each in some if len(each.x) and y.floor <= each.y[0] <= y.top]
        series = [*within, *lane_series(curve, metric, x)]
        words = "" if curve.ended.any() else NO_LANE
        note = slope_note(curve, metric)
        panels.append(Panel(curve.group.labels, [*curve.group.attacked], series, words, note))
    there = [curve.group.labels for curve in found]
    notes = higher_words(limits, top)
    notes += [NO_INTERVAL] * any(lacks_interval(curve, metric) for curve in found)
    return Drawing(panels, x, y, notes, there=(there, "groups"))


def higher_words(limits: Sequence[Mapping[str, float]], top: float) -> list[str]:
    """The bounds that are not drawn, each with its greatest slope."""
    pairs = sorted((slope, BOUND_NAMES[name]) for each in limits for name, slope in each.items())
    higher = {name: f"{name}, up to {number_text(s)} ā" for s, name in pairs if s > top}
    told = f"bounds over {number_text(top)} ā are not drawn ({'; '.join(higher.values())})"
    return [told] * bool(higher)


def slope_note(curve: Curve, metric: str) -> str:
    if curve.is_flat(metric):
        return "errors do not rise with ā: no line is fitted"
    if curve.ended.sum() == 1:
        return "lanes ended at one ā alone: no line is fitted"
    bent = curve.is_bent(metric)
    return "errors are not proportional to ā: no line is fitted" if bent else ""


def lacks_interval(curve: Curve, metric: str) -> bool:
    mean, low = curve.spread(metric, "mean", "low")
    return bool((np.isfinite(mean) & np.isnan(low)).any())


def lane_series(curve: Curve, metric: str, x: Scale) -> list[Trace]:
    """Mean, median, 5 to 95 % and maximum of the lanes, where any lane ended."""
    if not curve.ended.any():
        return []
    sizes, cells = curve.sizes[curve.ended], [*compress(curve.group.attacked, curve.ended)]
    statistics = (each[curve.ended] / sizes for each in curve.spread(metric, *CURVE_STATISTICS))
    q05, median, q95, most, mean, low, high = statistics
    mean = Trace("mean, 95 % interval", MEAN, sizes, mean, "points", low, high, cells)
    median = Trace("median, 5 to 95 % of lanes", MEDIAN, sizes, median, "points", q05, most, cells)
    means, lanes = moved_sideways([mean, median], x)
    ends = lanes._replace(name="maximum", look=MAXIMUM, y=most, low=None, high=None)
    return [means, lanes._replace(high=q95), ends]
