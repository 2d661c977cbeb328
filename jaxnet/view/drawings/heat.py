"""Heat maps over two swept keys: a panel per choice of the other keys, one scale of colours."""

from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LogNorm, Normalize, to_hex, to_rgb

from jaxnet.config.cells import is_leaderless
from jaxnet.config.naming import quantity, value_alone, value_name
from jaxnet.model.wording import count, counted, number_text
from jaxnet.statistics.curves import failed_kinds, log_ends
from jaxnet.statistics.quantities import SPREAD_WORDS
from jaxnet.statistics.recovery import confidence_told
from jaxnet.statistics.tiles import (
    Tiling,
    blank_reasons,
    lost_name,
    tile_notes,
    tile_table,
    tile_text,
)
from jaxnet.store.results import Results
from jaxnet.view.drawings.drawing import Drawing, Panel, Scale, Tiles
from jaxnet.view.drawings.words import error_text

COLOUR_MAP = mpl.colormaps["YlGnBu"]  # ever darker, and told apart by all eyes
PALETTE = [*map(to_hex, COLOUR_MAP(np.linspace(0, 1, 64)))]
METRICS = ("unrecovered", "worst")
BEYOND_COLOURS = "numbers beyond the scale of colours have the colour of its end"


def metric_label(metric: str, results: Results) -> str:
    if metric == "unrecovered":
        return f"lanes {lost_name(results)} [%]"
    alone = is_leaderless(results.study.cells)
    return "greatest spread over the tail [m]" if alone else "greatest tail error / ā"


def heat_drawing(results: Results, tiling: Tiling, metric: str) -> Drawing:
    """Tiles of "unrecovered", on a scale to 100 %, or of "worst", on one of whole decades."""
    found: Any = tile_table(results)
    cells, is_share = results.study.cells, metric == "unrecovered"
    failed = {cell: counted(kinds) for cell, kinds in failed_kinds(results).items()}
    texts, words = [], []
    for cell, row in found.iterrows():
        known, star = bool(np.isfinite(row[metric])), "*" * (cell in failed)
        text = tile_text(metric, row[metric], row["size"]) if known else ""
        texts.append([text + star, row["interval"] * (known and is_share)])
        words.append(tile_words(results, metric, row, failed))
    texts, words = np.array([*texts, ["", ""]]), np.array([*words, "Not run."])
    values = np.append(found[metric].to_numpy(dtype=float), np.nan)
    panels = []
    for labels, numbers in zip(tiling.panels, tiling.cells, strict=True):
        shown, intervals = np.moveaxis(texts[numbers], -1, 0)
        tiles = Tiles(numbers, values[numbers], shown, intervals, words[numbers])
        panels.append(Panel(labels, numbers[numbers >= 0].tolist(), [], tiles=tiles))
    x, y = (
        Scale(quantity(key), names=[value_alone(key, value) for value in each])
        for key, each in ((tiling.column, tiling.columns), (tiling.row, tiling.rows))
    )
    ends = (0.0, 100.0) if is_share else log_ends(values)
    colours = Scale(metric_label(metric, results), ends, log=not is_share).cut(values)
    notes = [*tile_notes(results, tiling.cells, metric)]
    notes += [BEYOND_COLOURS] * (not is_share and bool(np.any(colours.is_beyond(values))))
    notes += [SPREAD_WORDS] * (not is_share and is_leaderless(cells))
    blank = ", ".join(blank_reasons(found, tiling.cells, metric))
    return Drawing(panels, x, y, notes, colours=colours, blank=blank)


def tile_words(results: Results, metric: str, row: Any, failed: Mapping[int, str]) -> str:
    """What a tile tells when it is reached: where, its number, its lanes, and those that failed."""
    cell, cells, value = int(row.name), results.study.cells, row[metric]
    what, many = row["blank"], row["ok"] + row["failed"] * (metric == "unrecovered")
    lanes = f", of {count(int(many), 'lane')}"
    if not np.isfinite(value):
        lanes = ""
    elif metric == "unrecovered":
        low, high = (number_text(row[f"unrecovered_{end}"], whole=100.0) for end in ("low", "high"))
        sure = 100 * confidence_told(results.study.config.samples)
        share = number_text(value, whole=100.0)
        what = f"{share} % {lost_name(results)}, {sure:g} % interval {low} to {high} %"
    elif is_leaderless(cells):
        what = f"greatest spread {error_text(value, row['size'])} m"
    else:
        what = f"greatest tail error {error_text(value)} ā"
    lost = f"failed: {failed[cell]}" if cell in failed else "none failed"
    where = ", ".join(value_name(key, value) for key, value in cells[cell].labels.items())
    return f"{where} (cell {cell}): {what}{lanes}; {lost}."


def colour_norm(scale: Scale) -> Normalize:
    """From a number to its place on the scale of colours."""
    assert scale.ends is not None
    low, high = scale.ends
    return LogNorm(low, min(high, scale.top), clip=True) if scale.log else Normalize(low, high)


def text_colour(colour: str) -> str:
    """Black or white, whichever contrasts more; the contrast is at least 4.58 (WCAG 2.2)."""
    levels = np.array(to_rgb(colour))
    linear = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    return "black" if linear @ (0.2126, 0.7152, 0.0722) > 0.179 else "white"
