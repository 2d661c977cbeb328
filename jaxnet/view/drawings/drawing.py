"""A drawing as data: panels of series on common axes.

`figures.printed` makes a matplotlib figure of it, `page.plots` makes plotly figures.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from jaxtyping import Float, Int

from jaxnet.config.naming import choices_words
from jaxnet.statistics.curves import GREATEST_SHOWN, LOG_FLOOR
from jaxnet.statistics.groups import Label
from jaxnet.view.figures import style

MOST_NOTED = 3  # choices of panels by a note
MOST_BARS = 24  # points of a line that have error bars; more have a band
DODGE = 0.025  # of the axis, between marks side by side
MOST_DECADES = 6  # of values that a log axis shows, and one at either end for what is beyond
ROOM_ABOVE = 1.5  # of its top, to the end of an axis that is cut
LONE_REACH = 100.0  # of a log axis with one value, its ends' ratio
POINTWISE = ("x", "y", "low", "high", "cells", "apart", "sizes")  # of a series
BEYOND_NOTE = "arrows: intervals that go on beyond the axis"
BOUNDS_TOLD = "coloured lines: bounds of theory"
FITS_TOLD = "grey lines, at a height s: error = s ā, fitted to the lanes"
MOVED_NOTE = "points at one value stand side by side"
OUTSIDE, BAND = "outside", (0.15, 0.27)  # of an axis, from its end to a band's middle and end
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")


class Look(NamedTuple):
    """Colour and dashes of a line, its width and the size of its markers [pt].

    Dashes are lengths on and off, in widths of the line. A marker is a letter of matplotlib's.
    """

    color: Any = style.BLUE
    dash: tuple[float, ...] = ()
    marker: str = ""
    width: float = 1.0
    size: float = 3.5
    hollow: bool = False


LOOKS = [Look(color, dash) for color, dash in style.SERIES_LOOKS]


def colours_of(values: Sequence[Label]) -> list[Look]:
    """A look for each value: few have colours of their own, more a scale of colours."""
    if len(values) <= len(LOOKS):
        return LOOKS[: max(1, len(values))]
    return [
        Look(mpl.colormaps["viridis"](0.92 * n / (len(values) - 1))) for n in range(len(values))
    ]


class Trace(NamedTuple):
    """Points of one name: a "line", "steps", "points", "both", or a "band" from `low` to `high`.

    "Outside" points have no value: they stand in the axis' band beyond its end.

    Error bars reach from `low` to `high`: along y, along x in a drawing of named rows. They are all
    that is seen of a "range". A "level" is a line across the panel. Values are as computed; what is
    below the floor of a log axis stands there, but for a "slope", which leaves the axis.
    """

    name: str
    look: Look
    x: Any
    y: Any
    form: str = "line"
    low: Any = None
    high: Any = None
    cells: Sequence[int] | None = None  # of each point
    apart: Any = None  # x where points are drawn that would lie on others
    sizes: Any = 1.0  # of each point, beside which an error may be rounding

    @property
    def barred(self) -> bool:
        """Whether it has error bars."""
        few = self.form in ("points", OUTSIDE) or (self.form == "both" and len(self.x) <= MOST_BARS)
        return self.low is not None and few

    @property
    def drawn_x(self) -> Any:
        return self.x if self.apart is None else self.apart


class Tiles(NamedTuple):
    """Numbers over two axes of names: the cells, what stands in each tile, and what it tells."""

    cells: Int[np.ndarray, "rows columns"]  # below 0: none
    values: Float[np.ndarray, "rows columns"]
    texts: Any
    intervals: Any
    told: Any


Beyond = tuple[bool, bool]  # whether values beyond a log axis stand at its floor, and at its top


class Scale(NamedTuple):
    """An axis. Names stand at 0, 1, …, on y from the top; `ticks` where there is room for them.

    Values beyond the floor and the top stand there on a log axis, with hollow markers.
    """

    title: str
    ends: tuple[float, float] | None = None
    log: bool = False
    share: bool = False
    whole: bool = False
    names: Sequence[str] = ()
    ticks: Sequence[Any] = ()
    floor: float = LOG_FLOOR
    top: float = GREATEST_SHOWN
    labels: Sequence[Mapping[str, Label]] = ()  # of the names, if swept values make them
    band: str = ""  # names the band beyond the end, if there is one

    @property
    def unit(self) -> str:
        """The unit in brackets, else what the title divides by."""
        start = "[" if "[" in self.title else "/ "
        return self.title.rpartition(start)[2].removesuffix("]") if start in self.title else ""

    def cut(self, *values: Any) -> "Scale":
        """A log axis of too many decades keeps those with the most values, the greatest of equal.

        Values beyond stand at an end, a decade from the others.
        """
        low, high = self.ends or (1.0, 1.0)
        if not self.log or high <= 1.01 * 10 ** (MOST_DECADES + 2) * low:
            return self
        known = np.concatenate([np.ravel(np.asarray(each, dtype=float)) for each in values])
        powers = np.log10(known[known > LOG_FLOOR].clip(max=GREATEST_SHOWN))
        firsts = np.unique(np.floor(powers))
        held = [powers[(powers >= p) & (powers <= p + MOST_DECADES)] for p in firsts]
        kept = max(held, key=lambda some: (len(some), some.min()))
        low = max(low, float(10.0 ** (np.floor(kept.min()) - 1)))
        top = float(10.0 ** (np.ceil(kept.max()) + 1))
        return self._replace(ends=(low, min(high, ROOM_ABOVE * top)), floor=low, top=top)

    @property
    def beyond_end(self) -> tuple[float, float]:
        """Middle and end of the band."""
        assert self.ends is not None
        low, high = self.ends
        near, far = (high + part * (high - low or 1.0) for part in BAND)
        if self.log:
            near, far = (high * (high / low) ** part for part in BAND)
        return near, far

    def within(self, values: Any, form: str = "") -> Any:
        """Values of a series of this form as the axis shows them."""
        if form == OUTSIDE:
            return np.full(len(values), self.beyond_end[0])
        if values is None or not self.log or form == "slope":
            return values
        return np.clip(values, self.floor, self.top)

    def is_beyond(self, values: Any) -> tuple[Any, Any]:
        """Which values a log axis shows at its floor, and which at its top."""
        values = np.asarray(values, float)
        low = (values < self.floor) | (values <= LOG_FLOOR)
        return self.log & low, self.log & (values > self.top)

    def named_ticks(
        self, places: Iterable[float], named: Callable[[float], str], beyond: Beyond, apart: float
    ) -> dict[float, str]:
        """Names of ticks of a log axis; an end says so if values beyond it stand there.

        Ticks nearer to such an end than `apart` decades go.
        """
        ends = zip((self.floor, self.top), beyond, "≤≥", strict=True)
        told = {end: f"{sign} {named(end)}" for end, there, sign in ends if there}
        kept = (at for at in places if all(abs(np.log10(at / end)) > apart for end in told))
        return {at: named(at) for at in kept} | told

    def bars(self, low: Any, value: Any, high: Any) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        """Lower and upper ends of error bars within the axis, and which bars go on beyond it.

        A bar with one unknown end goes on to the end of the axis.
        """
        first, last = self.ends or (-np.inf, np.inf)
        if self.log:
            first, last = max(first, self.floor), min(last, self.top)
        known = np.isfinite(value) & (np.isfinite(low) | np.isfinite(high))
        below = known & ~(low >= first) & (value > first) & np.isfinite(first)
        above = known & ~(high <= last) & (value < last) & np.isfinite(last)
        low, high = np.where(below, first, low), np.where(above, last, high)
        return (self.within(low), self.within(high)), (below, above)


def moved_sideways(series: Sequence[Trace], x: Scale) -> list[Trace]:
    """Series of a panel whose points and error bars at one x stand side by side."""
    if len(series) < 2 or not x.ticks or not all(each.barred for each in series):
        return [*series]
    first, last = x.ticks[0], x.ticks[-1]
    steps = np.arange(len(series)) - (len(series) - 1) / 2
    steps *= min(DODGE, 0.6 / len(x.ticks) / len(series))
    reach = (last / first if last > first else LONE_REACH) if x.log else last - first
    moves = [each.x * reach**step if x.log else each.x + reach * step
             for each, step in zip(series, steps, strict=True)]  # fmt: skip
    return [each._replace(apart=at) for each, at in zip(series, moves, strict=True)]


class Panel(NamedTuple):
    """A panel about some cells, with words in its middle if it is empty, and a note on it."""

    labels: Mapping[str, Label]
    cells: Sequence[int]
    series: Sequence[Trace]
    words: str = ""
    note: str = ""
    tiles: Tiles | None = None


Selection = tuple[Sequence[Mapping[str, Label]], Sequence[Mapping[str, Label]], str]
"""Labels of what is drawn, of all that there is, and its noun."""


class Drawing(NamedTuple):
    """Panels on common axes, what all of them leave open, and what is left out."""

    panels: Sequence[Panel]
    x: Scale
    y: Scale
    notes: Sequence[str] = ()
    key: str = ""  # title of the legend
    beside: int = 1  # series side by side in a named row
    there: tuple[Sequence[Mapping[str, Label]], str] | None = None  # all of a noun, else panels
    where: str = "cells.csv"  # what holds all
    left_out: Sequence[Selection] = ()  # further ones
    colours: Scale | None = None  # of tiles
    blank: str = ""  # why tiles have no number

    @property
    def values(self) -> Scale:
        return self.colours or (self.x if self.y.names else self.y)

    def parted(self, series: Trace) -> list[Trace]:
        """The points within the axis, and apart, hollow, those beyond, to which no line leads."""
        values = np.asarray(series.x if self.y.names else series.y, dtype=float)
        beyond = np.any(self.values.is_beyond(values), axis=0)
        if not series.look.marker or not beyond.any():
            return [series]
        arrays = series._replace(sizes=np.broadcast_to(series.sizes, beyond.shape))._asdict()
        arrays = {name: arrays[name] for name in POINTWISE if arrays[name] is not None}
        ends = {name: np.asarray(each)[beyond] for name, each in arrays.items()}
        ends |= {"form": "points", "look": series.look._replace(hollow=True)}
        within = {"x" if self.y.names else "y": np.where(beyond, np.nan, values)}
        return [series._replace(**within), series._replace(**ends)]

    def beyond(self, panels: Sequence[Panel]) -> Beyond:
        series = [each for panel in panels for each in panel.series if each.form != "slope"]
        shown = [each.x if self.y.names else each.y for each in series]
        shown += [panel.tiles.values for panel in panels if panel.tiles is not None]
        shown += [end for each in series if not each.barred for end in (each.low, each.high)]
        sides = [self.values.is_beyond(each) for each in shown if each is not None]
        return any(np.any(low) for low, _ in sides), any(np.any(high) for _, high in sides)

    def told(self, panels: Sequence[Panel]) -> list[str]:
        """The notes, those on these panels, and how points were moved."""
        series = [each for panel in panels for each in panel.series if each.form != "slope"]
        scale, named = self.values, dict[str, list[Mapping[str, Label]]]()
        for panel in panels:
            named.setdefault(panel.note, []).append(panel.labels)
        notes = []
        for note, some in named.items():
            where = choices_words(some, [panel.labels for panel in panels])
            where[MOST_NOTED:] = [f"{len(where) - MOST_NOTED} more"] * (len(where) > MOST_NOTED)
            notes += [f"{note} ({' / '.join(where)})"] * bool(note)
        every = (each for panel in panels for each in panel.series)
        slopes = {each.look.color for each in every if each.form == "slope"}
        found = [BOUNDS_TOLD] * bool(slopes - {style.GREY}) + [FITS_TOLD] * (style.GREY in slopes)
        found += [*self.notes, *notes]
        found += [MOVED_NOTE] * any(each.apart is not None for each in series)
        middle = [each.x if self.y.names else each.y for each in series]
        bars = zip(series, middle, strict=True)
        if any(np.any(scale.bars(each.low, at, each.high)[1]) for each, at in bars if each.barred):
            found.append(BEYOND_NOTE)
        return found
