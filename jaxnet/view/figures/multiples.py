"""Small multiples: a panel per group of cells, all on the same axes, rows by the first swept key."""

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from jaxnet.config.naming import labels_title
from jaxnet.statistics.curves import MOST_PANELS
from jaxnet.view.figures import style
from jaxnet.view.figures.style import Figure

PANEL_HEIGHT = 1.45  # [in]
ACROSS = 4  # panels in a row across two columns
ROW_HEIGHT, LINE = 0.28, 0.13  # [in] of a named row at least, and of each line of its name
HEADING = 0.7  # [in] for axis and legend
LETTERS = 17  # of a title, an inch
Y_LETTERS = 18  # of a line along a panel's height


def columns(labels: Sequence[dict[str, Any]], most: int = ACROSS) -> int:
    """How many panels stand in a row: those that share the first swept value, if they are few."""
    firsts = [next(iter(each.values()), None) for each in labels]
    run = firsts.count(firsts[0])
    return run if 2 <= run <= most and len(firsts) % run == 0 else min(len(firsts), most)


def log_ticks(axis: Axis) -> None:
    """Have numbers on a log axis whose ends are settled: where it has few decades also between them."""
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


def as_text(words: str) -> str:
    """Words in which matplotlib finds no formula."""
    return words.replace("$", r"\$")


def note_left_out(drawn: Figure, *parts: tuple[int, int, str], where: str) -> None:
    """Have a figure say how many it shows of how many there are, if not all, and where they are."""
    lacking = [f"{shown:,} of {there:,} {noun}" for shown, there, noun in parts if shown < there]
    if lacking:
        note(drawn, f"{' and '.join(lacking)} are drawn; all are in {where}")


def note(drawn: Figure, words: str) -> None:
    """Write a small line above all panels, after what stands there already."""
    told = "; ".join(filter(None, [drawn.get_suptitle().replace("\n", " "), words]))
    wrapped = textwrap.fill(told, int(1.1 * LETTERS * drawn.get_figwidth()))
    drawn.suptitle(wrapped, x=0.01, ha="left", fontsize=7)


def shared_labels(labels: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What several labels have in common, and so need not say each; one alone says all of its own."""
    if len(labels) < 2:
        return {}
    return {key: value for key, value in labels[0].items() if all(value == each[key] for each in labels)}


def told_apart(labels: Sequence[dict[str, Any]]) -> list[str]:
    """A name of each by what tells it from the others."""
    common = shared_labels(labels)
    return [labels_title({key: value for key, value in each.items() if key not in common}) for each in labels]


def note_shared(drawn: Figure, labels: Sequence[dict[str, Any]]) -> None:
    """Have a figure say what its panels or rows have in common, if they are several."""
    if common := shared_labels(labels):
        note(drawn, f"all with {as_text(labels_title(common))}")


def panels_across(width: float) -> int:
    """Panels that stand in a row at most."""
    return max(1, round(ACROSS * width / style.WIDTH))


def room(
    labels: Sequence[dict[str, Any]], width: float, height: float = PANEL_HEIGHT, most: int | None = None
) -> int:
    """How many of these panels a page has room for: whole rows of them, of so many at most."""
    rows = int((style.TALLEST - HEADING) / height)
    return min(len(labels), MOST_PANELS, rows * columns(labels, most or panels_across(width)))


def legend_columns(width: float, most: int) -> int:
    """Entries of a legend side by side."""
    return max(2, round(most * width / style.WIDTH))


def panels(
    labels: Sequence[dict[str, Any]],
    x: str,
    y: str,
    width: float,
    height: float = PANEL_HEIGHT,
    most: int | None = None,
    margin: float = 0.0,
) -> tuple[Figure, list[Axes]]:
    """A figure with a titled panel for each of these labels, `most` in a row, its outer axes named.

    Words above and below a panel are wrapped to its share of the width without the margin [in].
    """
    across = columns(labels, most or panels_across(width))
    rows = -(-len(labels) // across)
    drawn = Figure(figsize=(width, height * rows + HEADING))
    note_shared(drawn, labels)
    grid = drawn.subplots(rows, across, sharex=True, sharey=True, squeeze=False).ravel().tolist()
    letters = int(LETTERS * (width - margin)) // across
    for panel, named in zip(grid, told_apart(labels), strict=False):
        panel.set_title(textwrap.fill(as_text(named), letters), pad=3, fontsize=7.5)
        panel.grid(True, color="0.92", linewidth=0.5)
        panel.set_axisbelow(True)
    for number, panel in enumerate(grid[len(labels) :], len(labels)):
        panel.axis("off")
        grid[number - across].tick_params(labelbottom=True)
    for panel in grid[::across]:
        panel.set_ylabel(textwrap.fill(y, Y_LETTERS))
    for panel in grid[max(0, len(labels) - across) : len(labels)]:
        panel.set_xlabel(textwrap.fill(x, letters))
    return drawn, grid[: len(labels)]


def row_heights(labels: Sequence[dict[str, Any]], width: float) -> tuple[list[str], np.ndarray]:
    """Names of rows, wrapped to a third of the width, and how high each row must be [in]."""
    names = [textwrap.fill(as_text(name), int(LETTERS * width / 2.8)) for name in told_apart(labels)]
    return names, np.array([max(ROW_HEIGHT, LINE * (1 + name.count("\n"))) for name in names])


def rows_room(labels: Sequence[dict[str, Any]], width: float, most: int) -> int:
    """How many of these rows a page has room for, of the first `most`."""
    heights = np.maximum.accumulate(row_heights(labels[:most], width)[1])  # all are as high as the highest
    return int(np.count_nonzero(heights * np.arange(1, len(heights) + 1) <= style.TALLEST - 1.0))


def named_rows(labels: Sequence[dict[str, Any]], width: float) -> tuple[Figure, Axes]:
    """A figure with one panel that has a named row for each of these labels, from the top down."""
    names, heights = row_heights(labels, width)
    drawn = Figure(figsize=(width, heights.max() * len(labels) + 1.0))
    note_shared(drawn, labels)
    panel = drawn.add_subplot()
    panel.set_yticks(range(len(names)) if any(names) else [], names if any(names) else [])
    panel.set_ylim(len(names) - 0.4, -0.6)
    panel.grid(True, axis="x", color="0.9", linewidth=0.5)
    return drawn, panel


def axis_name(words: str, width: float) -> str:
    """The name of an axis that takes most of the width, in as many lines as that needs."""
    return textwrap.fill(words, int(0.6 * LETTERS * width))
