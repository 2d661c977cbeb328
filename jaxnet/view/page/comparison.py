"""The page `compare.html`: a comparison of two studies, built from the elements of the report."""

from html import escape
from pathlib import PurePath

import numpy as np
import pandas as pd

from jaxnet.statistics.pairs import Comparison
from jaxnet.view import page
from jaxnet.view.page.elements import sortable_table
from jaxnet.view.page.sections import Section
from jaxnet.view.text import comparison

MOST_CHANGED = 1000  # lanes that the page lists


def comparison_page(found: Comparison) -> str:
    """Return the comparison as an HTML page."""
    a, b = (escape(PurePath(folder).name) for folder in found.folders)
    lead = f"B is {b}, A is {a}. {escape(comparison.comparison_legend(found))}"
    shown = [
        Section("differ", "What differs", settings_table(found)),
        Section("differences", "Differences, B − A", differences_table(found)),
        Section(
            "changed",
            "Lanes that changed sides",
            lanes_table(found.changed, "No lane changed sides."),
        ),
        Section(
            "failed", "Failed lanes", lanes_table(found.failed, "No lane failed in either study.")
        ),
    ]
    return page.page_html(f"{b} against {a}", lead, shown)


def settings_table(found: Comparison) -> str:
    """Return a table of the keys that differ, and the cells that have no counterpart."""
    body = (
        sortable_table(found.settings) if len(found.settings) else "<p>They are the same study.</p>"
    )
    if found.alone:
        body += f"<p>Not compared, for the other has none like it: {escape('; '.join(found.alone))}.</p>"
    return body


def differences_table(found: Comparison) -> str:
    """Return the table of pairs of cells; differences below rounding are marked."""
    table = comparison.comparison_rows(found)
    lengths = comparison.length_columns(table)
    return sortable_table(table, scales=dict.fromkeys(lengths, np.ones(len(table))))


def lanes_table(lanes: pd.DataFrame, none: str) -> str:
    """Return a table of the first MOST_CHANGED lanes, or the text `none` if there is no lane."""
    if lanes.empty:
        return f"<p>{none}</p>"
    more = len(lanes) - MOST_CHANGED
    note = f"<p>The first {MOST_CHANGED:,} of {len(lanes):,}.</p>" if more > 0 else ""
    return note + sortable_table(lanes.head(MOST_CHANGED))
