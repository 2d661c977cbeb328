"""How the cells of a run stand while it goes on: lines for below its bar, as many as there is room for."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnet.view.text.width import clipped, number

if TYPE_CHECKING:
    from jaxnet.runs.tally import Standing, Tally

MOST_LINES = 8  # of cells
AROUND = 5  # lines that are no cell's: the bar, the head, two notes, the one that the cursor is in


def lines(tally: "Tally", width: int, height: int) -> Iterator[Any]:
    """A head, a line for each cell, or for the worst of them, and how they were chosen; nothing before there
    are lanes, or in a terminal of a few lines.
    """
    found, room = tally.standing(), min(MOST_LINES, height - AROUND)
    if not found or room < 1:
        return
    from rich.text import Text

    asked = any(np.isfinite(each.unrecovered) for each in found)
    rows = [["so far", "lanes", "tail mean [m]", "unrecovered"]]
    for each in worst(found, room):
        share = f"{each.unrecovered:.3g}" if np.isfinite(each.unrecovered) else "-"
        rows.append([str(each.cell), f"{each.lanes:,}", number(each.mean), share])
    columns = [max(map(len, column)) + 2 for column in zip(*rows, strict=True)][1 : 4 if asked else 3]
    left = width - sum(columns)
    names = [rows[0][0], *(clipped(tally.cells[int(row[0])], left) for row in rows[1:])]
    longest = max(map(len, names))
    for name, (_, *words) in zip(names, rows, strict=True):
        numbers = "".join(f"{word:>{room}}" for word, room in zip(words, columns, strict=False))
        yield Text(f"{name:<{longest}}{numbers}", no_wrap=True)
    if len(tally.cells) > room:
        by = "shares unrecovered" if asked else "means"
        yield f"of {len(tally.cells)} cells those with the greatest {by}"
    if tally.last_look:
        yield Text(f"widest interval: {tally.last_look}", no_wrap=True)


def worst(found: "Sequence[Standing]", room: int) -> "list[Standing]":
    """Those that recover least, then those with the greatest errors; in the order of the cells."""
    ranked = sorted(
        found, key=lambda each: (np.nan_to_num(each.unrecovered, nan=-1.0), each.mean), reverse=True
    )
    return sorted(ranked[:room])
