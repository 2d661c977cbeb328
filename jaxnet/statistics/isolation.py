"""In how many lanes a vehicle was cut off from its sources and coasted, or came to rest."""

from collections.abc import Sequence

import numpy as np

from jaxnet.config.cells import Cell
from jaxnet.model.wording import Named, count
from jaxnet.store import rows
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results

ISOLATED = {  # by column of rows, where vehicles coast or may stop
    "cut_off_vehicles": "a vehicle was cut off from all its sources",
    "stopped": "a vehicle came to rest",
}
MOST_GROUPS_TOLD = 3  # numbers of lanes; of more the sum over cells is told


def isolation_columns(results: Results) -> list[str]:
    """The columns of ISOLATED that rows have; none where that takes the code of a kind."""
    study = results.study
    known = known_or([], lambda: [*rows.row_columns(study.config, study.cells).isolation])
    return [column for column in ISOLATED if column in known]


def isolated_lanes(results: Results) -> dict[str, dict[int, tuple[int, int]]]:
    """In how many lanes of each cell something happened to a vehicle, of how many that ended.

    The keys are its words; what happened in no lane has none.
    """
    found = dict[str, dict[int, tuple[int, int]]]()
    for column in isolation_columns(results):
        lanes = {
            cell: (int(np.sum(each[column].to_numpy() > 0)), len(each))
            for cell, each in results.by_cell(column, where=rows.OK)
        }
        if any(many for many, _ in lanes.values()):
            found[ISOLATED[column]] = lanes
    return found


def isolated_lines(results: Results, cells: Sequence[Cell], named: Named) -> list[str]:
    """Sentences on those of these cells in which it happened, by the number of such lanes."""
    numbers, told = {cell.number for cell in cells}, list[str]()
    for words, lanes in isolated_lanes(results).items():
        there = {cell: each for cell, each in lanes.items() if each[0] and cell in numbers}
        alike: dict[tuple[int, int], list[int]] = {}
        for cell, each in there.items():
            alike.setdefault(each, []).append(cell)
        summed = len(alike) > MOST_GROUPS_TOLD
        if summed:
            many, of = map(sum, zip(*there.values(), strict=True))
            alike = {(many, of): [*there]}
        parts = []
        for (many, of), some in alike.items():
            where = f" of {'each of ' * (len(some) > 1 and not summed)}{named(some)}"
            parts.append(f"in {many:,} of {count(of, 'lane')}{where * (len(cells) > 1)}")
        told += [f"{words[0].upper()}{words[1:]}: {'; '.join(parts)}"] * bool(there)
    return told
