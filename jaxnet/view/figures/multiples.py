"""Small multiples: a panel per group of cells on common axes; the first swept key chooses the row."""

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

from jaxnet.config.naming import labels_title
from jaxnet.statistics.curves import MOST_PANELS
from jaxnet.statistics.groups import Label
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
    """Return the number of panels in a row; panels that share the first swept value stay together."""
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


def escape_dollars(words: str) -> str:
    """Escape dollar signs, so that matplotlib reads no formula."""
    return words.replace("$", r"\$")


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
    wrapped = textwrap.fill(told, int(1.1 * LETTERS_PER_INCH * drawn.get_figwidth()))
    drawn.suptitle(wrapped, x=0.01, ha="left", fontsize=7)


def drop_note(drawn: Figure) -> None:
    """Take the small line above all panels away, and its room."""
    drawn.suptitle("").set_in_layout(False)


def shared_labels(labels: Sequence[Labels]) -> Labels:
    """Return the labels that all panels share; a single panel shares none."""
    if len(labels) < 2:
        return {}
    return {
        key: value for key, value in labels[0].items() if all(value == each[key] for each in labels)
    }


def distinct_titles(labels: Sequence[Labels]) -> list[str]:
    """Return a title for each panel from the labels that differ between panels."""
    common = shared_labels(labels)
    return [
        labels_title({key: value for key, value in each.items() if key not in common})
        for each in labels
    ]


def write_shared_labels(drawn: Figure, labels: Sequence[Labels]) -> None:
    """Write the labels that all panels or rows share, if there are several."""
    if common := shared_labels(labels):
        write_note(drawn, f"all with {escape_dollars(labels_title(common))}")


def panels_across(width: float) -> int:
    """Return the greatest number of panels in a row for a width [in]."""
    return max(1, round(PANELS_PER_ROW * width / style.FIGURE_WIDTH))


def panels_fitting(
    labels: Sequence[Labels], width: float, height: float = PANEL_HEIGHT, most: int | None = None
) -> int:
    """Return how many panels fit a page, in whole rows of at most `most` panels."""
    rows = int((style.GREATEST_HEIGHT - AXIS_ROOM) / height)
    return min(len(labels), MOST_PANELS, rows * panel_columns(labels, most or panels_across(width)))


def legend_columns(width: float, most: int) -> int:
    """Return the number of legend columns for a width [in]; `most` is for two columns of a journal."""
    return max(2, round(most * width / style.FIGURE_WIDTH))


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
    write_shared_labels(drawn, labels)
    grid = drawn.subplots(rows, across, sharex=True, sharey=True, squeeze=False).ravel().tolist()
    letters = int(TITLE_LETTERS_PER_INCH * (width - margin - LABEL_ROOM) / across)
    for panel, named in zip(grid, distinct_titles(labels), strict=False):
        panel.set_title(textwrap.fill(escape_dollars(named), letters), pad=3, fontsize=7.5)
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
    fitting = int((letters - TITLE_LETTERS_PER_INCH * more / across) / larger)
    below = textwrap.fill(x, max(1, fitting))
    for panel in grid[max(0, len(labels) - across) : len(labels)]:
        panel.set_xlabel(below)
    return drawn, grid[: len(labels)]


def type_scale(setting: str) -> float:
    """Return how much larger the type of a setting of matplotlib is now than in the style for print."""
    now: Any = mpl.rcParams
    return float(
        FontProperties(size=now[setting]).get_size_in_points() / style.PRINT_STYLE[setting]
    )


def row_heights(labels: Sequence[Labels], width: float) -> tuple[list[str], np.ndarray]:
    """Return row names, wrapped to about a third of the width, and the height of each row [in]."""
    names = [
        textwrap.fill(escape_dollars(name), int(LETTERS_PER_INCH * width / 2.8))
        for name in distinct_titles(labels)
    ]
    return names, np.array(
        [max(ROW_HEIGHT, LINE_HEIGHT * (1 + name.count("\n"))) for name in names]
    )


def rows_fitting(labels: Sequence[Labels], width: float, most: int) -> int:
    """Return how many of the first `most` rows fit a page."""
    heights = np.maximum.accumulate(
        row_heights(labels[:most], width)[1]
    )  # all are as high as the highest
    return int(
        np.count_nonzero(heights * np.arange(1, len(heights) + 1) <= style.GREATEST_HEIGHT - 1.0)
    )


def named_rows(labels: Sequence[Labels], width: float) -> tuple[Figure, Axes]:
    """Return a figure with one panel that has a named row per label, from the top down."""
    names, heights = row_heights(labels, width)
    drawn = Figure(figsize=(width, heights.max() * len(labels) + 1.0))
    write_shared_labels(drawn, labels)
    panel = drawn.add_subplot()
    panel.set_yticks(range(len(names)) if any(names) else [], names if any(names) else [])
    panel.set_ylim(len(names) - 0.4, -0.6)
    panel.grid(True, axis="x", color="0.9", linewidth=0.5)
    return drawn, panel


def axis_name(words: str, width: float) -> str:
    """Return the label of a wide axis, wrapped to most of the width [in]."""
    return textwrap.fill(words, int(0.6 * LETTERS_PER_INCH * width))
