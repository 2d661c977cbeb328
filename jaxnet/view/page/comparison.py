"""The page `compare.html`: a comparison of two studies, built from the elements of the report."""

from html import escape
from pathlib import PurePath

import numpy as np
import pandas as pd

from jaxnet.statistics.pairs import Comparison
from jaxnet.view import page
from jaxnet.view.page.elements import Section, paragraph, sortable_table
from jaxnet.view.text import comparison

MOST_CHANGED = 1000  # lanes that the page lists


def comparison_page(found: Comparison) -> str:
    a, b = (escape(PurePath(folder).name) for folder in found.folders)
    columns = comparison.comparison_columns(found)
    lead = f"B is {b}, A is {a}. {escape(comparison.comparison_legend(found, columns))}"
    rows = pd.DataFrame({each.title: each.scaled() for each in columns})
    lengths = {each.title: np.ones(len(rows)) for each in columns if "[m]" in each.title}
    intervals = {each.title: each.intervals() for each in columns if any(each.intervals())}
    changed = lanes_table(found.changed, "No lane changed sides.")
    failed = lanes_table(found.failed, "No lane failed in either study.")
    differing = paragraph("They are the same study.")
    if len(found.settings):
        differing = sortable_table(found.settings)
    if found.alone:
        alone = escape("; ".join(found.alone))
        differing += paragraph(f"Not compared, for the other has none like it: {alone}.")
    shown = [
        Section("differ", "What differs", differing),
        Section("differences", "Differences, B − A", sortable_table(rows, lengths, intervals)),
        Section("changed", "Lanes that changed sides", changed),
        Section("failed", "Failed lanes", failed),
    ]
    return page.page_html(f"{b} against {a}", lead, shown)


def lanes_table(lanes: pd.DataFrame, none: str) -> str:
    """The first MOST_CHANGED lanes, or the text `none`."""
    if lanes.empty:
        return paragraph(none)
    more = len(lanes) > MOST_CHANGED
    note = paragraph(f"The first {MOST_CHANGED:,} of {len(lanes):,}.") if more else ""
    return note + sortable_table(lanes.head(MOST_CHANGED))
