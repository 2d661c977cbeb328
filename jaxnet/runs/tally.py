"""The state of a run in progress: reports on finished shards, and their sums cell by cell."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Recovery
from jaxnet.engine import programs
from jaxnet.statistics.recovery import RecoveryCounts, attacked_mask, threshold

LAST_PHASE = "writing results"  # the phase after all simulation


class Sums(NamedTuple):
    """Numbers of lanes, and the sum of the judged metric [m] of ok lanes."""

    lanes: int
    ok: int
    unrecovered: int
    errors: float


class Done(NamedTuple):
    shard: int
    cell: int
    sums: Sums


class Standing(NamedTuple):
    cell: int
    lanes: int
    mean: float  # of its judged metric [m]
    unrecovered: float  # share; not-a-number without an attack or without recovery


def sums_of(cell: Cell, rows: pa.Table | pd.DataFrame, asked: Recovery | None) -> Sums:
    """Sum a cell's rows, by `status` and judged metric; without a criterion all recover."""
    errors = rows[cell.scenario.judged].to_numpy()[rows["status"].to_numpy() == "ok"]
    over = np.count_nonzero(errors > threshold(cell, asked))
    return Sums(len(rows), len(errors), int(over), float(errors.sum()))


class Tally:
    """Counts of lanes by cell. A lane of an unfinished shard counts as done, in no other sum.

    `phase` says what the run does once all lanes are done; progress reads it whenever it is shown.
    """

    def __init__(self, cells: Sequence[Cell], total: int, recovery: bool):
        self.cells, self.total, self.recovery = cells, total, recovery
        self.shards: dict[int, Sums] = {}
        self.sums = np.zeros((len(cells), len(Sums._fields)))
        self.under_way, self.phase = 0, LAST_PHASE
        self.aim, self.last_look = total, ""  # lanes until the next look, and what the last one saw

    @property
    def done(self) -> int:
        return int(self.sums[:, 0].sum()) + self.under_way

    @property
    def failed(self) -> int:
        return int((self.sums[:, 0] - self.sums[:, 1]).sum())

    @property
    def counts(self) -> RecoveryCounts:
        return RecoveryCounts(self.sums[:, 2].astype(int), self.sums[:, 1].astype(int))

    @property
    def compiling(self) -> bool:
        return programs.compiling()

    def record(self, found: Iterable[Done]) -> None:
        """Record finished shards. A later record of a shard replaces an earlier one."""
        for shard, cell, sums in found:
            before = self.shards.get(shard, Sums(0, 0, 0, 0.0))
            with np.errstate(invalid="ignore"):  # infinite ones
                self.sums[cell] += np.subtract(sums, before)
            self.under_way = max(0, self.under_way - (sums.lanes - before.lanes))
            self.shards[shard] = sums

    def standing(self) -> list[Standing]:
        lanes, ok, over, errors = self.sums.T
        with np.errstate(all="ignore"):
            share = np.where(attacked_mask(self.cells) & self.recovery, over / ok, np.nan)
            columns = np.stack([errors / ok, share], axis=1).tolist()
        return [
            Standing(number, int(lanes[number]), *columns[number])
            for number in np.flatnonzero(ok).tolist()
        ]
