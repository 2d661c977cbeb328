"""Heat maps over two swept keys: a panel for each choice of the other keys, one scale of colours."""

import math
import textwrap
from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from jaxtyping import Int
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize, to_hex, to_rgb
from matplotlib.patches import Patch, Rectangle

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.naming import quantity, value_alone
from jaxnet.statistics.curves import decades
from jaxnet.statistics.groups import Label
from jaxnet.statistics.quantities import SPREAD_WORDS
from jaxnet.statistics.recovery import share_name
from jaxnet.statistics.tiles import (
    NEGLIGIBLE_ERROR,
    Tiling,
    blank_reasons,
    tile_notes,
    tile_table,
    tile_text,
)
from jaxnet.store.results import Results
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

COLOUR_MAP = mpl.colormaps["YlGnBu"]  # ever darker, and told apart by all eyes
METRICS = ("unrecovered", "worst")
TILE_WITH_INTERVAL, TILE_ALONE = (
    (0.36, 0.26),
    (0.24, 0.17),
)  # [in] of a tile with its interval, and without it
LEAST_TILE = 0.2, 0.1  # [in] of a tile whose number can be read
DIGIT_WIDTH, TILE_PAD = 0.05, 0.04  # [in] of a letter in a tile, and of what is beside its number
LETTER_WIDTH = 0.055  # [in] of a row's name
TITLE_ROOM, COLOUR_BAR_ROOM = 0.3, 0.35  # [in] for a panel's title, and for the scale of colours
HATCHED_STYLE: dict[str, Any] = {
    "facecolor": "white",
    "edgecolor": "0.6",
    "hatch": "/////",
    "linewidth": 0,
}


class Tile(NamedTuple):
    """What stands in a tile; not-a-number where the cell has no value, or where there is no cell."""

    value: float
    failed: float  # lanes
    interval: str


class TileStyle(NamedTuple):
    """Data and scale that all panels of a heat map share."""

    found: pd.DataFrame  # outcomes by cell
    metric: str
    norm: Normalize
    numbers: bool  # whether tiles have room for them, and for intervals
    intervals: bool
    whole: bool  # whether tiles have room for the digits of tables


def metric_label(metric: str, cells: Sequence[Cell]) -> str:
    """Return a metric of these cells in words, with its unit."""
    if metric == "unrecovered":
        return f"lanes {share_name(cells)} [%]"
    return (
        "greatest spread over the tail [m]" if is_leaderless(cells) else "greatest tail error / ā"
    )


def text_colour(colour: str) -> str:
    """Return black or white, whichever contrasts more; the contrast is at least 4.58 (WCAG 2.2)."""
    levels = np.array(to_rgb(colour))
    linear = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    return "black" if linear @ (0.2126, 0.7152, 0.0722) > 0.179 else "white"


def palette() -> list[tuple[str, str]]:
    """Return 64 colours of the scale from its low end, each with its text colour."""
    return [
        (colour, text_colour(colour)) for colour in map(to_hex, COLOUR_MAP(np.linspace(0, 1, 64)))
    ]


def colour_scale(metric: str, values: pd.Series) -> Normalize:
    """Return a scale from 0 to 100 % for shares, or over whole decades for errors."""
    if metric == "unrecovered":
        return Normalize(0, 100)
    known = values.dropna().clip(lower=NEGLIGIBLE_ERROR)
    return LogNorm(*decades(known.min(), known.max()), clip=True)


