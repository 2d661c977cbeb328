"""Words of drawings: titles of panels and rows, and numbers."""

import re
from collections.abc import Mapping, Sequence
from textwrap import wrap

import numpy as np

from jaxnet.config.naming import key_name, labels_title, value_name
from jaxnet.model.wording import RESULT_DIGITS, number_text
from jaxnet.statistics.amplitude import is_rounding
from jaxnet.statistics.groups import Label, numeric

NO_LANE, NONE_ENDED = "no lane ended", "none ended"
ROUNDED = "0 (rounding)"
BEFORE_UNIT = re.compile(r"(?<=\d) (?=[^\s\d]{1,6}(?!\S))| (?=\[)")
JOINT = "\0"  # in place of such a space
MOST_GONE = 4  # numbers of one key that are not drawn and are named


def lines_within(words: str, letters: float) -> list[str]:
    """Words on lines of so many letters, which part no number from its unit and no W-MSR."""
    kept = BEFORE_UNIT.sub(JOINT, words)
    is_long = any(len(word) > letters for word in kept.split(" "))
    lines = wrap(kept, max(1, int(letters)), break_on_hyphens=is_long)
    return [line.replace(JOINT, " ") for line in lines]


def distinct_titles(labels: Sequence[Mapping[str, Label]]) -> tuple[list[str], str]:
    """A title for each panel or row, of the labels that differ, and a note of the others."""
    common = {}
    if len(labels) > 1:
        common = {k: v for k, v in labels[0].items() if all(v == each[k] for each in labels)}
    titles = [labels_title({k: v for k, v in each.items() if k not in common}) for each in labels]
    return titles, f"all with {labels_title(common)}" if common else ""


def gone_words(
    shown: Sequence[Mapping[str, Label]], there: Sequence[Mapping[str, Label]]
) -> list[str]:
    """The swept values that nothing shown has: all names, and few numbers or their number."""
    found = []
    for key in there[0]:
        values, kept = ({labels[key]: 0 for labels in each} for each in (there, shown))
        gone = [value for value in values if value not in kept]
        if numeric(gone) and len(gone) > MOST_GONE:
            found.append(f"{len(gone)} of {len(values)} values of {key_name(key)}")
        else:
            found += [value_name(key, value) if key else str(value) for value in gone]
    return found


def error_text(
    value: float, scale: float = 1.0, digits: int = RESULT_DIGITS, whole: float = np.inf
) -> str:
    """An error, or an error per ā with scale 1; below rounding "0 (rounding)"; a dash for none.

    An unknown scale counts as 1 m. A scale of 0 switches the test for rounding off.
    """
    if np.isnan(value):
        return "–"
    if is_rounding(value, scale):
        return ROUNDED
    return "∞" if value == np.inf else number_text(value, digits, whole)
