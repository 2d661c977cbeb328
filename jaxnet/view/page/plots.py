"""Data of the page's small multiples, ready for JSON; scripts draw the multiples.

Each panel lists the numbers of its cells, for the page's filter.
"""

import base64
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.colors import to_hex

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.naming import key_name, labels_title, quantity, value_alone
from jaxnet.explore.courses import Course
from jaxnet.model.wording import counted
from jaxnet.statistics.axes import Axes, by_hue, geometric, on_a_scale, ordered_values, panels_of
from jaxnet.statistics.bands import Band, bands_span
from jaxnet.statistics.curves import (
    BOUND_NAMES,
    METRIC_NAMES,
    Curve,
    axis_ends,
    failed_kinds,
)
from jaxnet.statistics.groups import Label
from jaxnet.statistics.quantities import Quantity
from jaxnet.statistics.recovery import confidence_told, share_name
from jaxnet.statistics.tiles import Tiling, tile_table, tile_text
from jaxnet.store.results import Results
from jaxnet.view.figures import heat, lines, style

PAGE_COLOURS = ("blue", "orange", "green", "red", "purple", "sky", "black")
LARGEST_SINGLE = np.finfo(np.float32).max
CURVE_STATISTICS = ("q05", "median", "q95", "max", "mean", "low", "high")
FIT_QUANTILES = {"least squares": None, "95 % of lanes": 0.95}
LINE_STYLES = {
    "static": {"color": "--green", "dash": "solid"},
    "peak_gain": {"color": "--blue", "dash": "8px,3px"},
    "star_norm": {"color": "--purple", "dash": "2px,2px"},
    "lyapunov_best": {"color": "--orange", "dash": "4px,2px"},
    "lyapunov_corrected": {"color": "--red", "dash": "8px,3px,2px,3px"},
    "lyapunov_printed": {"color": "--sky", "dash": "8px,3px,2px,3px,2px,3px"},
    "least squares": {"color": "--muted", "dash": "solid", "width": 1.0},
    "95 % of lanes": {"color": "--muted", "dash": "1px,3px", "width": 1.5},
}


def pack_numbers(values: np.ndarray, kind: str = "<f4") -> str:
    """Encode numbers in base64, clipped to single precision, or as bytes of another type."""
    if kind == "<f4":
        values = np.clip(values, -LARGEST_SINGLE, LARGEST_SINGLE)
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def finite_numbers(values: Iterable[float]) -> list[float | None]:
    """Replace NaN and infinities, which JSON does not have, by None."""
    return [float(value) if np.isfinite(value) else None for value in values]


def panel_data(cells: Iterable[int], labels: Mapping[str, object]) -> dict[str, object]:
    """Return the fields of every panel: the numbers of its cells, and its title."""
    return {"cells": list(cells), "title": labels_title(labels)}


def ultimate_data(found: Sequence[Curve]) -> dict[str, object]:
    """Return δ̂(ā) of each curve for both metrics, and the slopes of bounds and fits."""
    lines = {BOUND_NAMES.get(name, name): look for name, look in LINE_STYLES.items()}
    panels = [
        panel_data(curve.group.attacked, curve.group.labels)
        | {"size": curve.sizes.tolist()}
        | {metric: statistics_of(curve, metric) for metric in METRIC_NAMES}
        | {"lines": {metric: slopes_of(curve, metric) for metric in METRIC_NAMES}}
        for curve in found
    ]
    present = {
        name for curve in found for metric in METRIC_NAMES for name in slopes_of(curve, metric)
    }
    return {
        "metrics": METRIC_NAMES,
        "ends": {metric: axis_ends(found, metric) for metric in METRIC_NAMES},
        "looks": {name: look for name, look in lines.items() if name in present},
        "panels": panels,
    }


def statistics_of(curve: Curve, metric: str) -> dict[str, list[float | None]]:
    """Return statistics over lanes, by ascending ā [m]."""
    return {
        name: finite_numbers(values)
        for name, values in zip(
            CURVE_STATISTICS, curve.spread(metric, *CURVE_STATISTICS), strict=True
        )
    }


def slopes_of(curve: Curve, metric: str) -> dict[str, float]:
    """Return the slopes of bounds and fitted lines, per ā."""
    fits = {name: curve.fit(metric, quantile) for name, quantile in FIT_QUANTILES.items()}
    bounds = {BOUND_NAMES[bound]: slope for bound, slope in curve.limits(metric).items()}
    return bounds | {name: fit[0] for name, fit in fits.items() if fit is not None}


