"""The numbers of the page's small multiples, plain data for JSON; the script draws them.

A panel has the numbers of the cells that it is about, by which the reader chooses.
"""

import base64
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from jaxnet.config.cells import Cell
from jaxnet.statistics.curves import (
    BOUND_NAMES,
    METRICS,
    SHARE,
    Band,
    Curve,
    axis_ends,
    bands_span,
    shares,
)
from jaxnet.store.results import Results
from jaxnet.view.figures.multiples import title

SPREAD = ("q05", "median", "q95", "max", "mean", "low", "high")
FITTED = {"least squares": None, "95 % of lanes": 0.95}
LOOKS = {
    "static": {"color": "--green", "dash": "solid"},
    "peak_gain": {"color": "--blue", "dash": "8px,3px"},
    "star_norm": {"color": "--purple", "dash": "2px,2px"},
    "lyapunov_best": {"color": "--orange", "dash": "4px,2px"},
    "lyapunov_corrected": {"color": "--red", "dash": "8px,3px,2px,3px"},
    "lyapunov_printed": {"color": "--sky", "dash": "8px,3px,2px,3px,2px,3px"},
    "least squares": {"color": "--muted", "dash": "solid", "width": 1.0},
    "95 % of lanes": {"color": "--muted", "dash": "1px,3px", "width": 1.5},
}


def packed(values: Any, kind: str = "<f4") -> str:
    """Numbers as text, in single precision or as bytes."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def numbers(values: Iterable[float]) -> list[float | None]:
    """Numbers for JSON, which has none that is not one."""
    return [float(value) if np.isfinite(value) else None for value in values]


def panel(cells: Iterable[int], labels: dict[str, Any]) -> dict[str, Any]:
    """What every panel has: the numbers of its cells, and what it is about."""
    return {"cells": list(cells), "title": title(labels)}


def ultimate(found: Sequence[Curve]) -> dict[str, Any]:
    """δ̂(ā) of each curve: both metrics, and the lines through the origin by their slopes."""
    lines = {BOUND_NAMES.get(name, name): look for name, look in LOOKS.items()}
    panels = [
        panel(curve.group.attacked, curve.group.labels)
        | {"size": curve.sizes.tolist()}
        | {metric: statistics_of(curve, metric) for metric in METRICS}
        | {"lines": {metric: slopes_of(curve, metric) for metric in METRICS}}
        for curve in found
    ]
    present = {name for curve in found for metric in METRICS for name in slopes_of(curve, metric)}
    return {
        "metrics": METRICS,
        "ends": {metric: axis_ends(found, metric) for metric in METRICS},
        "looks": {name: look for name, look in lines.items() if name in present},
        "panels": panels,
    }


def statistics_of(curve: Curve, metric: str) -> dict[str, list[float | None]]:
    """Statistics over lanes, by ascending ā [m]."""
    return {name: numbers(values) for name, values in zip(SPREAD, curve.spread(metric, *SPREAD), strict=True)}


def slopes_of(curve: Curve, metric: str) -> dict[str, float]:
    """Bounds and fitted proportions, per ā."""
    fits = {name: curve.fit(metric, quantile) for name, quantile in FITTED.items()}
    bounds = {BOUND_NAMES[bound]: slope for bound, slope in curve.limits(metric).items()}
    return bounds | {name: fit[0] for name, fit in fits.items() if fit is not None}


def unrecovered(found: Sequence[Curve]) -> dict[str, Any]:
    """The share against ā."""
    return {
        "panels": [
            panel(curve.group.attacked, curve.group.labels)
            | {"size": curve.sizes.tolist()}
            | {name: numbers(curve.cells[name].to_numpy(dtype=float)) for name in SHARE}
            for curve in found
        ]
    }


def unrecovered_rows(results: Results) -> dict[str, Any]:
    """The share of each cell, a row each of one plot."""
    cells, rows = results.study.cells, shares(results)
    columns = {name: numbers(rows[name].to_numpy(dtype=float)) for name in SHARE}
    return {
        "rows": True,
        "panels": [
            panel([number], cells[number].labels) | {name: columns[name][place] for name in SHARE}
            for place, number in enumerate(map(int, rows.index))
        ],
    }


def bands(cells: Sequence[Cell], found: Mapping[int, Band]) -> dict[str, Any]:
    """ẽ(t) of each cell."""
    return {
        "ends": bands_span(found),
        "time": packed(next(iter(found.values())).time),
        "panels": [
            panel([number], cells[number].labels)
            | {name: packed(getattr(each, name)) for name in ("low", "median", "high", "greatest")}
            for number, each in found.items()
        ],
    }
