"""Plots as plotly's traces and layouts, plain data for JSON; colours are names of CSS variables."""

import base64
import textwrap
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from jaxnet.statistics.curves import (
    BOUND_NAMES,
    FLOOR,
    METRICS,
    Band,
    Curve,
    axis_ends,
    bands_span,
    magnitude_words,
    shares,
)
from jaxnet.statistics.groups import Group
from jaxnet.store.results import Results
from jaxnet.view.figures.multiples import title

Grid = dict[str, Any]  # `layouts` by choice, `panels` by panel and choice

BOUND_LINES = {
    "static": {"color": "--green", "dash": "solid"},
    "peak_gain": {"color": "--blue", "dash": "8px,3px"},
    "star_norm": {"color": "--purple", "dash": "2px,2px"},
    "lyapunov_best": {"color": "--orange", "dash": "4px,2px"},
    "lyapunov_corrected": {"color": "--red", "dash": "8px,3px,2px,3px"},
    "lyapunov_printed": {"color": "--sky", "dash": "8px,3px,2px,3px,2px,3px"},
}
FITTED: dict[str, Any] = {"color": "--muted", "dash": "solid", "width": 1.0}
FITTED_95: dict[str, Any] = {"color": "--muted", "dash": "1px,3px", "width": 1.5}
MARKERS = {"median": "circle", "below": "triangle-down", "maximum": "line-ew-open", "mean": "diamond-open"}


def packed(values: Any) -> dict[str, str]:
    """Numbers as plotly takes them, in single precision."""
    flat = np.ascontiguousarray(values, dtype="<f4").ravel()
    return {"dtype": "f4", "bdata": base64.b64encode(flat.tobytes()).decode()}


def log_range(low: float, high: float) -> list[float]:
    """Ends of a log axis as plotly takes them."""
    return [float(np.log10(low)), float(np.log10(high))]


def log_axis(ends: tuple[float, float], name: str) -> dict[str, Any]:
    """An axis between powers of ten."""
    low, high = log_range(*ends)
    return {"type": "log", "range": [low, high], "dtick": 2 if high - low > 4 else 1, "title": {"text": name}}


def sizes_axis(found: Sequence[Curve]) -> dict[str, Any]:
    """The axis of ā."""
    sizes = [size for curve in found for size in curve.sizes.tolist()]
    low, high = log_range(min(sizes) / 1.4, max(sizes) * 1.4)
    ticks = {"dtick": 1} if high - low > 2 else {"nticks": 5}
    return {"type": "log", "range": [low, high], **ticks, "title": {"text": "attack magnitude ā [m]"}}


def ultimate(found: Sequence[Curve], shown: Sequence[Curve]) -> Grid:
    """δ̂(ā) of each curve, a choice per metric."""
    ends = {metric: axis_ends(found, metric) for metric in METRICS}
    names = {"tail_max": "greatest tail error [m]", "tail_mean": "mean tail error [m]"}
    layouts = [
        {"xaxis": sizes_axis(found), "yaxis": log_axis(ends[metric], names[metric])} for metric in METRICS
    ]
    panels = [
        [[*lines(curve, metric), *points(curve, metric, ends[metric][0])] for metric in METRICS]
        for curve in shown
    ]
    return {"layouts": layouts, "panels": panels}


def lines(curve: Curve, metric: str) -> list[dict[str, Any]]:
    """Bounds and fitted proportions."""
    drawn = [(BOUND_NAMES[b], slope, BOUND_LINES[b]) for b, slope in curve.limits(metric).items()]
    for name, quantile, look in (("least squares", None, FITTED), ("95 % of lanes", 0.95, FITTED_95)):
        fitted = curve.fit(metric, quantile)
        if fitted is not None:
            drawn.append((name, fitted[0], look))
    sizes = curve.sizes
    return [
        {
            "x": sizes.tolist(),
            "y": (slope * sizes).tolist(),
            "mode": "lines",
            "line": {"width": 1.6, **look},
            "text": f"{name}: {slope:.4g} ā",
            "hoverinfo": "text",
        }
        for name, slope, look in drawn
    ]


