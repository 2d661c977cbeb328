"""Words of drawings: titles of panels and rows, and numbers."""

from collections.abc import Mapping, Sequence

import numpy as np

from jaxnet.config.naming import labels_title
from jaxnet.statistics.groups import Label
from jaxnet.view.columns import is_rounding
from jaxnet.view.text.width import four_digits


def distinct_titles(labels: Sequence[Mapping[str, Label]]) -> tuple[list[str], str]:
    """A title for each panel or row, of the labels that differ, and a note of the others."""
    common = {}
    if len(labels) > 1:
        common = {k: v for k, v in labels[0].items() if all(v == each[k] for each in labels)}
    titles = [labels_title({k: v for k, v in each.items() if k not in common}) for each in labels]
    return titles, f"all with {labels_title(common)}" if common else ""


def three_digits(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.3g}"


def error_text(value: float, scale: float = 1.0) -> str:
    """An error, or an error per ā with scale 1; below rounding "0 (rounding)".

    An unknown scale counts as 1 m. A scale of 0 switches the test for rounding off.
    """
    if is_rounding(value, scale):
        return "0 (rounding)"
    return "∞" if value == np.inf else four_digits(value)
