"""A quantity against a swept key, with intervals: a colour per value of a second key, panels.

Numbers are on x. Other values have a named row each, and the quantity is across.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes as Panel
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, MultipleLocator, NullLocator

from jaxnet.config.cells import Cell
from jaxnet.config.naming import key_name, quantity, value_alone
from jaxnet.statistics.axes import (
    Axes,
    by_hue,
    geometric,
    numeric,
    on_a_scale,
    ordered_values,
    panels_of,
)
from jaxnet.statistics.groups import Label
from jaxnet.statistics.quantities import VALUE_COLUMNS, Quantity
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "*", "h")
BAR_STYLE: dict[str, Any] = {"fmt": "none", "elinewidth": 0.8, "capsize": 1.5}
MOST_BARS = 24  # values on x that have error bars; more have a band
DODGE = 0.012  # of the axis, between neighbouring colours
ROW_OF_HUE, ROW_OF_NAME = 0.13, 0.125  # [in] of a row for each colour and each line of its name
MOST_VALUE_TICKS = 8  # values of x, where ticks stand at them
TICK_GAP = 0.06  # [in] between labels of ticks
DIGIT_OF_TICK, DOT_OF_TICK = 0.64, 0.32  # of the size of the type, the widths of letters
PANEL_FRAME = 0.55, 0.12  # [in] beside the panels of a row, and between two of them
ROOM_FOR_TWENTIES = 1.25  # [in] of an axis of shares with ticks at 0, 20 to 100
TICK_ERROR = 0.02  # of a value, what the label of its tick may be off
DIGITS_OF_TICKS = 4, 3, 2  # the first that fit
MOVED_NOTE = "points are moved sideways to part them"
LINES_HEIGHT = 1.6  # [in]
LEGEND_LINE = 0.16  # [in]
LEGEND_LETTERS_PER_INCH, HANDLE_LETTERS = 14.5, 9  # of a legend, and of an entry's handle


class Look(NamedTuple):
    """The look of one colour."""

    label: str
    look: dict[str, Any]


def curve_figure(
    found: Quantity, axes: Axes, cells: Sequence[Cell], width: float = style.FIGURE_WIDTH
) -> Figure:
    """Draw a quantity against numbers on x, or in a named row for each value that is no number."""
    looks = hue_looks(axes.hue, ordered_values(cells, axes.hue))
    columns, labels = legend_layout(looks, width)
    below = LEGEND_LINE * (
        1 + -(-len(looks) // columns) * max(1 + each.count("\n") for each in labels)
    )
    below = below if axes.hue is not None else 0.0
    values, groups = ordered_values(cells, axes.x), panels_of(cells, axes)
    figure = rows_figure
    is_moved = False
    if axes.x is not None and on_a_scale(values):
        figure = numbers_figure
        is_moved = dodge(0, len(looks), values, geometric(values)) != (1.0, 0.0)
    drawn, shown = figure(found, axes, groups, values, looks, width, below)
    drawn.set_figheight(drawn.get_figheight() + below)
    if axes.hue is not None:
        handles = [
            Line2D([], [], **each.look, markersize=3.5, label=label)
            for each, label in zip(looks, labels, strict=True)
        ]
        title = multiples.escape_dollars(key_name(axes.hue))
        multiples.write_legend(drawn, handles, columns, ncols=columns, title=title)
    multiples.write_note(drawn, "; ".join(filter(None, [found.notes, MOVED_NOTE * is_moved])))
    multiples.write_left_out(drawn, (shown, len(groups), "panels"), where="cells.csv")
    return drawn


def hue_looks(key: str | None, values: Sequence[Label]) -> list[Look]:
    """A look for each value of the hue: few have colours of their own, more numbers a scale."""
    if key is None:
        return [Look("", {"color": style.BLUE, "marker": "o", "linestyle": "-"})]
    found = []
    ramp = numeric(values) and len(values) > len(style.SERIES_STYLES)
    for place, value in enumerate(values):
        look: dict[str, Any] = dict(style.SERIES_STYLES[place % len(style.SERIES_STYLES)])
        if ramp:
            colour = mpl.colormaps["viridis"](0.92 * place / (len(values) - 1))
            look = {"color": colour, "linestyle": "-"}
        marked = look | {"marker": MARKERS[place % len(MARKERS)]}
        found.append(Look(value_alone(key, value), marked))
    return found


def legend_layout(looks: Sequence[Look], width: float) -> tuple[int, list[str]]:
    """Columns of the legend, and its labels, wrapped to the width [in]."""
    room = LEGEND_LETTERS_PER_INCH * width / multiples.type_scale("legend.fontsize")
    longest = max(len(each.label) for each in looks) + HANDLE_LETTERS
    columns = max(1, min(len(looks), int(room / longest)))
    letters = int(room / columns) - HANDLE_LETTERS
    return columns, [multiples.wrapped(each.label, letters) for each in looks]


def numbers_figure(
    found: Quantity,
    axes: Axes,
    groups: Sequence[tuple[dict[str, Label], list[Cell]]],
    values: Sequence[Any],
    looks: Sequence[Look],
    width: float,
    below: float,
) -> tuple[Figure, int]:
    """Draw lines with error bars against numbers on x, or with bands for many numbers."""
    key, labels, log = str(axes.x), [each for each, _ in groups], geometric(values)
    shown = multiples.panels_fitting(labels, width, LINES_HEIGHT)
    titles = quantity(axes.x or ""), found.axis
    drawn, panels = multiples.panel_grid(labels[:shown], *titles, width, LINES_HEIGHT)
    for panel, place, mine in cells_by_colour(panels, groups, axes):
        look, ordered = looks[place].look, sorted(mine, key=lambda cell: cell.labels[key])
        factor, shift = dodge(place, len(looks), values, log)
        places = np.array([cell.labels[key] for cell in ordered], float) * factor + shift
        value, low, high = drawn_values(found, ordered)
        panel.plot(places, value, **look, markersize=3.2, clip_on=False, zorder=3)
        if len(ordered) > MOST_BARS:
            panel.fill_between(places, low, high, color=look["color"], alpha=0.2, linewidth=0)
        else:
            ends = bar_lengths(value, low, high)
            panel.errorbar(places, value, ends, ecolor=look["color"], **BAR_STYLE)
    panels[0].set_xscale("log" if log else "linear")
    panels[0].autoscale_view()
    across = multiples.panel_columns(labels[:shown], multiples.panels_across(width))
    x_ticks(panels[0], values, log, panel_room(width, across))
    scale_values(panels[0], found, "y", LINES_HEIGHT)
    return drawn, shown


def rows_figure(
    found: Quantity,
    axes: Axes,
    groups: Sequence[tuple[dict[str, Label], list[Cell]]],
    values: Sequence[Any],
    looks: Sequence[Look],
    width: float,
    below: float,
) -> tuple[Figure, int]:
    """Draw a named row for each value of x; colours lie side by side within a row."""
    key, labels = axes.x, [each for each, _ in groups]
    letters = multiples.LETTERS_PER_INCH * width / 3.2
    names = (
        [multiples.wrapped(value_alone(key, value), letters) for value in values] if key else [""]
    )
    lines = max(1 + name.count("\n") for name in names)
    row = max(multiples.ROW_HEIGHT, ROW_OF_HUE * len(looks), ROW_OF_NAME * lines)
    names = names[: int((style.GREATEST_HEIGHT - 1.5 - below) / row)]
    values = list(values)[: len(names)]
    height = row * len(names) + 0.35
    longest = max(len(line) for name in names for line in name.split("\n"))
    margin = longest / multiples.LETTERS_PER_INCH
    most = max(1, min(4, int((width - margin) / 1.3)))
    shown = multiples.panels_fitting(labels, width, height, most)
    few = labels[:shown]
    drawn, panels = multiples.panel_grid(few, found.axis, "", width, height, most, margin)
    for panel, place, mine in cells_by_colour(panels, groups, axes):
        look, shift = looks[place].look, 0.7 * ((place + 0.5) / len(looks) - 0.5)
        fitting = [cell for cell in mine if key is None or cell.labels[key] in values]
        rows = [shift + (values.index(cell.labels[key]) if key else 0) for cell in fitting]
        value, low, high = drawn_values(found, fitting)
        marked = {name: look[name] for name in ("color", "marker")}
        panel.plot(value, rows, **marked, linestyle="", markersize=3.5, clip_on=False, zorder=3)
        ends = bar_lengths(value, low, high)
        panel.errorbar(value, rows, xerr=ends, ecolor=look["color"], **BAR_STYLE)
        panel.grid(False, axis="y")
    panels[0].set_yticks(range(len(names)) if key else [], names if key else [])
    panels[0].set_ylim(len(names) - 0.5, -0.5)
    across = multiples.panel_columns(few, most)
    scale_values(panels[0], found, "x", panel_room(width - margin, across))
    return drawn, shown


def cells_by_colour(
    panels: Sequence[Panel], groups: Sequence[Any], axes: Axes
) -> list[tuple[Panel, int, list[Cell]]]:
    """Each panel's cells of each colour, where there are any."""
    hues = ordered_values([cell for _, cells in groups for cell in cells], axes.hue)
    return [
        (panel, place, mine)
        for panel, (_, cells) in zip(panels, groups, strict=False)
        for place, mine in enumerate(by_hue(cells, axes, hues))
        if mine
    ]