def curve_data(found: Quantity, axes: Axes, cells: Sequence[Cell]) -> dict[str, object]:
    """Return a quantity against the key on x, a series for each value of the hue, a panel for each choice of
    the other keys.

    Numbers on x are numbers; other values are places of their names.
    """
    values = ordered_values(cells, axes.x)
    numbers = axes.x is not None and on_a_scale(values)
    hues = ordered_values(cells, axes.hue)
    looks = lines.hue_looks(axes.hue, hues)
    scale: dict[str, object] = {"share": found.share, "log": found.log, "label": found.axis}
    return {
        "x": {
            "key": axes.x,
            "label": "" if axes.x is None else quantity(axes.x),
            "names": None
            if numbers
            else [value_alone(axes.x, each) for each in values]
            if axes.x
            else [""],
            "log": numbers and geometric(values),
        },
        "y": scale | {"name": found.name, "ends": found.ends},
        "confidence": 100 * found.confidence,
        "hue": None if axes.hue is None else key_name(axes.hue),
        "looks": [
            {"name": each.label, "color": page_colour(each.look["color"]), "place": place}
            for place, each in enumerate(looks)
        ],
        "panels": [
            panel_data((cell.number for cell in mine), labels)
            | {
                "series": [
                    series_data(found, each, axes.x, None if numbers else values)
                    for each in by_hue(mine, axes, hues)
                ]
            }
            for labels, mine in panels_of(cells, axes)
        ],
    }


def series_data(
    found: Quantity, cells: Sequence[Cell], x: str | None, values: Sequence[Label] | None
) -> dict[str, object]:
    """Return the points of one series: places on x, value, interval, and numbers of the cells."""
    if x is not None:
        cells = sorted(
            cells, key=lambda cell: values.index(cell.labels[x]) if values else cell.labels[x]
        )
    table = found.values.reindex([cell.number for cell in cells])
    places = [
        0 if x is None else values.index(c.labels[x]) if values else c.labels[x] for c in cells
    ]
    found_numbers = {name: finite_numbers(table[name]) for name in ("value", "low", "high")}
    return {"x": places, "cells": [cell.number for cell in cells], **found_numbers}


def page_colour(colour: object) -> str:
    """Return a colour of a figure as the page's variable, else as a hexadecimal number."""
    names = {getattr(style, name.upper()): f"--{name}" for name in PAGE_COLOURS}
    return names.get(colour, "") if isinstance(colour, str) else to_hex(colour)  # pyright: ignore


def tiles_data(results: Results, tiling: Tiling) -> dict[str, object]:
    """Return the heat map over two swept keys: values, texts, and places on the scale of colours."""
    found: Any = tile_table(results)
    *titled, across = tiling.panels[0] or [""]
    return {
        "rows": [quantity(tiling.row), [value_alone(tiling.row, value) for value in tiling.rows]],
        "columns": [
            quantity(tiling.column),
            [value_alone(tiling.column, value) for value in tiling.columns],
        ],
        "panels": [
            {
                "title": labels_title({key: labels[key] for key in titled}),
                "across": labels_title({key: labels[key] for key in labels if key == across}),
                "cells": numbered.tolist(),
            }
            for labels, numbered in zip(tiling.panels, tiling.cells, strict=True)
        ],
        "metrics": [
            coloured_metric(name, found[name], results.study.cells)
            for name in heat.METRICS
            if found[name].notna().any()
        ],
        "low": finite_numbers(found["unrecovered_low"]),
        "high": finite_numbers(found["unrecovered_high"]),
        "intervals": found["interval"].tolist(),
        "confidence": 100 * confidence_told(results.study.config.samples),
        "share": share_name(results.study.cells),
        "ok": found["ok"].tolist(),
        "failed": {cell: counted(kinds) for cell, kinds in failed_kinds(results).items()},
        "blank": found["blank"].tolist(),
        "palette": heat.palette(),
    }


def coloured_metric(metric: str, values: pd.Series, cells: Sequence[Cell]) -> dict[str, object]:
    """Return a metric of all cells as numbers, as texts, and as places on its scale."""
    norm = heat.colour_scale(metric, values)
    return {
        "name": heat.metric_label(metric, cells),
        "told": "greatest spread" if is_leaderless(cells) else "greatest tail error",
        "unit": "m" if is_leaderless(cells) else "ā",
        "share": metric == "unrecovered",
        "values": finite_numbers(values),
        "words": [tile_text(metric, value) if np.isfinite(value) else "" for value in values],
        "places": finite_numbers(np.ma.filled(norm(values.to_numpy()), np.nan)),
        "ends": np.asarray(norm.inverse([0.0, 1.0])).tolist(),
    }


def searches_data(found: Iterable[Course], words: str) -> dict[str, object]:
    """Return the best value against the number of lanes, for each search and for random lanes."""
    return {
        "words": words,
        "panels": [
            panel_data([each.cell.number], each.cell.labels)
            | {name: finite_numbers(getattr(each, name)) for name in Course._fields[1:-1]}
            | {"bound": each.bound if np.isfinite(each.bound) else None}
            for each in found
        ],
    }


def bands_data(cells: Sequence[Cell], found: Mapping[int, Band]) -> dict[str, object]:
    """Return the bands of ẽ(t), or of the spread without a navigator, a panel per cell."""
    return {
        "label": "spread [m]" if is_leaderless(cells) else "ẽ [m]",
        "ends": bands_span(found),
        "time": pack_numbers(next(iter(found.values())).time),
        "panels": [
            panel_data([number], cells[number].labels)
            | {
                name: pack_numbers(getattr(each, name))
                for name in ("low", "median", "high", "greatest")
            }
            | {"lanes": each.lanes}
            for number, each in found.items()
        ],
    }
