"""Style of all figures: type for two columns, colours that survive grey and colour blindness."""

import io
import re
from collections.abc import Sequence
from os import PathLike
from typing import IO, Any

import matplotlib as mpl
from matplotlib import figure
from matplotlib.font_manager import FontProperties, findfont
from matplotlib.path import Path
from matplotlib.transforms import Affine2D

from jaxnet.store.folder import FolderError
from jaxnet.view.figures import COLUMN_WIDTHS

FIGURE_WIDTH = COLUMN_WIDTHS["two"]  # [in]
GREATEST_HEIGHT = 9.4  # [in] of a figure: what a page has beside a caption

# Okabe and Ito's palette; what must be told apart also differs in line style or marker.
BLUE, ORANGE, GREEN, RED, PURPLE, SKY, BLACK = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
    "#000000",
)
BROWN = "#6B3E00"  # of one line more, by all eyes told from the palette

SERIES_LOOKS: list[tuple[str, tuple[float, ...]]] = [
    (BLUE, ()),
    (RED, (5, 1.5)),
    (GREEN, (1, 1)),
    (PURPLE, (4, 1, 1, 1)),
    (ORANGE, (8, 2)),
    (BLACK, (3, 1, 1, 1, 1, 1)),
]
SERIES_STYLES: list[dict[str, Any]] = [
    {"color": color, "linestyle": (0, dash) if dash else "-"} for color, dash in SERIES_LOOKS
]
GREY = "#737373"  # of what stands back

LIMITED = ORANGE  # of a vehicle whose input is at its limit
POINTER = Path(((0.9, 0.0), (-0.6, 0.55), (-0.6, -0.55), (0.9, 0.0)), closed=True)


def pointer(heading: float) -> Path:
    """A triangle that points along a heading [°]."""
    return POINTER.transformed(Affine2D().rotate_deg(heading))


Style = dict[Any, Any]  # settings of matplotlib by name

LAYOUT: Style = {  # what any style of a figure has
    "figure.constrained_layout.use": True,
    "figure.figsize": (FIGURE_WIDTH, GREATEST_HEIGHT),
}
PRINT_STYLE: Style = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "lines.linewidth": 1.0,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    **LAYOUT,
    "savefig.dpi": 300,
    "pdf.fonttype": 42,
}


FigureSize = str | tuple[float, float]  # "86x64mm", "3.4x2.5", or a pair in inches
SIZE = re.compile(r"([\d.]+)x([\d.]+)(mm|in)?")
ENDS_OF_SIZES, ENDS_OF_TYPE = (1.0, 50.0), (4.0, 40.0)  # [in], [pt]


def inches(size: FigureSize | None) -> tuple[float, float] | None:
    """Width and height [in]; raises FolderError if they are none, or beyond 1 to 50 in."""
    if size is None:
        return None
    given, unit = size, "in"
    if isinstance(size, str):
        match = SIZE.fullmatch(size)
        given, unit = (match.groups()[:2], match[3]) if match else ((), "in")
    try:
        width, height = (float(each) / (25.4 if unit == "mm" else 1.0) for each in given)
    except (TypeError, ValueError):
        width = height = 0.0
    if not all(ENDS_OF_SIZES[0] <= each <= ENDS_OF_SIZES[1] for each in (width, height)):
        told = "WIDTHxHEIGHT of 1 to 50 in, such as 3.4x2.5 in inches or 86x64mm"
        raise FolderError(f"size: {told} (got {size})")
    return width, height


def with_font(base: Style, size: float | None, family: str | None) -> Style:
    """A style with type of a size [pt], all other type in proportion, and of a family."""
    found = dict(base)
    if size is not None:
        low, high = ENDS_OF_TYPE
        if not low <= size <= high:
            raise FolderError(f"font_size: {low:g} to {high:g} pt (got {size:g})")
        scale = size / base.get("font.size", size)
        found |= {
            key: scale * each
            for key, each in base.items()
            if key.endswith("size") and not isinstance(each, tuple)
        }
        found["font.size"] = size
    if family is not None:
        try:
            findfont(FontProperties(family=family), fallback_to_default=False)
        except ValueError as error:
            raise FolderError(f"font: no font {family} is installed") from error
        found["font.family"] = family
    return found


class Figure(figure.Figure):
    """A figure with its style in every output, displayed by a notebook."""

    style: Style = PRINT_STYLE
    left_out = ""  # what is not drawn
    cells: Sequence[int] = ()  # numbers of those that panels are about
    height = 0.0  # [in] that it would take, were its size not given

    def savefig(
        self,
        fname: str | PathLike[str] | io.BytesIO | IO[bytes],
        *,
        transparent: bool | None = None,
        **options: object,
    ) -> None:
        with mpl.rc_context(self.style):
            super().savefig(fname, transparent=transparent, **options)

    def _repr_png_(self) -> bytes:
        content = io.BytesIO()
        self.savefig(content, format="png", dpi=self.dpi)
        return content.getvalue()
