"""Figures for print, as PNG and PDF. Their names stand here: the command line need not draw."""

ULTIMATE = ("ultimate", "ultimate_mean")
HEAT = ("heat", "heat_worst")
SEARCH = ("search", "search_worst")
SENSITIVITY = ("sensitivity", "sensitivity_unrecovered")
FIGURE_NAMES = (
    "curve",
    "answer",
    "topologies",
    "tails",
    "panels",
    "bands",
    "vehicles",
    *HEAT,
    *ULTIMATE,
    *SEARCH,
    *SENSITIVITY,
)
AXES_OF = {  # arguments of figures that are axes
    "curve": ("x", "y", "hue", "panel"),
    "bands": ("y", "hue"),
    **dict.fromkeys(("answer", *HEAT), ("x", "hue", "panel")),
}
COLUMN_WIDTHS = {"one": 3.5, "two": 7.16}  # [in] widths that a two-column journal has
