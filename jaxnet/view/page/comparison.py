"""`compare.html`: two studies held against each other, made of what the report's page is made of."""

from html import escape
from pathlib import PurePath

import numpy as np
import pandas as pd

from jaxnet.statistics.pairs import Comparison
from jaxnet.view import page
from jaxnet.view.page.elements import sortable
from jaxnet.view.page.sections import Section
from jaxnet.view.text import comparison

MOST_CHANGED = 1000  # lanes that the page lists


def html(found: Comparison) -> str:
    """The page."""
    a, b = (escape(PurePath(folder).name) for folder in found.folders)
    lead = f"B is {b}, A is {a}. {escape(comparison.LEGEND)}"
    shown = [
        Section("differ", "What differs", settings_table(found)),
        Section("differences", "Differences, B − A", differences(found)),
        Section("changed", "Lanes that changed sides", lanes_table(found.changed, "No lane changed sides.")),
        Section("failed", "Failed lanes", lanes_table(found.failed, "No lane failed in either study.")),
    ]
    return page.whole(f"{b} against {a}", lead, shown)


def settings_table(found: Comparison) -> str:
    """The keys in which the studies differ, and the cells that stand alone."""
    body = sortable(found.settings) if len(found.settings) else "<p>They are the same study.</p>"
    if found.alone:
        body += f"<p>Not compared, for the other has none like it: {escape('; '.join(found.alone))}.</p>"
    return body


def differences(found: Comparison) -> str:
    """The table of pairs of cells; errors that are rounding are shown as such."""
    table = comparison.rows(found)
    errors = [str(name) for name in table if "mean" in str(name) or "max" in str(name)]
    return sortable(table, scales=dict.fromkeys(errors, np.ones(len(table))))


def lanes_table(lanes: pd.DataFrame, none: str) -> str:
    """These lanes, or that there is none."""
    if lanes.empty:
        return f"<p>{none}</p>"
    more = len(lanes) - MOST_CHANGED
    note = f"<p>The first {MOST_CHANGED:,} of {len(lanes):,}.</p>" if more > 0 else ""
    return note + sortable(lanes.head(MOST_CHANGED))
