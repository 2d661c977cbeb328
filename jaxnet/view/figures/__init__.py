"""Figures for print, as PNG and PDF; their names, which the command line knows without drawing."""

ULTIMATE = ("ultimate", "ultimate_mean")
HEAT = ("heat", "heat_worst")
SEARCH = ("search", "search_worst")
SENSITIVITY = ("sensitivity", "sensitivity_unrecovered")
NAMES = ("topologies", "tails", "panels", "bands", "unrecovered", *HEAT, *ULTIMATE, *SEARCH, *SENSITIVITY)
COLUMNS = {"one": 3.5, "two": 7.16}  # [in] widths that a two-column journal has