def panel_room(width: float, across: int) -> float:
    return (width - PANEL_FRAME[0]) / across - PANEL_FRAME[1]


def dodge(place: int, many: int, values: Sequence[Any], log: bool) -> tuple[float, float]:
    """Factor and shift on x of one colour, so that error bars lie side by side."""
    if many == 1 or len(values) < 2 or len(values) > MOST_BARS:
        return 1.0, 0.0
    step = (place - (many - 1) / 2) * min(DODGE, 0.6 / len(values) / many)
    span = np.log(values[-1] / values[0]) if log else values[-1] - values[0]
    return (float(np.exp(step * span)), 0.0) if log else (1.0, float(step * span))


def drawn_values(found: Quantity, cells: Sequence[Cell]) -> np.ndarray:
    """Value, low and high of cells; a metric's rounding is cut off."""
    table = found.values.reindex([cell.number for cell in cells])[VALUE_COLUMNS]
    columns = table.to_numpy(dtype=float).T
    return np.maximum(columns, found.floor) if found.log else columns  # not-a-number stays


def bar_lengths(value: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Lengths of error bars below and above; 0 for an end that is not known."""
    return np.nan_to_num(np.stack([value - low, high - value]).clip(min=0))


def scale_values(panel: Panel, found: Quantity, letter: str, room: float) -> None:
    """Set scale, ends and ticks of the axis of the quantity, which has this room [in]."""
    axis = panel.xaxis if letter == "x" else panel.yaxis
    known = found.values[VALUE_COLUMNS].to_numpy(dtype=float)
    known = known[np.isfinite(known)]
    if found.share:
        panel.set(**{f"{letter}lim": (-4, 104)})
        axis.set_major_locator(MultipleLocator(20 if room >= ROOM_FOR_TWENTIES else 50))
    elif found.log:
        multiples.log_axis(panel, letter, found.ends)
    elif len(known) and known.min() >= 0:
        panel.set(**{f"{letter}lim": (0, 1.05 * found.ends[1] or 1.0)})
        axis.set_major_locator(MaxNLocator(4))


def x_ticks(panel: Panel, values: Sequence[Any], log: bool, room: float) -> None:
    """Set ticks of the axis of numbers: at the values where they are few, else at round numbers."""
    if len(values) <= MOST_VALUE_TICKS:
        panel.set_xticks(values, value_ticks(values, log, room))
        panel.xaxis.set_minor_locator(NullLocator())
    elif log:
        multiples.log_ticks(panel.xaxis)
    else:
        panel.xaxis.set_major_locator(MaxNLocator(5))


def value_ticks(values: Sequence[int | float], log: bool, room: float) -> list[str]:
    """Labels of ticks at these values on an axis of this room [in], none over another.

    Labels have as many digits as there is room for. Where two are too many, some are empty.
    """
    size = FontProperties(size=mpl.rcParams["xtick.labelsize"]).get_size_in_points() / 72
    given = np.log(values) if log else np.asarray(values, float)
    places = 0.9 * room * (given - given.min()) / (np.ptp(given) or 1.0)
    fitting: list[str] = []
    for digits in DIGITS_OF_TICKS:
        texts = [tick_text(value, digits) for value in values]
        shown, end = [], -np.inf
        for place, text in zip(places, texts, strict=True):
            half = size * (DIGIT_OF_TICK * len(text) - DOT_OF_TICK * text.count(".")) / 2
            is_clear = place - half >= end + TICK_GAP
            shown.append(text if is_clear else "")
            end = place + half if is_clear else end
        if shown == texts:
            return texts
        fitting = max(shown, fitting, key=lambda each: len(list(filter(None, each))))
    return fitting


def tick_text(value: int | float, digits: int) -> str:
    """A number to so many digits, or to four where these are too few for it."""
    short = float(f"{value:.{digits}g}")
    return f"{short if abs(short - value) <= TICK_ERROR * abs(value) else value:.4g}"
