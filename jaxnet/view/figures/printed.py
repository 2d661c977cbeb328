"""A drawing in print: a legend, small multiples, and notes below them."""

import itertools
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_hex
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator, MultipleLocator, NullLocator

from jaxnet.statistics.axes import numeric
from jaxnet.statistics.groups import evenly, evenly_over
from jaxnet.view.drawings.drawing import (
    BAND,
    OUTSIDE,
    Beyond,
    Drawing,
    Look,
    Panel,
    Scale,
    Selection,
    Tiles,
    Trace,
)
from jaxnet.view.drawings.heat import COLOUR_MAP, colour_norm, text_colour
from jaxnet.view.drawings.words import NO_LANE
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

BAR_STYLE: dict[str, Any] = {"fmt": "none", "elinewidth": 0.8, "capsize": 1.5}
ROW_OF_SERIES = 0.13  # [in] of a named row, for each of its series
TITLE_ROOM = 0.35  # [in] of a panel of named rows
LEAST_ROWS_WIDTH = 1.3  # [in] of a panel of named rows
MOST_ROWS_PANELS = 4  # of named rows, side by side
TILE_SIZES = (0.42, 0.26), (0.3, 0.17), (0.24, 0.17)  # [in] of a tile; the first has an interval
LEAST_TILE = 0.22, 0.1  # [in] of a tile whose number can be read
DIGIT_WIDTH = 0.05  # [in] of a letter in a tile
INTERVAL_DIGIT, TILE_PAD = 0.042, 0.04  # [in] of a letter of an interval, and of what is beside it
DESCENT = 0.015  # [in] that is empty below a number
NO_ROOM = "tiles of a value without its number have no room for it"
TILE_LETTERS = 12  # of a line of a column's name
HIGH = 4  # rows of panels, from which smaller tiles in fewer rows are better
COLOUR_BAR_ROOM, BAR_WIDTH = 0.35, 0.7  # [in]; of the figure's width
HATCHED: dict[str, Any] = {"facecolor": "white", "edgecolor": "0.6", "hatch": "/////"}
MOST_VALUE_TICKS = 8  # values of x, where ticks stand at them
DIGIT_OF_NAME = 0.062  # [in] of a letter below a column of tiles
TICK_GAP = 0.06  # [in] between labels of ticks
DIGIT_OF_TICK, DOT_OF_TICK = 0.64, 0.32  # of the size of the type, the widths of letters
PANEL_FRAME = 0.55, 0.12  # [in] beside the panels of a row, and between two of them
ROOM_FOR_TWENTIES = 1.25  # [in] of an axis of shares with ticks at 0, 20 to 100
ROOM_OF_TICK = 0.4  # [in] for each of the round ticks
END_ROOM = 0.4, 0.22  # [in] from the tick of an end to the next, along x and along y
TICK_ERROR = 0.02  # of a value, what the label of its tick may be off
DIGITS_OF_TICKS = 4, 3, 2  # the first that fit


class Layout(NamedTuple):
    """Places of the panels of a page, how many side by side, their height, and named rows [in].

    `names` are those of the rows, whose places are `rows`.
    """

    shown: list[int]
    most: int
    height: float
    margin: float = 0.0
    rows: Sequence[int] = ()
    names: Sequence[str] = ()


