"""The numbers of the page's small multiples, plain data for JSON; the script draws them.

A panel has the numbers of the cells that it is about, by which the reader chooses.
"""

import base64
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import Cell
from jaxnet.config.naming import labels_title, quantity, value_alone
from jaxnet.explore.courses import Course
from jaxnet.model.wording import counted
from jaxnet.statistics.curves import (
    BOUND_NAMES,
    METRICS,
    SHARE,
    Band,
    Curve,
    axis_ends,
    bands_span,
    failed_kinds,
    shares,
)
from jaxnet.statistics.recovery import confidence_told
from jaxnet.statistics.tiles import Tiling, digits, outcomes
from jaxnet.store.results import Results
from jaxnet.view.figures import heat

LARGEST = np.finfo(np.float32).max
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
    """Numbers as text, in single precision, as far as that goes, or as bytes."""
    if kind == "<f4":
        values = np.clip(values, -LARGEST, LARGEST)
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def numbers(values: Iterable[float]) -> list[float | None]:
    """Numbers for JSON, which has none that is not one."""
    return [float(value) if np.isfinite(value) else None for value in values]


def panel(cells: Iterable[int], labels: dict[str, Any]) -> dict[str, Any]:
    """What every panel has: the numbers of its cells, and what it is about."""
    return {"cells": list(cells), "title": labels_title(labels)}


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


def tiles(results: Results, tiling: Tiling) -> dict[str, Any]:
    """Cells over two swept keys: what is told of each, and its place on a scale of colours."""
    found: Any = outcomes(results)
    *titled, across = tiling.panels[0] or [""]
    return {
        "rows": [quantity(tiling.row), [value_alone(tiling.row, value) for value in tiling.rows]],
        "columns": [quantity(tiling.column), [value_alone(tiling.column, value) for value in tiling.columns]],
        "panels": [
            {
                "title": labels_title({key: labels[key] for key in titled}),
                "across": labels_title({key: labels[key] for key in labels if key == across}),
                "cells": numbered.tolist(),
            }
            for labels, numbered in zip(tiling.panels, tiling.cells, strict=True)
        ],
        "metrics": [coloured(name, found[name]) for name in heat.METRICS if found[name].notna().any()],
        "low": numbers(found["unrecovered_low"]),
        "high": numbers(found["unrecovered_high"]),
        "intervals": found["interval"].tolist(),
        "confidence": 100 * confidence_told(results.study.config.samples),
        "ok": found["ok"].tolist(),
        "failed": {cell: counted(kinds) for cell, kinds in failed_kinds(results).items()},
        "blank": found["blank"].tolist(),
        "palette": heat.palette(),
    }


def coloured(metric: str, values: pd.Series) -> dict[str, Any]:
    """One metric of all cells, in numbers, in words and as places on its scale, which has ticks."""
    norm = heat.scale(metric, values)
    return {
        "name": heat.METRICS[metric],
        "share": metric == "unrecovered",
        "values": numbers(values),
        "words": [digits(metric, value) if np.isfinite(value) else "" for value in values],
        "places": numbers(np.ma.filled(norm(values.to_numpy()), np.nan)),
        "ends": np.asarray(norm.inverse([0.0, 1.0])).tolist(),
    }


def searches(found: Iterable[Course], words: str) -> dict[str, Any]:
    """The best until then, by lanes, of each cell's search and of random lanes."""
    return {
        "words": words,
        "panels": [
            panel([each.cell.number], each.cell.labels)
            | {name: numbers(getattr(each, name)) for name in Course._fields[1:-1]}
            | {"bound": each.bound if np.isfinite(each.bound) else None}
            for each in found
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
