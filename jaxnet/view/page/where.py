"""Words for some cells of a study: the swept values that they share, and ranges of numbers."""

from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import pandas as pd

from jaxnet.config.cells import Cell
from jaxnet.config.naming import choices_words, labels_title, values_named
from jaxnet.model.wording import cells_named
from jaxnet.statistics.groups import swept_values_of
from jaxnet.statistics.intervals import CONFIDENCE
from jaxnet.store.results import Results

MOST_TOLD = 3  # values of a swept key for a few cells, or products of such values
MOST_LETTERS = 150  # of words for cells that are not alike


def where_words(results: Results, numbers: Sequence[int], among: Sequence[int] = ()) -> str:
    """The swept values that some of the cells `among` have alone; else the number of cells."""
    cells = [results.study.cells[n] for n in among or range(len(results.study.cells))]
    labels, many = results.study.cells[numbers[0]].labels, len(numbers)
    if not labels:
        return ""
    if many == len(cells) > 1:
        part = len(cells) < len(results.study.cells)
        return f"in each of {many} cells" if part else "in every cell"
    varied = (key for key, values in swept_values_of(cells).items() if len(values) > 1)
    first = escape(labels_title({key: labels[key] for key in varied}) or labels_title(labels))
    if many == 1:
        return f"with {first} (cell {numbers[0]})"
    words, alike = values_in_common(results, numbers, cells)
    if not words or alike > many:
        mine = [results.study.cells[n].labels for n in numbers]
        there = [cell.labels for cell in cells]
        told = "; or with ".join(escape(each) for each in choices_words(mine, there))
        short = len(told) <= MOST_LETTERS
        return f"with {told} ({many} cells)" if short else f"in {cells_named(numbers)}"
    return f"with {escape(words)} ({many} cells)"


def values_in_common(
    results: Results, numbers: Sequence[int], among: Sequence[Cell]
) -> tuple[str, int]:
    """The few swept values that these of the cells `among` have, and how many cells have them."""
    mine, there = (
        swept_values_of(each) for each in ([results.study.cells[n] for n in numbers], among)
    )
    alike = sum(all(cell.labels[key] in mine[key] for key in mine) for cell in among)
    told = {key: values for key, values in mine.items() if len(values) < len(there[key])}
    if max(map(len, told.values()), default=0) > MOST_TOLD:
        return "", alike
    words = (values_named(key, values, "or") for key, values in told.items())
    return ", ".join(words), alike


def span_words(
    results: Results,
    values: pd.DataFrame,
    told: Callable[[float], str],
    unit: str,
    among: Sequence[int],
    sure: float = CONFIDENCE,
) -> str:
    """The least and the greatest value, each with its interval and cells; one if they read alike.

    `values` have the columns value, low and high; `told` is the text of a number.
    """
    texts: Any = values["value"].map(told)

    def part(place: Any) -> str:
        alike: Any = values[texts == texts[place]]
        ends = [dict.fromkeys(map(told, alike[end].dropna())) for end in ("low", "high")]
        interval = ""
        if all(ends) and not {*ends[0], *ends[1]} <= {texts[place], "0", "0 (rounding)"}:
            within = "s within" * (max(map(len, ends)) > 1)
            low, high = told(alike["low"].min()), told(alike["high"].max())
            interval = f" ({100 * sure:g} % interval{within} {low} to {high}{unit})"
        where = where_words(results, alike.index.tolist(), among)
        return f"<b>{texts[place]}{unit}</b>{interval} {where}".rstrip()

    least, most = values["value"].idxmin(), values["value"].idxmax()
    if texts[least] == texts[most]:
        return f"is {part(most)}"
    return f"ranges from {part(least)} to {part(most)}"


def joined_names(names: Sequence[str], word: str = "and") -> str:
    return f" {word} ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))
