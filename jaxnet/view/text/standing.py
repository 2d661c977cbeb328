"""Intermediate results of the cells, as lines below the progress bar."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from jaxnet.config.cells import is_leaderless
from jaxnet.statistics.recovery import share_name
from jaxnet.view.text.width import cell_title, four_digits

if TYPE_CHECKING:
    from rich.text import Text

    from jaxnet.runs.tally import Standing, Tally

MOST_LINES = 8  # of cells
OTHER_LINES = (
    5  # lines that are no cell's: the bar, the head, two notes, the one that the cursor is in
)


def standing_lines(tally: "Tally", width: int, height: int) -> "Iterator[str | Text]":
    """Yield a header, a line for each of the worst cells, and notes, as the terminal's height permits.

    Nothing is yielded before the first lanes end, or in a terminal of a few lines.
    """
    found, room = tally.standing(), min(MOST_LINES, height - OTHER_LINES)
    if not found or room < 1:
        return
    from rich.text import Text

    asked = any(np.isfinite(each.unrecovered) for each in found)
    mean = "spread [m]" if is_leaderless(tally.cells) else "tail mean [m]"
    rows = [["so far", "lanes", mean, share_name(tally.cells)]]
    for each in worst_standings(found, room):
        share = f"{each.unrecovered:.3g}" if np.isfinite(each.unrecovered) else "-"
        rows.append([str(each.cell), f"{each.lanes:,}", four_digits(each.mean), share])
    columns = [max(map(len, column)) + 2 for column in zip(*rows, strict=True)][
        1 : 4 if asked else 3
    ]
    left = width - sum(columns)
    names = [rows[0][0], *(cell_title(tally.cells[int(row[0])], left) for row in rows[1:])]
    longest = max(map(len, names))
    for name, (_, *words) in zip(names, rows, strict=True):
        numbers = "".join(f"{word:>{room}}" for word, room in zip(words, columns, strict=False))
        yield Text(f"{name:<{longest}}{numbers}", no_wrap=True)
    if len(tally.cells) > room:
        by = f"shares {share_name(tally.cells)}" if asked else "means"
        yield f"of {len(tally.cells)} cells those with the greatest {by}"
    if tally.last_look:
        yield Text(f"widest interval: {tally.last_look}", no_wrap=True)


def worst_standings(found: "Sequence[Standing]", room: int) -> "list[Standing]":
    """Return the cells with the greatest share unrecovered, then error, in the order of the cells."""
    ranked = sorted(
        found, key=lambda each: (np.nan_to_num(each.unrecovered, nan=-1.0), each.mean), reverse=True
    )
    return sorted(ranked[:room])
