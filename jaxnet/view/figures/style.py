"""Style of all figures: type for two columns, colours that survive grey and colour blindness."""

import io
from os import PathLike
from typing import IO, Any, TypedDict

import matplotlib as mpl
from matplotlib import figure
from matplotlib.typing import LineStyleType

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


class LineStyle(TypedDict):
    """Colour and dashes of a line."""

    color: str
    linestyle: LineStyleType


SERIES_LOOKS: list[tuple[str, tuple[float, ...]]] = [
    (BLUE, ()),
    (RED, (5, 1.5)),
    (GREEN, (1, 1)),
    (PURPLE, (4, 1, 1, 1)),
    (ORANGE, (8, 2)),
    (BLACK, (3, 1, 1, 1, 1, 1)),
]
SERIES_STYLES: list[LineStyle] = [
    {"color": color, "linestyle": (0, dash) if dash else "-"} for color, dash in SERIES_LOOKS
]
GREY = "#737373"  # of what stands back

Style = dict[Any, Any]  # settings of matplotlib by name

LAYOUT: Style = {"figure.constrained_layout.use": True}  # what any style of a figure has
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


class Figure(figure.Figure):
    """A figure with its style in every output, displayed by a notebook."""

    style: Style = PRINT_STYLE

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
