"""Cells over two swept keys as tiles: a panel for each value of the others, all on one scale of colours."""

import textwrap
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from jaxtyping import Int
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize, to_hex, to_rgb
from matplotlib.patches import Patch, Rectangle

from jaxnet.config.naming import quantity, value_alone
from jaxnet.statistics.curves import decades
from jaxnet.statistics.tiles import ROUNDING, Tiling, blanks, digits, notes, outcomes
from jaxnet.store.results import Results
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

COLOURS = mpl.colormaps["YlGnBu"]  # ever darker, and told apart by all eyes
METRICS = {"unrecovered": "lanes unrecovered [%]", "worst": "greatest tail error / ā"}
ROOMY, TIGHT = (0.36, 0.26), (0.24, 0.17)  # [in] of a tile with its interval, and without it
LEGIBLE = 0.2, 0.1  # [in] of a tile whose number can be read
LETTER = 0.055  # [in] of a row's name
TITLE, SPARE = 0.3, 0.35  # [in] for a panel's title, and for the scale of colours
HATCHED: dict[str, Any] = {"facecolor": "white", "edgecolor": "0.6", "hatch": "/////", "linewidth": 0}


class Look(NamedTuple):
    """What all panels share."""

    found: pd.DataFrame  # outcomes by cell
    metric: str
    norm: Normalize
    numbers: bool  # whether tiles have room for them, and for intervals
    intervals: bool


def ink(colour: Any) -> str:
    """Black or white, whichever is read better on a colour: with a contrast of 4.58 at least (WCAG 2.2)."""
    levels = np.array(to_rgb(colour))
    linear = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    return "black" if linear @ (0.2126, 0.7152, 0.0722) > 0.179 else "white"


def palette() -> list[tuple[str, str]]:
    """The scale from its low end, with the ink on each colour."""
    return [(to_hex(colour), ink(colour)) for colour in COLOURS(np.linspace(0, 1, 64))]


def scale(metric: str, values: pd.Series) -> Normalize:
    """All shares that there can be, or the powers of ten around the errors."""
    if metric == "unrecovered":
        return Normalize(0, 100)
    known = values.dropna().clip(lower=ROUNDING)
    return LogNorm(*decades(known.min(), known.max()), clip=True)


def figure(results: Results, tiles: Tiling, metric: str, width: float = style.WIDTH) -> Figure:
    """Tiles with their numbers, with intervals if these leave room for all panels; else the first of them."""
    names = [in_lines(tiles.row, value, int(multiples.LETTERS * width / 3)) for value in tiles.rows]
    lines = [name.split("\n") for name in names]
    margin = 0.35 + LETTER * max(len(line) for each in lines for line in each)
    tallest = multiples.LINE * max(map(len, lines))
    _, down, along = tiles.cells.shape
    for size in (ROOMY, TIGHT):
        most = max(1, int((width - margin) / (size[0] * along + 0.1)))
        height = min(max(size[1], tallest) * down + TITLE, style.TALLEST - SPARE - multiples.HEADING)
        shown = multiples.room(tiles.panels, width, height, most)
        if shown == len(tiles.panels):
            break
    tile = (width - margin) / multiples.columns(tiles.panels[:shown], most) / along, (height - TITLE) / down
    legible, wide = (all(np.greater_equal(tile, least)) for least in (LEGIBLE, ROOMY))
    found: Any = outcomes(results)
    look = Look(found, metric, scale(metric, found[metric]), legible, wide and metric == "unrecovered")
    axes = quantity(tiles.column), quantity(tiles.row)
    drawn, panels = multiples.panels(tiles.panels[:shown], *axes, width, height, most, margin)
    drawn.set_figheight(min(style.TALLEST, drawn.get_figheight() + SPARE))
    for panel, numbers in zip(panels, tiles.cells, strict=False):
        draw_tiles(panel, numbers, look)
    panels[0].set_xticks(0.5 + np.arange(along), [in_lines(tiles.column, each, 12) for each in tiles.columns])
    panels[0].set_yticks(0.5 + np.arange(down), names)
    bar = ScalarMappable(look.norm, COLOURS)
    drawn.colorbar(bar, ax=drawn.axes, location="bottom", aspect=50, shrink=0.7, label=METRICS[metric])
    annotate(drawn, results, tiles.cells[:shown], look)
    multiples.note_left_out(drawn, (shown, len(tiles.panels), "panels"), where="cells.csv")
    return drawn


def in_lines(key: str, value: Any, letters: int) -> str:
    """A swept value beside its axis, in lines of so many letters."""
    return textwrap.fill(multiples.as_text(value_alone(key, value)), letters)


def draw_tiles(panel: Axes, numbers: Int[np.ndarray, "rows columns"], look: Look) -> None:
    """One panel; hatched where there is nothing to tell."""
    down, along = numbers.shape
    panel.add_patch(Rectangle((0, 0), along, down, **HATCHED))
    rows = look.found.reindex(numbers.ravel())
    values = np.ma.masked_invalid(rows[look.metric].to_numpy().reshape(numbers.shape))
    panel.pcolormesh(values, cmap=COLOURS, norm=look.norm, edgecolors="white", linewidth=0.5)
    panel.set(xlim=(0, along), ylim=(down, 0))
    panel.grid(False)
    panel.tick_params(length=0)
    panel.spines[:].set_visible(False)
    if look.numbers:
        for place, (_, row) in enumerate(rows.iterrows()):
            write(panel, (0.5 + place % along, 0.5 + place // along), row, look)


def write(panel: Axes, place: tuple[float, float], row: Any, look: Look) -> None:
    """A tile's number, a star if lanes of it failed, and its interval beneath."""
    value, star = row[look.metric], "*" if row["failed"] > 0 else ""
    if np.isnan(value):
        panel.text(*place, star, fontsize=6, ha="center", va="center")
        return
    drawn: Any = {"ha": "center", "color": ink(COLOURS(look.norm(value)))}
    if look.intervals:
        panel.text(*place, row["interval"], fontsize=5, va="top", **drawn)
    words = f"{digits(look.metric, value)}{star}"
    panel.text(*place, words, fontsize=6, va="bottom" if look.intervals else "center", **drawn)


def annotate(drawn: Figure, results: Results, numbers: Int[np.ndarray, "..."], look: Look) -> None:
    """Have a figure say how sure its numbers are, and what is hatched."""
    for words in notes(results, numbers, look.metric):
        multiples.note(drawn, words)
    if reasons := blanks(look.found, numbers):
        drawn.legend(handles=[Patch(label=", ".join(reasons), **HATCHED)], loc="outside lower right")