def printed(drawing: Drawing, width: float = style.FIGURE_WIDTH) -> Figure:
    """Draw as many panels and named rows as a page holds.

    Lengths are those for type of the style for print; with larger type all are larger.
    """
    size = multiples.type_scale("font.size")
    within = width / size
    page = layout_of(drawing, within, legend_of(drawing.panels, drawing.key, width)[1])
    panels, rows = [drawing.panels[place] for place in page.shown], page.rows
    if rows:
        panels = [each._replace(series=[*seen_series(each.series, rows)]) for each in panels]
    handles, below = legend_of(panels, drawing.key, width)
    labels = [panel.labels for panel in panels]
    titles, sizes = (drawing.x.title, drawing.y.title), (page.height, page.most, page.margin)
    drawn, axes = multiples.panel_grid(labels, *titles, width, *sizes)
    drawn.cells = [*itertools.chain.from_iterable(panel.cells for panel in panels)]
    across = multiples.panel_columns(labels, page.most)
    room = (within - page.margin - PANEL_FRAME[0]) / across - PANEL_FRAME[1]
    longest = DIGIT_OF_NAME * min(max(map(len, drawing.x.names), default=0), TILE_LETTERS)
    is_steep = longest * len(drawing.x.names) > room
    below += COLOUR_BAR_ROOM * (drawing.colours is not None) + longest * is_steep
    drawn.set_figheight(min(style.GREATEST_HEIGHT, drawn.get_figheight() + size * below))
    notes = dict.fromkeys(drawing.told(panels))
    for place, panel in zip(axes, panels, strict=True):
        for series in itertools.chain.from_iterable(map(drawing.parted, panel.series)):
            draw_series(place, series, drawing.values, bool(rows))
        if panel.tiles is not None and drawing.colours is not None:
            along = (within - page.margin) / across / len(drawing.x.names)
            titles = multiples.title_height(labels, within - page.margin, page.most)
            tile = along, (page.height - TITLE_ROOM - titles) / len(rows)
            if not draw_tiles(place, panel.tiles, colour_norm(drawing.colours), tile):
                notes.setdefault(NO_ROOM)
        if panel.words:
            words = multiples.wrapped(panel.words, multiples.TITLE_LETTERS_PER_INCH * room)
            place.text(0.5, 0.5, words, transform=place.transAxes, ha="center", color="0.4")
    if rows:
        named = page.names if any(page.names) else []
        axes[0].set_yticks(range(len(named)), named)
        axes[0].set_ylim(len(rows) - 0.5, -0.5)
        for place in axes:
            place.grid(False, axis="y")
    else:
        set_scale(axes[0], drawing.y, "y", page.height)
    set_scale(axes[0], drawing.x, "x", room)
    beyond = drawing.beyond(panels)
    if drawing.colours is None and (any(beyond) or drawing.values.band):
        mark_ends(axes, drawing.values, beyond, room if rows else page.height, bool(rows))
    if is_steep:
        for place in axes:
            place.tick_params(axis="x", labelrotation=90)
    if drawing.colours is not None:
        bar = ScalarMappable(colour_norm(drawing.colours), COLOUR_MAP)
        look: dict[str, Any] = {"location": "bottom", "aspect": 50, "shrink": BAR_WIDTH}
        look["extend"] = ("neither", "max", "min", "both")[2 * beyond[0] + beyond[1]]
        shown = drawn.colorbar(bar, ax=drawn.axes, label=drawing.colours.title, **look).ax
        if drawing.colours.log:
            multiples.log_ticks(shown.xaxis, BAR_WIDTH * within)
            mark_ends([shown], drawing.colours, beyond, BAR_WIDTH * within, rows=True)
    if drawing.blank:
        hatched = Patch(label=drawing.blank, linewidth=0, **HATCHED)
        drawn.legend(handles=[hatched], loc="outside upper right")
    if handles:
        look = {"title": multiples.escape_dollars(drawing.key)} if drawing.key else {}
        multiples.write_legend(drawn, handles, **look)
    for note in notes:
        multiples.write_note(drawn, multiples.escape_dollars(note))
    named = drawing.y.labels or [{"": name} for name in drawing.y.names]
    parts: list[Selection] = [(labels, [panel.labels for panel in drawing.panels], "panels")]
    parts.append(([named[row] for row in rows], named, "rows"))
    if drawing.there is not None:
        within = parts[1][0] if drawing.y.labels else [{}]
        cells = [{**panel, **row} for panel in labels for row in within]
        parts = [(cells, *drawing.there)]
    multiples.write_left_out(drawn, *parts, *drawing.left_out, where=drawing.where)
    return drawn