def heat_figure(
    results: Results, tiles: Tiling, metric: str, width: float = style.FIGURE_WIDTH
) -> Figure:
    """Draw tiles at the largest size that fits all panels; omit intervals, then panels, for space."""
    names = [
        wrap_value(tiles.row, value, int(multiples.LETTERS_PER_INCH * width / 3))
        for value in tiles.rows
    ]
    lines = [name.split("\n") for name in names]
    margin = 0.35 + LETTER_WIDTH * max(len(line) for each in lines for line in each)
    tallest = multiples.LINE_HEIGHT * max(map(len, lines))
    _, down, along = tiles.cells.shape
    for size in (TILE_WITH_INTERVAL, TILE_ALONE):
        most = max(1, int((width - margin) / (size[0] * along + 0.1)))
        height = min(
            max(size[1], tallest) * down + TITLE_ROOM,
            style.GREATEST_HEIGHT - COLOUR_BAR_ROOM - multiples.AXIS_ROOM,
        )
        shown = multiples.panels_fitting(tiles.panels, width, height, most)
        if shown == len(tiles.panels):
            break
    tile = (
        (width - margin) / multiples.panel_columns(tiles.panels[:shown], most) / along,
        (height - TITLE_ROOM) / down,
    )
    legible, wide = (
        all(np.greater_equal(tile, least)) for least in (LEAST_TILE, TILE_WITH_INTERVAL)
    )
    found: Any = tile_table(results)
    intervals = wide and metric == "unrecovered"
    scale = colour_scale(metric, found[metric])
    shares = found["unrecovered"].reindex(tiles.cells[:shown].ravel()).dropna()
    longest = max((len(tile_text("unrecovered", each, whole=True)) for each in shares), default=0)
    whole = DIGIT_WIDTH * longest + TILE_PAD <= tile[0]
    look = TileStyle(found, metric, scale, legible, intervals, whole)
    axes = quantity(tiles.column), quantity(tiles.row)
    drawn, panels = multiples.panel_grid(tiles.panels[:shown], *axes, width, height, most, margin)
    drawn.set_figheight(min(style.GREATEST_HEIGHT, drawn.get_figheight() + COLOUR_BAR_ROOM))
    for panel, numbers in zip(panels, tiles.cells, strict=False):
        draw_tiles(panel, numbers, look)
    panels[0].set_xticks(
        0.5 + np.arange(along), [wrap_value(tiles.column, each, 12) for each in tiles.columns]
    )
    panels[0].set_yticks(0.5 + np.arange(down), names)
    bar = ScalarMappable(look.norm, COLOUR_MAP)
    words = metric_label(metric, results.study.cells)
    drawn.colorbar(bar, ax=drawn.axes, location="bottom", aspect=50, shrink=0.7, label=words)
    annotate(drawn, results, tiles.cells[:shown], look)
    multiples.write_left_out(drawn, (shown, len(tiles.panels), "panels"), where="cells.csv")
    return drawn


def wrap_value(key: str, value: Label, letters: int) -> str:
    """Return a swept value as an axis label, wrapped to so many letters a line."""
    return textwrap.fill(multiples.escape_dollars(value_alone(key, value)), letters)


def draw_tiles(panel: Axes, numbers: Int[np.ndarray, "rows columns"], look: TileStyle) -> None:
    """Draw one panel; tiles without a value are hatched."""
    down, along = numbers.shape
    panel.add_patch(Rectangle((0, 0), along, down, **HATCHED_STYLE))
    rows = look.found.reindex(numbers.ravel())
    values = np.ma.masked_invalid(rows[look.metric].to_numpy().reshape(numbers.shape))
    panel.pcolormesh(values, cmap=COLOUR_MAP, norm=look.norm, edgecolors="white", linewidth=0.5)
    panel.set(xlim=(0, along), ylim=(down, 0))
    panel.grid(False)
    panel.tick_params(length=0)
    panel.spines[:].set_visible(False)
    if look.numbers:
        columns = rows[look.metric], rows["failed"], rows["interval"].fillna("")
        for place, tile in enumerate(map(Tile, *columns)):
            write_tile(panel, (0.5 + place % along, 0.5 + place // along), tile, look)


def write_tile(panel: Axes, place: tuple[float, float], tile: Tile, look: TileStyle) -> None:
    """Write a tile's number, a star if some of its lanes failed, and its interval."""
    value, star = tile.value, "*" if tile.failed > 0 else ""
    if math.isnan(value):
        panel.text(*place, star, fontsize=6, ha="center", va="center")
        return
    drawn: Any = {"ha": "center", "color": text_colour(to_hex(COLOUR_MAP(look.norm(value))))}
    if look.intervals:
        panel.text(*place, tile.interval, fontsize=5, va="top", **drawn)
    words = f"{tile_text(look.metric, value, look.whole)}{star}"
    panel.text(*place, words, fontsize=6, va="bottom" if look.intervals else "center", **drawn)


def annotate(
    drawn: Figure, results: Results, numbers: Int[np.ndarray, "..."], look: TileStyle
) -> None:
    """Add notes on the intervals and a legend of the hatched tiles."""
    spread = [SPREAD_WORDS] * (look.metric == "worst" and is_leaderless(results.study.cells))
    for words in [*tile_notes(results, numbers, look.metric), *spread]:
        multiples.write_note(drawn, words)
    if reasons := blank_reasons(look.found, numbers, look.metric):
        drawn.legend(
            handles=[Patch(label=", ".join(reasons), **HATCHED_STYLE)], loc="outside lower right"
        )
