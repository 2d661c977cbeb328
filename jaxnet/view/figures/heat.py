"""Heat maps over two swept keys: a panel per choice of the other keys, one scale of colours."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize, to_hex, to_rgb
from matplotlib.patches import Patch, Rectangle

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.naming import quantity, value_alone
from jaxnet.statistics.curves import decades
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
TILE_WITH_INTERVAL, TILE_ALONE = (0.36, 0.26), (0.24, 0.17)  # [in]
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


def metric_label(metric: str, cells: Sequence[Cell]) -> str:
    if metric == "unrecovered":
        return f"lanes {share_name(cells)} [%]"
    return (
        "greatest spread over the tail [m]" if is_leaderless(cells) else "greatest tail error / ā"
    )


def text_colour(colour: str) -> str:
    """Black or white, whichever contrasts more; the contrast is at least 4.58 (WCAG 2.2)."""
    levels = np.array(to_rgb(colour))
    linear = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    return "black" if linear @ (0.2126, 0.7152, 0.0722) > 0.179 else "white"


def palette() -> list[tuple[str, str]]:
    """64 colours of the scale from its low end, each with its text colour."""
    colours = map(to_hex, COLOUR_MAP(np.linspace(0, 1, 64)))
    return [(colour, text_colour(colour)) for colour in colours]


def colour_scale(metric: str, values: pd.Series) -> Normalize:
    """A scale from 0 to 100 % for shares, or over whole decades for errors."""
    if metric == "unrecovered":
        return Normalize(0, 100)
    known = values.dropna().clip(lower=NEGLIGIBLE_ERROR)
    return LogNorm(*decades(known.min(), known.max()), clip=True)


def heat_figure(
    results: Results, tiles: Tiling, metric: str, width: float = style.FIGURE_WIDTH
) -> Figure:
    """Draw tiles at the largest size that fits; omit intervals, then panels, for space."""
    letters = multiples.LETTERS_PER_INCH * width / 3
    names = [multiples.wrapped(value_alone(tiles.row, each), letters) for each in tiles.rows]
    lines = [name.split("\n") for name in names]
    margin = 0.35 + LETTER_WIDTH * max(len(line) for each in lines for line in each)
    tallest = multiples.LINE_HEIGHT * max(map(len, lines))
    greatest = style.GREATEST_HEIGHT - COLOUR_BAR_ROOM - multiples.AXIS_ROOM
    _, down, along = tiles.cells.shape
    for size in (TILE_WITH_INTERVAL, TILE_ALONE):
        most = max(1, int((width - margin) / (size[0] * along + 0.1)))
        height = min(max(size[1], tallest) * down + TITLE_ROOM, greatest)
        shown = multiples.panels_fitting(tiles.panels, width, height, most)
        if shown == len(tiles.panels):
            break
    few = tiles.panels[:shown]
    across = (width - margin) / multiples.panel_columns(few, most) / along
    tile = across, (height - TITLE_ROOM) / down
    axes = quantity(tiles.column), quantity(tiles.row)
    drawn, panels = multiples.panel_grid(few, *axes, width, height, most, margin)
    drawn.set_figheight(min(style.GREATEST_HEIGHT, drawn.get_figheight() + COLOUR_BAR_ROOM))
    found: Any = tile_table(results)
    numbers = tiles.cells[:shown]
    norm = colour_scale(metric, found[metric])
    words = texts_of_tiles(found.reindex(numbers.ravel()), metric, tile)
    for panel, mine, texts in zip(panels, numbers, words.reshape(*numbers.shape, 2), strict=True):
        values = found[metric].reindex(mine.ravel()).to_numpy().reshape(mine.shape)
        draw_tiles(panel, values, texts, norm)
    columns = [multiples.wrapped(value_alone(tiles.column, each), 12) for each in tiles.columns]
    panels[0].set_xticks(0.5 + np.arange(along), columns)
    panels[0].set_yticks(0.5 + np.arange(down), names)
    bar, label = ScalarMappable(norm, COLOUR_MAP), metric_label(metric, results.study.cells)
    drawn.colorbar(bar, ax=drawn.axes, location="bottom", aspect=50, shrink=0.7, label=label)
    spread = [SPREAD_WORDS] * (metric == "worst" and is_leaderless(results.study.cells))
    for note in [*tile_notes(results, numbers, metric), *spread]:
        multiples.write_note(drawn, note)
    if reasons := blank_reasons(found, numbers, metric):
        hatched = Patch(label=", ".join(reasons), **HATCHED_STYLE)
        drawn.legend(handles=[hatched], loc="outside lower right")
    multiples.write_left_out(drawn, (shown, len(tiles.panels), "panels"), where="cells.csv")
    return drawn


def texts_of_tiles(found: pd.DataFrame, metric: str, tile: tuple[float, float]) -> np.ndarray:
    """The number of each tile, with a star if some of its lanes failed, and its interval.

    Small tiles have no interval, and no number where none could be read.
    """
    legible, wide = (all(np.greater_equal(tile, each)) for each in (LEAST_TILE, TILE_WITH_INTERVAL))
    shares = found["unrecovered"].dropna()
    longest = max((len(tile_text("unrecovered", each, whole=True)) for each in shares), default=0)
    whole = DIGIT_WIDTH * longest + TILE_PAD <= tile[0]
    texts = []
    for value, failed, interval in zip(
        found[metric], found["failed"], found["interval"], strict=True
    ):
        known = not np.isnan(value)
        number = tile_text(metric, value, whole) if known else ""
        told = interval if known and wide and metric == "unrecovered" else ""
        texts.append((f"{number}{'*' * (failed > 0)}" if legible else "", told if legible else ""))
    return np.array(texts, dtype=object)


def draw_tiles(panel: Axes, values: np.ndarray, texts: np.ndarray, norm: Normalize) -> None:
    """Draw one panel; tiles without a value are hatched."""
    down, along = values.shape
    panel.add_patch(Rectangle((0, 0), along, down, **HATCHED_STYLE))
    shown = np.ma.masked_invalid(values)
    panel.pcolormesh(shown, cmap=COLOUR_MAP, norm=norm, edgecolors="white", linewidth=0.5)
    panel.set(xlim=(0, along), ylim=(down, 0))
    panel.grid(False)
    panel.tick_params(length=0)
    panel.spines[:].set_visible(False)
    for (row, column), value in np.ndenumerate(values):
        number, interval = texts[row, column]
        ink = "black" if np.isnan(value) else text_colour(to_hex(COLOUR_MAP(norm(value))))
        look: dict[str, Any] = {"ha": "center", "color": ink}
        place = column + 0.5, row + 0.5
        if interval:
            panel.text(*place, interval, fontsize=5, va="top", **look)
        panel.text(*place, number, fontsize=6, va="bottom" if interval else "center", **look)