def layout_of(drawing: Drawing, width: float, below: float) -> Layout:
    """The largest tiles with which most panels fit, in full rows; of named rows, as many as fit."""
    labels, names = [panel.labels for panel in drawing.panels], drawing.y.names
    if not names:
        most = multiples.most_in_row(labels, multiples.panels_across(width))
        height = multiples.PANEL_HEIGHT + multiples.title_height(labels, width, most)
        return Layout(multiples.panels_fitting(labels, width, height, most), most, height)
    rows = [multiples.wrapped(name, multiples.LETTERS_PER_INCH * width / 3) for name in names]
    longest = max(len(line) for name in rows for line in name.split("\n"))
    margin = longest / multiples.LETTERS_PER_INCH
    least = multiples.LINE_HEIGHT * max(1 + name.count("\n") for name in rows)
    room = multiples.page_height() - multiples.AXIS_ROOM - TITLE_ROOM - below
    places = range(len(rows))
    if drawing.colours is None:
        across = max(1, min(MOST_ROWS_PANELS, int((width - margin) / LEAST_ROWS_WIDTH)))
        titles = multiples.title_height(labels, width - margin, across)
        room -= titles
        row = np.clip(room / len(rows), multiples.LEAST_ROW_HEIGHT, multiples.ROW_HEIGHT)
        row = max(float(row), ROW_OF_SERIES * drawing.beside, least)
        most = max(1, int(room / row + 1e-9))
        labels_of_rows = drawing.y.labels
        places = evenly_over(labels_of_rows, most) if labels_of_rows else evenly(places, most)
        rows = [rows[place] for place in places]
        height = row * len(rows) + TITLE_ROOM + titles
        shown = multiples.panels_fitting(labels, width, height, across)
        return Layout(shown, across, height, margin, places, rows)
    margin, found = margin + TITLE_ROOM, list[Layout]()
    for across, up in TILE_SIZES:
        most = max(1, int((width - margin) / (across * len(drawing.x.names) + PANEL_FRAME[1])))
        titles = multiples.title_height(labels, width - margin, most)
        height = min(max(up, least) * len(rows), room) + TITLE_ROOM + titles
        shown = multiples.panels_fitting(labels, width, height, most)
        found.append(Layout(shown, most, height, margin, places, rows))

    def worth(layout: Layout) -> tuple[int, bool, int]:
        rows, rest = divmod(len(labels), multiples.panel_columns(labels, layout.most))
        return len(layout.shown), rest == 0, -(rows // HIGH)

    return max(found, key=worth)  # of equal ones the first, with the larger tiles


def seen_series(many: Sequence[Trace], rows: Sequence[int]) -> Iterator[Trace]:
    """Yield the series that have points at the named rows that are drawn, at these places."""
    for each in many:
        row = np.rint(each.y).astype(int)
        seen = np.isin(row, rows)
        y = np.searchsorted(rows, row[seen]) + (each.y - row)[seen]
        low, high = (end if end is None else end[seen] for end in (each.low, each.high))
        if seen.any():
            yield each._replace(x=each.x[seen], y=y, low=low, high=high)


def legend_of(
    panels: Sequence[Panel], key: str, width: float
) -> tuple[list[Line2D | Patch], float]:
    """Handles of the legend of these panels and its height [in]; an entry of many colours is grey.

    `key` is its title.
    """
    named: dict[str, list[Trace]] = {}
    for panel in panels:
        for series in panel.series:
            if series.name:
                named.setdefault(series.name, []).append(series)
    if not named:
        return [], 0.0
    room = multiples.LEGEND_LETTERS_PER_INCH * width / multiples.type_scale("legend.fontsize")
    labels = [multiples.wrapped(name, room - multiples.HANDLE_LETTERS) for name in named]
    _, rows = multiples.legend_grid(labels, width)
    handles: list[Line2D | Patch] = []
    for label, (one, *others) in zip(labels, named.values(), strict=True):
        many = any(each.look.color != one.look.color for each in others)
        look = one.look._replace(color="0.5") if many else one.look
        if one.form == "band":
            handles.append(Patch(color=look.color, alpha=0.25, linewidth=0, label=label))
        else:
            handles.append(Line2D([], [], label=label, **line_style(look, one.form)))
    handles.sort(key=lambda each: each.get_label() == NO_LANE)
    lines = rows * max(1 + label.count("\n") for label in labels)
    return handles, multiples.LEGEND_LINE * (lines + bool(key))


def line_style(look: Look, kind: str) -> dict[str, Any]:
    found: dict[str, Any] = {"color": look.color, "linewidth": look.width, "linestyle": "none"}
    if kind not in ("points", OUTSIDE):
        found["linestyle"] = (0, look.dash) if look.dash else "-"
    if look.marker:
        found |= {"marker": look.marker, "markersize": look.size}
    return found | ({"markerfacecolor": "white"} if look.hollow else {})


def draw_series(panel: Axes, series: Trace, scale: Scale, rows: bool = False) -> None:
    """Draw a series on a scale of its values, which are along x in `rows`."""
    look = series.look
    low, high = (scale.within(end) for end in (series.low, series.high))
    x = scale.within(series.x, series.form) if rows else series.drawn_x
    y = series.y if rows else scale.within(series.y, series.form)
    if series.barred:
        value = x if rows else y
        sides, beyond = scale.bars(series.low, value, series.high)
        ends = np.stack([value - sides[0], sides[1] - value]).clip(min=0)
        panel.errorbar(x, y, **{"xerr" if rows else "yerr": ends}, ecolor=look.color, **BAR_STYLE)
        arrow: dict[str, Any] = {"color": look.color, "markersize": 4, "clip_on": False}
        for end, there, symbol in zip(sides, beyond, "<>" if rows else "v^", strict=True):
            if there.any():
                at = (end, y) if rows else (x, end)
                panel.plot(*(each[there] for each in at), symbol, **arrow)
    elif series.form == "band" or (series.form == "both" and low is not None):
        alpha = 0.2 if series.form == "band" else 0.15
        panel.fill_between(x, low, high, color=look.color, alpha=alpha, linewidth=0)
    elif series.form == "range":
        panel.vlines(x, np.asarray(low), np.asarray(high), color=look.color, linewidth=look.width)
    if series.form in ("band", "range"):
        return
    if series.form == "level":
        panel.axhline(y[0], **line_style(look, series.form))
        return
    is_mark = series.form in ("points", "both", OUTSIDE)
    front: dict[str, Any] = (
        {"clip_on": False, "zorder": 3 - (look.marker == ".")} if is_mark else {}
    )
    front["drawstyle"] = "steps-post" if series.form == "steps" else "default"
    panel.plot(x, y, **line_style(look, series.form), **front)


def draw_tiles(panel: Axes, tiles: Tiles, norm: Normalize, size: tuple[float, float]) -> bool:
    """Draw one map of tiles of a size [in]; return whether all values have their number.

    Tiles without a value are hatched. Small ones have no interval, and no number where none could
    be read.
    """
    down, along = tiles.values.shape
    corner = -0.5, -0.5
    panel.add_patch(Rectangle(corner, along, down, linewidth=0, **HATCHED))
    shown = np.ma.masked_invalid(tiles.values)
    edges = [np.arange(n + 1) - 0.5 for n in (along, down)]
    look: dict[str, Any] = {"cmap": COLOUR_MAP, "norm": norm, "edgecolors": "white"}
    panel.pcolormesh(*edges, shown, linewidth=0.5, **look)
    panel.grid(False)
    panel.tick_params(length=0)
    panel.spines[:].set_visible(False)
    legible, wide = ((np.array(size) * 1.01 >= each).all() for each in (LEAST_TILE, TILE_SIZES[0]))
    longest, scale = max(map(len, tiles.intervals.ravel())), multiples.type_scale("font.size")
    wide &= INTERVAL_DIGIT * longest + TILE_PAD <= size[0]
    is_whole = True
    for at, value in np.ndenumerate(tiles.values):
        ink = "black" if np.isnan(value) else text_colour(to_hex(COLOUR_MAP(norm(value))))
        written: dict[str, Any] = {"ha": "center", "color": ink}
        row, column = at
        interval = tiles.intervals[at] if wide else ""
        if interval:
            row += DESCENT / size[1]
            panel.text(column, row, interval, fontsize=5 * scale, va="top", **written)
        if legible and DIGIT_WIDTH * len(text := tiles.texts[at]) <= size[0]:
            side = "bottom" if interval else "center"
            panel.text(column, row, text, fontsize=6 * scale, va=side, **written)
        else:
            is_whole &= bool(np.isnan(value))
    return is_whole


def set_scale(panel: Axes, scale: Scale, letter: str, room: float) -> None:
    """Set scale, ends and ticks of an axis that has this room [in]."""
    axis = panel.xaxis if letter == "x" else panel.yaxis
    if scale.names:
        names = [multiples.wrapped(each, TILE_LETTERS) for each in scale.names]
        axis.set_ticks(range(len(names)), names)
        panel.set_xlim(-0.5, len(scale.names) - 0.5)
        return
    if scale.share:
        panel.set(**{f"{letter}lim": (-4, 104)})
        axis.set_major_locator(MultipleLocator(20 if room >= ROOM_FOR_TWENTIES else 50))
    elif scale.log:
        multiples.log_axis(panel, letter, scale.ends, room)
    elif scale.ends:
        low, high = scale.ends
        panel.set(**{f"{letter}lim": (0, 1.05 * high or 1.0) if low == 0 else (low, high)})
        axis.set_major_locator(MaxNLocator(4 if low == 0 else 6))
    elif scale.whole:
        axis.set_major_locator(MaxNLocator(integer=True))
    if texts := value_ticks(scale, room):
        axis.set_ticks(scale.ticks, texts)
        axis.set_minor_locator(NullLocator())
    elif letter == "x" and not scale.log and len(scale.ticks) > MOST_VALUE_TICKS:
        axis.set_major_locator(MaxNLocator(max(2, min(8, int(room / ROOM_OF_TICK)))))


def mark_ends(
    panels: Sequence[Axes], scale: Scale, beyond: Beyond, room: float, rows: bool = False
) -> None:
    """Name the ends of an axis of this room [in] at which values stand that are beyond it.

    The axis, x of `rows`, goes on with its band, whose name stands below other labels of x.
    """
    axis, apart = (panels[0].xaxis, END_ROOM[0]) if rows else (panels[0].yaxis, END_ROOM[1])
    low, high = axis.get_view_interval()
    room /= 1 + BAND[1] * bool(scale.band)
    places = [at for at in axis.get_major_locator()() if low <= at <= high]
    ticks = dict(zip(places, axis.get_major_formatter().format_ticks(places), strict=True))
    if scale.log:
        named: Any = axis.get_major_formatter()
        ticks = scale.named_ticks(places, named, beyond, apart * np.log10(high / low) / room)
    if scale.band:
        middle, end = scale.beyond_end
        ticks[middle] = "\n" * rows + scale.band
        for panel in panels:
            (panel.axvspan if rows else panel.axhspan)(high, end, color="0.94", zorder=0)
        panels[0].set(**{f"{'x' if rows else 'y'}lim": (low, end)})
    axis.set_ticks([*ticks], [*ticks.values()])


def value_ticks(scale: Scale, room: float) -> list[str]:
    """Labels of ticks at the swept values of an axis of this room [in], none over another.

    Labels have as many digits as there is room for. Where two are too many, or there are many
    values, there are no labels.
    """
    values = scale.ticks
    if not 0 < len(values) <= MOST_VALUE_TICKS or not numeric(values):
        return []
    size = FontProperties(size=mpl.rcParams["xtick.labelsize"]).get_size_in_points() / 72
    size /= multiples.type_scale("font.size")
    given = np.log(values) if scale.log else np.asarray(values, float)
    places = 0.9 * room * (given - given.min()) / (np.ptp(given) or 1.0)
    for digits in DIGITS_OF_TICKS:
        texts = []
        for value in values:  # with four digits where these are too few for it
            short = float(f"{value:.{digits}g}")
            is_near = abs(short - value) <= TICK_ERROR * abs(value)
            texts.append(f"{short if is_near else value:.4g}")
        wide = [DIGIT_OF_TICK * len(text) - DOT_OF_TICK * text.count(".") for text in texts]
        half = size * np.array(wide) / 2
        if (np.diff(places) >= half[:-1] + half[1:] + TICK_GAP).all():
            return texts
    return []
