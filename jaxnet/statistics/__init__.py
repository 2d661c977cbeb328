"""Statistics of lanes: summaries, shares unrecovered, fits, and comparisons with bounds."""
