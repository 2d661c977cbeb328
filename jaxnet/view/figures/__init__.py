"""Figures for print, as PNG and PDF; their names, which the command line knows without drawing."""

ULTIMATE = ("ultimate", "ultimate_mean")
NAMES = ("topologies", "tails", "panels", "bands", "unrecovered", *ULTIMATE)