def points(curve: Curve, metric: str, floor: float) -> list[dict[str, Any]]:
    """Median with 5 to 95 %, maximum, and mean with its interval; what lies below the axis stands on it."""
    names = ("q05", "median", "q95", "max", "mean", "low", "high")
    real = np.stack(curve.spread(metric, *names), axis=1)
    some = ~np.isnan(real[:, 0])
    sizes, real = curve.sizes[some], real[some]
    q05, median, q95, greatest, mean, low, high = np.fmax(floor, real).T
    text = [
        f"ā = {size:.4g} m<br>median {row[1]:.4g} m<br>5 to 95 %: {row[0]:.4g} to {row[2]:.4g} m<br>"
        f"maximum {row[3]:.4g} m<br>mean {row[4]:.4g} m ({row[5]:.4g} to {row[6]:.4g})"
        for size, row in zip(sizes, real, strict=True)
    ]
    common = {"mode": "markers", "text": text, "hoverinfo": "text"}
    symbols = [MARKERS["below" if below else "median"] for below in median <= floor]
    return [
        {
            **common,
            "x": (sizes * 1.1).tolist(),
            "y": mean.tolist(),
            "marker": {"symbol": MARKERS["mean"], "size": 6, "color": "--muted"},
            "error_y": bars(mean, low, high, "--muted"),
        },
        {
            **common,
            "x": sizes.tolist(),
            "y": median.tolist(),
            "marker": {"symbol": symbols, "size": 6, "color": "--black"},
            "error_y": bars(median, q05, q95, "--black"),
            "cliponaxis": False,
        },
        {
            **common,
            "x": sizes.tolist(),
            "y": greatest.tolist(),
            "marker": {
                "symbol": MARKERS["maximum"],
                "size": 8,
                "color": "--black",
                "line": {"width": 1.6, "color": "--black"},
            },
        },
    ]


def bars(middle: np.ndarray, low: np.ndarray, high: np.ndarray, colour: str) -> dict[str, Any]:
    """Error bars from low to high."""
    above, below = (np.nan_to_num(values).tolist() for values in (high - middle, middle - low))
    return {
        "symmetric": False,
        "array": above,
        "arrayminus": below,
        "color": colour,
        "thickness": 1.3,
        "width": 0,
    }


def unrecovered(found: Sequence[Curve], shown: Sequence[Curve]) -> Grid:
    """The share against ā."""
    y = {"range": [-4, 104], "title": {"text": "unrecovered [%]"}}
    panels = []
    for curve in shown:
        sizes = curve.sizes
        panels.append([[share(sizes.tolist(), *curve.shares())]])
    return {"layouts": [{"xaxis": sizes_axis(found), "yaxis": y}], "panels": panels}


def share(x: Sequence[float | int], middle: np.ndarray, low: np.ndarray, high: np.ndarray) -> dict[str, Any]:
    """Shares with their intervals [%]."""
    texts = [f"{a:.4g} % ({b:.4g} to {c:.4g})" for a, b, c in zip(middle, low, high, strict=True)]
    return {
        "x": x,
        "y": [None if np.isnan(value) else value for value in middle.tolist()],
        "mode": "markers",
        "marker": {"color": "--blue", "size": 6},
        "error_y": bars(middle, low, high, "--blue") | {"width": 3},
        "text": texts,
        "hoverinfo": "text",
    }


def unrecovered_rows(results: Results, most: int) -> Grid:
    """The share of each cell, a row each."""
    rows = shares(results).head(most)
    middle, low, high = (100 * rows[name].to_numpy(dtype=float) for name in rows)
    trace = share(list(range(len(rows))), middle, low, high)
    trace |= {"x": trace["y"], "y": trace["x"], "error_x": trace.pop("error_y")}
    names = [title(results.study.cells[int(number)].labels) or "all lanes" for number in rows.index]
    y = {
        "tickvals": list(range(len(rows))),
        "ticktext": ["<br>".join(map(escape, textwrap.wrap(name, 24))) for name in names],
        "range": [len(rows) - 0.4, -0.6],
    }
    x = {"range": [-2, 102], "title": {"text": "unrecovered [%]"}}
    return {"layouts": [{"xaxis": x, "yaxis": y}], "panels": [[[trace]]]}


def bands(groups: Sequence[Group], found: Mapping[int, Band], choices: Sequence[str]) -> Grid:
    """ẽ(t) of each group, a choice per ā."""
    time = next(iter(found.values())).time
    layout = {
        "xaxis": {"range": [0.0, float(time[-1])], "title": {"text": "t [s]"}},
        "yaxis": log_axis(bands_span(found), "ẽ [m]"),
    }
    panels = []
    for group in groups:
        cells = {magnitude_words(cell): found.get(cell.number) for cell in group.cells}
        drawn = [cells.get(choice) for choice in choices]
        panels.append([None if each is None else band(each) for each in drawn])
    return {"layouts": [layout] * len(choices), "panels": panels}


def band(drawn: Band) -> list[dict[str, Any]]:
    """5 to 95 % filled, median and maximum as lines."""
    low, median, high, greatest = (packed(np.maximum(FLOOR, values)) for values in drawn[1:])
    edge = {"mode": "lines", "line": {"width": 0, "color": "--blue"}, "hoverinfo": "skip"}
    x = packed(drawn.time)
    hover = "%{y:.3g} m at %{x:.3g} s<extra></extra>"
    return [
        {**edge, "x": x, "y": low},
        {**edge, "x": x, "y": high, "fill": "tonexty", "fillcolor": "--band"},
        {
            "x": x,
            "y": greatest,
            "mode": "lines",
            "line": {"color": "--red", "dash": "5px,3px", "width": 1.4},
            "hovertemplate": "maximum " + hover,
        },
        {
            "x": x,
            "y": median,
            "mode": "lines",
            "line": {"color": "--blue", "width": 2},
            "hovertemplate": "median " + hover,
        },
    ]
