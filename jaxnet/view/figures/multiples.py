"""Axes in print: small multiples with common axes, ticks, notes, legends.

Small multiples are a panel per group of cells; the first swept key chooses the row.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis
from matplotlib.cbook import is_math_text
from matplotlib.font_manager import FontProperties
from matplotlib.gridspec import GridSpec
from matplotlib.mathtext import MathTextParser
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from jaxnet.config.naming import NO_BREAK
from jaxnet.statistics.curves import MOST_PANELS
from jaxnet.statistics.groups import Label, evenly_over
from jaxnet.view.drawings.drawing import Selection
from jaxnet.view.drawings.words import distinct_titles, gone_words, lines_within
from jaxnet.view.figures import style
from jaxnet.view.figures.style import Figure

Labels = Mapping[str, Label]  # swept values of a panel or row, by key

PANEL_HEIGHT = 1.45  # [in]
PANELS_PER_ROW = 4  # panels in a row across two columns
ROW_HEIGHT, LEAST_ROW_HEIGHT = 0.28, 0.17  # [in] of a named row, and of one of many
LINE_HEIGHT = 0.13  # [in] of each line of its name
AXIS_ROOM = 0.7  # [in] for axis and legend
LETTERS_PER_INCH, NOTE_LETTERS_PER_INCH = 17, 19  # of a row's name, and of a note
LEGEND_LINE = 0.16  # [in]
LEGEND_LETTERS_PER_INCH, HANDLE_LETTERS = 17, 9  # of a legend, and of an entry's handle
TITLE_LETTERS_PER_INCH, LABEL_ROOM = 14.0, 0.4  # of a panel's title; [in] for the label of the rows
LABEL_ROOMS = 0.25, 0.45  # [in] between labels of a log axis, along y and along x
LETTERS_PER_PANEL = 22  # of a line along a panel's height
BETWEEN = 1.06  # of a panel, the middle between it and the next


def sharing_first(labels: Sequence[Labels]) -> int:
    """Panels that share the first swept value; 1 if values have unlike numbers of panels."""
    firsts = Counter(next(iter(each.values()), None) for each in labels)
    return min(firsts.values()) if len({*firsts.values()}) == 1 else 1


def most_in_row(labels: Sequence[Labels], most: int = PANELS_PER_ROW) -> int:
    """So many panels, or half more if a row of one first swept value is then whole."""
    run = sharing_first(labels)
    return run if most < run <= 1.5 * most else most


def panel_columns(labels: Sequence[Labels], most: int = PANELS_PER_ROW) -> int:
    """Panels in a row: no row mixes first swept values if it can be whole, or rows are alike."""
    run, many = sharing_first(labels), len(labels)
    if 2 < 2 * run <= most and many >= 2 * most and many % (2 * run) == 0:
        return 2 * run
    parts = [columns for columns in range(2, most + 1) if run % columns == 0]
    return max(parts, default=-(-many // -(-many // most)))


def log_ticks(axis: Axis, room: float = PANEL_HEIGHT) -> None:
    """Set ticks of a log axis with fixed ends and this room [in].

    Long axes have a tick a decade; labels are evenly apart, at both ends if three then fit. Short
    axes have ticks within a decade.
    """
    low, high = sorted(axis.get_view_interval())
    decades = np.log10(high / low)
    if decades >= 2:
        powers = np.arange(np.ceil(np.log10(low) - 1e-9), np.floor(np.log10(high) + 1e-9) + 1)
        span = len(powers) - 1
        least = span * LABEL_ROOMS[isinstance(axis, XAxis)] / room  # decades between labels
        fits = [n for n in range(1, span // 2 + 1) if n >= least]
        step = next((n for n in fits if span % n == 0), (fits or [max(1, span // 2)])[0])
        axis.set_major_locator(FixedLocator(10.0 ** powers[::step]))
        axis.set_minor_locator(FixedLocator(10.0**powers))
        axis.set_minor_formatter(NullFormatter())
        return
    if decades >= 0.7:  # so that two of the numbers are there at least
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if decades <= 1 else (1, 3)))
    else:
        axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.4g}"))
    axis.set_minor_formatter(NullFormatter())


def log_axis(
    panel: Axes, letter: str, ends: tuple[float, float] | None = None, room: float = PANEL_HEIGHT
) -> None:
    """Make an axis of a panel, x or y, of this room [in] a log axis with its ticks."""
    panel.set(**{f"{letter}scale": "log"})
    if ends is None:
        panel.autoscale_view()
    else:
        panel.set(**{f"{letter}lim": ends})
    log_ticks(panel.xaxis if letter == "x" else panel.yaxis, room)


def escape_dollars(words: str) -> str:
    return words.replace("$", r"\$")


def filled_lines(words: str, letters: int | float) -> str:
    """Wrap words to lines of so many letters, which may part a number from its unit, or its key."""
    long = {each for each in words.split(" ") if len(each) > letters}
    parts = (each.replace(NO_BREAK, " ") if each in long else each for each in words.split(" "))
    return "\n".join(lines_within(" ".join(parts), letters))


def wrapped(words: str, letters: int | float) -> str:
    """Words on lines of so many letters, in which dollar signs are no formula."""
    return filled_lines(escape_dollars(words), letters)


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


def write_left_out(drawn: Figure, *parts: Selection, where: str) -> None:
    """Write, and keep, how many of each noun are drawn, if some are not, and which are not."""
    lacking = [part for part in parts if len(part[0]) < len(part[1])]
    if lacking:
        told = [f"{len(shown):,} of {len(there):,} {noun}" for shown, there, noun in lacking]
        gone = ", ".join(word for shown, there, _ in lacking for word in gone_words(shown, there))
        drawn.left_out = f"{' and '.join(told)} are drawn{f'; not drawn: {gone}' * bool(gone)}"
        write_note(drawn, escape_dollars(f"{drawn.left_out}; all are in {where}"))


def write_note(drawn: Figure, words: str) -> None:
    """Append a note to the small lines below all panels."""
    told = "; ".join(filter(None, [drawn.get_supxlabel().replace("\n", " "), words]))
    size = type_scale("font.size")
    lines = lines_within(told, NOTE_LETTERS_PER_INCH * drawn.get_figwidth() / size)
    drawn.supxlabel("\n".join(lines), x=0.01, ha="left", fontsize=7 * size)


def make_room(drawn: Figure) -> None:
    """Make a figure higher by the lines of notes and labels for which AXIS_ROOM has none."""
    labels = max((each.get_xlabel().count("\n") for each in drawn.axes), default=0)
    lines = labels + max(0, drawn.get_supxlabel().count("\n") - 1)
    higher = drawn.get_figheight() + LINE_HEIGHT * type_scale("font.size") * lines
    drawn.set_figheight(min(style.GREATEST_HEIGHT, higher))


def legend_grid(labels: Sequence[str], width: float) -> tuple[int, int]:
    """Columns and rows of a legend, as many columns as its type has room for in a width [in]."""
    room = LEGEND_LETTERS_PER_INCH * width / type_scale("legend.fontsize")
    widths = [max(map(len, label.split("\n"))) + HANDLE_LETTERS for label in labels]
    for columns in range(len(labels), 1, -1):
        split = [widths[n::columns] for n in range(columns)]
        if sum(map(max, split)) <= room:
            return columns, len(split[0])
    return 1, len(labels)


def write_legend(drawn: Figure, handles: Sequence[Any], **look: Any) -> float:
    """Write a legend above the panels; return the height [in] of its lines after the first."""
    columns, rows = legend_grid([each.get_label() for each in handles], drawn.get_figwidth())
    look = {"ncols": columns, "handlelength": 2.6} | look
    handles = [each for n in range(columns) for each in handles[n::columns]]  # read along rows
    drawn.legend(handles=handles, loc="outside upper center", **look)
    return LEGEND_LINE * type_scale("legend.fontsize") * (rows - 1)


def panels_across(width: float) -> int:
    return max(1, round(PANELS_PER_ROW * width / style.FIGURE_WIDTH))


def page_height() -> float:
    """Height that panels may take [in], were the type that of the style for print."""
    return float(mpl.rcParams["figure.figsize"][1] / type_scale("font.size"))


def panels_fitting(
    labels: Sequence[Labels], width: float, height: float = PANEL_HEIGHT, most: int | None = None
) -> list[int]:
    """Places of the panels that fit a page, evenly over the sweep, in rows of at most `most`."""
    rows, across = max(1, int((page_height() - AXIS_ROOM) / height)), most or panels_across(width)
    places: list[int] = []
    for many in range(min(len(labels), MOST_PANELS), 0, -1):
        places = evenly_over(labels, many)
        if len(places) <= rows * panel_columns([labels[place] for place in places], across):
            break
    return places


def title_letters(width: float, across: int) -> float:
    return TITLE_LETTERS_PER_INCH * (width - LABEL_ROOM) / across


def title_height(labels: Sequence[Labels], width: float, most: int) -> float:
    """Height [in] of the lines of titles after the first."""
    letters = title_letters(width, panel_columns(labels, most))
    return LINE_HEIGHT * max(wrapped(t, letters).count("\n") for t in distinct_titles(labels)[0])


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

    Titles are wrapped to a panel's share of the width without the margin [in]. An axis label stands
    once, in the middle of the lowest row or of the left column.
    Height and margin are those for type of the style for print; larger type takes more.
    """
    size = type_scale("font.size")
    within = width / size
    across = panel_columns(labels, most or panels_across(within))
    rows = -(-len(labels) // across)
    drawn = Figure(figsize=(width, size * (height * rows + AXIS_ROOM)))
    titles, common = distinct_titles(labels)
    write_note(drawn, escape_dollars(common))
    grid = GridSpec(rows, across, figure=drawn)
    panels: list[Axes] = []
    for place in range(len(labels)):
        row, column = divmod(place, across)
        shared: Any = dict.fromkeys(("sharex", "sharey"), panels[0]) if panels else {}
        panels.append(drawn.add_subplot(grid[row, column], **shared))
    letters = title_letters(within - margin, across)
    x, y = (each.replace(" / ", f"{NO_BREAK}/{NO_BREAK}") for each in (x, y))
    along = LETTERS_PER_PANEL * max(min(1.0, height / PANEL_HEIGHT), rows > 1)
    beside = y if is_math_text(y) else "\n".join(lines_within(y, along * rows))
    lowest = panels[(rows - 1) * across :]
    below, middle = filled_lines(x, 0.85 * letters * len(lowest)), lowest[(len(lowest) - 1) // 2]
    middle.set_xlabel(below, x=0.5 if len(lowest) % 2 else BETWEEN)
    panels[(rows - 1) // 2 * across].set_ylabel(beside, y=0.5 if rows % 2 else 1.0 - BETWEEN)
    for place, (panel, named) in enumerate(zip(panels, titles, strict=True)):
        is_lowest = place + across >= len(labels)
        panel.set_title(wrapped(named, letters), pad=3, fontsize=7.5 * size)
        panel.grid(True, color="0.92", linewidth=0.5)
        panel.set_axisbelow(True)
        panel.tick_params(labelbottom=is_lowest, labelleft=place % across == 0)
        if is_lowest:
            panel.xaxis.set_in_layout(place // across == rows - 1)  # else a hole has room below
    return drawn, panels


def type_scale(setting: str) -> float:
    """How much larger the type of a setting of matplotlib is now than in the style for print."""
    now: Any = mpl.rcParams
    points = FontProperties(size=now[setting]).get_size_in_points()
    return float(points / style.PRINT_STYLE[setting])
