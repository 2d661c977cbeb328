"""How a run stands while it goes on: what is told of each shard that is there, and of all of them by cell."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from jaxnet.config.cells import Cell
from jaxnet.engine import batch
from jaxnet.statistics.recovery import RecoveryCounts, attacked_mask, threshold


class Sums(NamedTuple):
    """Counts of lanes, and the sum over those that are ok of their mean errors [m]."""

    lanes: int
    ok: int
    unrecovered: int
    errors: float


class Done(NamedTuple):
    """What is told of a shard whose rows are there."""

    shard: int
    cell: int
    sums: Sums


class Standing(NamedTuple):
    """A cell on the way: its mean error [m], and the share unrecovered.

    `unrecovered` is not-a-number where nobody is attacked or recovery is not asked for.
    """

    cell: int
    lanes: int
    mean: float
    unrecovered: float


def sums_of(cell: Cell, rows: pd.DataFrame, tau: float | None) -> Sums:
    """Of a cell's rows: their `status` and `tail_mean`; without τ nobody counts as unrecovered."""
    errors = rows["tail_mean"].to_numpy()[rows["status"].to_numpy() == "ok"]
    over = 0 if tau is None else np.count_nonzero(errors > threshold(cell, tau))
    return Sums(len(rows), len(errors), int(over), float(errors.sum()))


class Tally:
    """Counts lanes cell by cell; those of an unfinished shard count as done, and for nothing else."""

    def __init__(self, cells: Sequence[Cell], total: int, recovery: bool):
        self.cells, self.total, self.recovery = cells, total, recovery
        self.shards: dict[int, Sums] = {}
        self.sums = np.zeros((len(cells), len(Sums._fields)))
        self.under_way = 0
        self.aim, self.last_look = total, ""  # lanes until the next look, and what the last one saw

    @property
    def done(self) -> int:
        """Lanes that came to their end."""
        return int(self.sums[:, 0].sum()) + self.under_way

    @property
    def failed(self) -> int:
        """Lanes that failed, of shards that are there."""
        return int((self.sums[:, 0] - self.sums[:, 1]).sum())

    @property
    def counts(self) -> RecoveryCounts:
        """Of each cell, the lanes that ended and those of them that did not recover."""
        return RecoveryCounts(self.sums[:, 2].astype(int), self.sums[:, 1].astype(int))

    @property
    def compiling(self) -> bool:
        """Whether a program is being compiled in this process."""
        return batch.compiling()

    def there(self, found: Iterable[Done]) -> None:
        """Of these shards these lanes are there; of each what was told last holds."""
        for shard, cell, sums in found:
            before = self.shards.get(shard, Sums(0, 0, 0, 0.0))
            with np.errstate(invalid="ignore"):  # infinite ones
                self.sums[cell] += np.subtract(sums, before)
            self.under_way = max(0, self.under_way - (sums.lanes - before.lanes))
            self.shards[shard] = sums

    def standing(self) -> list[Standing]:
        """Of each cell that has ok lanes."""
        lanes, ok, over, errors = self.sums.T
        with np.errstate(all="ignore"):
            share = np.where(attacked_mask(self.cells) & self.recovery, over / ok, np.nan)
            columns = np.stack([errors / ok, share], axis=1).tolist()
        return [
            Standing(number, int(lanes[number]), *columns[number]) for number in np.flatnonzero(ok).tolist()
        ]
