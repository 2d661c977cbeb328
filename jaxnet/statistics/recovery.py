"""How often the defence fails, as the share of lanes whose mean error stays above τ ā (SCIENCE O6).

And when enough lanes were simulated to say so.

One interval serves both. With a fixed number of lanes it is the exact binomial one of Clopper and Pearson
(1934). Where lanes are added until it is narrow enough, it is looked at again and again, and an interval
honest for one look is not for many; so the i-th look, after 256 · 1.5^(i - 1) samples, has the error
α / (i (i + 1)). These sum to α: with probability 1 - α all intervals that are ever looked at hold at once,
wherever one stops. The looks lie ever further apart, for one that comes after few new lanes costs a part of
the error and says little.
"""

import itertools
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int
from scipy import special

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Criterion, Sequential
from jaxnet.kinds.fields import is_drawn
from jaxnet.statistics.groups import labels_without_magnitude

CONFIDENCE = 0.95
FIRST_LOOK = 256  # samples of a cell at the first look


class RecoveryCounts(NamedTuple):
    """Of each cell, the lanes that ended and those of them that did not recover."""

    unrecovered: Int[np.ndarray, " cells"]
    ended: Int[np.ndarray, " cells"]

    def add(self, cell: Cell, errors: Float[np.ndarray, " lanes"], tau: float) -> None:
        """Count the mean errors [m] of a cell's ok lanes."""
        self.unrecovered[cell.number] += np.count_nonzero(errors > threshold(cell, tau))
        self.ended[cell.number] += len(errors)


def zero_counts(cells: Sequence[Cell]) -> RecoveryCounts:
    """Counts before the first lane."""
    return RecoveryCounts(np.zeros(len(cells), int), np.zeros(len(cells), int))


def threshold(cell: Cell, tau: float) -> float:
    """`τ ā` [m], above which a lane of the cell has not recovered; not-a-number where nobody is attacked."""
    amplitude = cell.scenario.attack.amplitude()
    return tau * amplitude if not is_drawn(amplitude) and amplitude > 0 else np.nan


def clopper_pearson(
    successes: Int[np.ndarray, "*n"], trials: Int[np.ndarray, "*n"], confidence: float
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """Both ends of the exact interval of a share; 0 to 1 where there was no trial."""
    tail = (1.0 - confidence) / 2
    with np.errstate(invalid="ignore"):
        low = special.betaincinv(successes, trials - successes + 1.0, tail)
        high = special.betaincinv(successes + 1.0, trials - successes, 1.0 - tail)
    return np.where(successes == 0, 0.0, low), np.where(successes == trials, 1.0, high)


def below_greatest(draws: int) -> float:
    """Share of all draws that, with 95 % confidence, stay below the greatest of so many: 0.05^(1/n).

    About 1 - 3/n (an order statistic; Wilks, 1941). Of the envelope s·ā the draws are samples, for cells
    share them: it is the greatest of their independent maxima.
    """
    return float((1 - CONFIDENCE) ** (1 / draws))


def samples_at(look: int) -> int:
    """Samples of a cell at a look, from 1: 256, then half as many more each time, rounded up."""
    return -(-FIRST_LOOK * 3 ** (look - 1) // 2 ** (look - 1))


def look_of(samples: int) -> int:
    """The look that so many samples belong to: the first that has as many."""
    return next(look for look in itertools.count(1) if samples_at(look) >= samples)


def looks(there: int, at_most: int) -> Iterator[int]:
    """Samples of a cell after which to look; so many are there or begun, and looked at before any are added.

    No two of them belong to one look, also over runs that each allow more: so the errors sum to no more than
    they may.
    """
    if there:
        yield there
    for look in itertools.count(look_of(there) + 1 if there else 1):
        if look > 1 and at_most <= samples_at(look - 1):
            return
        yield min(samples_at(look), at_most)


def confidence_at(look: int, confidence: float) -> float:
    """Confidence of one look, so that all looks hold at once with `confidence`."""
    return 1.0 - (1.0 - confidence) / (look * (look + 1))


def confidence_of(asked: int | Sequential, samples: int) -> float:
    """Confidence of the interval to be told: the ordinary one, or that of the look that ended the run."""
    if not isinstance(asked, Sequential):
        return CONFIDENCE
    return confidence_at(look_of(samples), asked.until.confidence)


def confidence_told(samples: int | Sequential) -> float:
    """Confidence that the intervals of `cells.csv` have, however often was looked."""
    return samples.until.confidence if isinstance(samples, Sequential) else CONFIDENCE


def widest_half_interval(
    counts: RecoveryCounts, cells: Sequence[Cell], samples: int, criterion: Criterion
) -> float:
    """Half the widest interval of the attacked cells, at so many samples of a cell, which says when to stop.

    A cell none of whose lanes ended is not waited for.
    """
    low, high = clopper_pearson(*counts, confidence_at(look_of(samples), criterion.confidence))
    asked = attacked_mask(cells) & (counts.ended > 0)
    return float((high - low)[asked].max(initial=0.0)) / 2


def attacked_mask(cells: Sequence[Cell]) -> Bool[np.ndarray, " cells"]:
    """Cells in which somebody is attacked."""
    return np.array([threshold(cell, 1.0) > 0 for cell in cells])


def unrecovered_columns(counts: RecoveryCounts, cells: Sequence[Cell], confidence: float) -> pd.DataFrame:
    """Columns of `cells.csv`; not-a-number where nobody is attacked, or no lane ended."""
    low, high = clopper_pearson(*counts, confidence)
    asked = attacked_mask(cells) & (counts.ended > 0)
    share = counts.unrecovered / np.maximum(counts.ended, 1)
    columns = {"unrecovered": share, "unrecovered_low": low, "unrecovered_high": high}
    return pd.DataFrame({name: np.where(asked, values, np.nan) for name, values in columns.items()})


def worst_lanes(rows: pd.DataFrame, cells: Sequence[Cell], number: int) -> list[tuple[int, int]]:
    """Cell and sample of those of some ok lanes that have the greatest mean error for their ā.

    First the worst lane of each group of cells that differ in ā alone, then the second of each, and so on:
    otherwise one group would often fill the list with lanes that are all alike.
    """
    scale = np.array([threshold(cell, 1.0) for cell in cells])
    groups = np.array([str(labels_without_magnitude(cell)) for cell in cells])
    lanes = pd.DataFrame(
        {
            "cell": rows["cell"],
            "sample": rows["sample"],
            "ratio": rows["tail_mean"] / scale[rows["cell"]],
            "group": groups[rows["cell"]],
        }
    ).dropna()
    lanes = lanes.sort_values("ratio", ascending=False, kind="stable")
    lanes["place"] = lanes.groupby("group").cumcount()
    chosen: Any = lanes.sort_values(["place", "ratio"], ascending=[True, False], kind="stable").head(number)
    return list(zip(chosen["cell"].tolist(), chosen["sample"].tolist(), strict=True))
