"""Axes in print: small multiples with common axes, ticks, notes, legends.

Small multiples are a panel per group of cells; the first swept key chooses the row.
"""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.cbook import is_math_text
from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import MathTextParser
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from jaxnet.statistics.curves import MOST_PANELS
from jaxnet.statistics.groups import Label
from jaxnet.view.drawings.words import distinct_titles
from jaxnet.view.figures import style
from jaxnet.view.figures.style import Figure

Labels = Mapping[str, Label]  # swept values of a panel or row, by key

PANEL_HEIGHT = 1.45  # [in]
PANELS_PER_ROW = 4  # panels in a row across two columns
ROW_HEIGHT, LINE_HEIGHT = 0.28, 0.13  # [in] of a named row at least, and of each line of its name
AXIS_ROOM = 0.7  # [in] for axis and legend
LETTERS_PER_INCH = 17  # of a note
TITLE_LETTERS_PER_INCH, LABEL_ROOM = 15.5, 0.4  # of a panel's title; [in] for the label of the rows
LETTERS_PER_PANEL = 18  # of a line along a panel's height


def panel_columns(labels: Sequence[Labels], most: int = PANELS_PER_ROW) -> int:
    """Panels in a row; panels that share the first swept value stay together."""
    firsts = [next(iter(each.values()), None) for each in labels]
    run = firsts.count(firsts[0])
    return run if 2 <= run <= most and len(firsts) % run == 0 else min(len(firsts), most)


def log_ticks(axis: Axis) -> None:
    """Set ticks of a log axis with fixed ends; short axes get ticks within a decade."""
    low, high = sorted(axis.get_view_interval())
    decades = np.log10(high / low)
    if decades >= 2:
        axis.set_minor_locator(NullLocator())
        return
    if decades >= 0.7:  # so that two of the numbers are there at least
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if decades <= 1 else (1, 3)))
    else:
        axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.4g}"))
    axis.set_minor_formatter(NullFormatter())


def log_axis(panel: Axes, letter: str, ends: tuple[float, float] | None = None) -> None:
    """Make an axis of a panel, x or y, a log axis with its ticks."""
    panel.set(**{f"{letter}scale": "log"})
    if ends is None:
        panel.autoscale_view()
    else:
        panel.set(**{f"{letter}lim": ends})
    log_ticks(panel.xaxis if letter == "x" else panel.yaxis)


def escape_dollars(words: str) -> str:
    return words.replace("$", r"\$")


def wrapped(words: str, letters: int | float) -> str:
    """Wrap words to lines of so many letters; dollar signs are no formula."""
    return textwrap.fill(escape_dollars(words), max(1, int(letters)))


def show_unparsed(drawn: Figure) -> None:
    """Have a figure show text as it is where matplotlib cannot read it as a formula."""
    parser = MathTextParser("path")
    for text in drawn.findobj(Text):
        try:
            for line in text.get_text().split("\n"):
                if is_math_text(line):
                    parser.parse(line)
        except (ValueError, RecursionError):
            text.set_parse_math(False)


def write_left_out(drawn: Figure, *parts: tuple[int, int, str], where: str) -> None:
    """Write how many items of each kind are drawn, if some are not, and where all are stored."""
    lacking = [f"{shown:,} of {there:,} {noun}" for shown, there, noun in parts if shown < there]
    if lacking:
        write_note(drawn, f"{' and '.join(lacking)} are drawn; all are in {where}")


def write_note(drawn: Figure, words: str) -> None:
    """Append a note to the small line above all panels."""
    told = "; ".join(filter(None, [drawn.get_suptitle().replace("\n", " "), words]))
    lines = textwrap.fill(told, int(1.1 * LETTERS_PER_INCH * drawn.get_figwidth()))
    drawn.suptitle(lines, x=0.01, ha="left", fontsize=7)


def write_legend(drawn: Figure, handles: Sequence[Any], most: int, **look: Any) -> None:
    """Write a legend below the panels, of `most` columns where the figure is as wide as a page."""
    columns = max(2, round(most * drawn.get_figwidth() / style.FIGURE_WIDTH))
    look = {"ncols": columns, "handlelength": 2.6} | look
    drawn.legend(handles=handles, loc="outside lower center", **look)


def panels_across(width: float) -> int:
    return max(1, round(PANELS_PER_ROW * width / style.FIGURE_WIDTH))


def panels_fitting(
    labels: Sequence[Labels], width: float, height: float = PANEL_HEIGHT, most: int | None = None
) -> int:
    """How many panels fit a page, in whole rows of at most `most` panels, at least one row."""
    rows = max(1, int((style.GREATEST_HEIGHT - AXIS_ROOM) / height))
    return min(len(labels), MOST_PANELS, rows * panel_columns(labels, most or panels_across(width)))


def panel_grid(
    labels: Sequence[Labels],
    x: str,
    y: str,
    width: float,
    height: float = PANEL_HEIGHT,
    most: int | None = None,
    margin: float = 0.0,
) -> tuple[Figure, list[Axes]]:
    """Return a figure with a titled panel per label, at most `most` in a row, and its panels.

    Titles and axis labels are wrapped to a panel's share of the width without the margin [in].
    """
    across = panel_columns(labels, most or panels_across(width))
    rows = -(-len(labels) // across)
    drawn = Figure(figsize=(width, height * rows + AXIS_ROOM))
    titles, common = distinct_titles(labels)
    write_note(drawn, escape_dollars(common))
    grid = drawn.subplots(rows, across, sharex=True, sharey=True, squeeze=False).ravel().tolist()
    letters = TITLE_LETTERS_PER_INCH * (width - margin - LABEL_ROOM) / across
    for panel, named in zip(grid, titles, strict=False):
        panel.set_title(wrapped(named, letters), pad=3, fontsize=7.5)
        panel.grid(True, color="0.92", linewidth=0.5)
        panel.set_axisbelow(True)
    for number, panel in enumerate(grid[len(labels) :], len(labels)):
        panel.axis("off")
        grid[number - across].tick_params(labelbottom=True)
    larger = type_scale("axes.labelsize")
    beside = textwrap.fill(y, int(LETTERS_PER_PANEL / larger))
    for panel in grid[::across]:
        panel.set_ylabel(beside)
    more = (larger - 1) * LABEL_ROOM + LINE_HEIGHT * larger * beside.count("\n") * (larger > 1)
    fitting = int((int(letters) - TITLE_LETTERS_PER_INCH * more / across) / larger)
    below = textwrap.fill(x, max(1, fitting))
    for panel in grid[max(0, len(labels) - across) : len(labels)]:
        panel.set_xlabel(below)
    return drawn, grid[: len(labels)]


def type_scale(setting: str) -> float:
    """How much larger the type of a setting of matplotlib is now than in the style for print."""
    now: Any = mpl.rcParams
    points = FontProperties(size=now[setting]).get_size_in_points()
    return float(points / style.PRINT_STYLE[setting])
