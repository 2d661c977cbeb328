"""Statistics of rows: one line per cell."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Int

from jaxnet.config.cells import Cell
from jaxnet.config.keys import RANDOMISATIONS, Config
from jaxnet.kinds.metrics import CONTRACT
from jaxnet.statistics import means, recovery
from jaxnet.statistics.limits import ceilings
from jaxnet.statistics.recovery import CONFIDENCE
from jaxnet.store import rows
from jaxnet.store.folder import Folder
from jaxnet.store.layout import Shard

SUMMARISED = ("tail_mean", "tail_max")  # norms, so not negative
UNTOLD = "no interval of a mean holds without a bound on every lane: an end is blank where theory gives none"

Range = tuple[float, float]  # least and greatest of a metric
UNBOUNDED = -np.inf, np.inf


def summarise(
    folder: Folder, shards: Sequence[Shard], cells: Sequence[Cell], study: Config, samples: int
) -> pd.DataFrame:
    """`cells.csv`: swept keys, lanes, ok, failed, the spread of the tail errors over ok lanes.

    And, if asked for, the share that did not recover; `samples` of a cell are those that all shards have.
    """
    table, counts, metrics = [], recovery.nobody(cells), summarised(study)
    confidence = recovery.confidence_of(study.samples, samples)
    for number, lanes in rows.scan_cells(folder, shards, ("sample", "status", *metrics)):
        ok: Any = lanes[lanes["status"] == "ok"]
        row = {**cells[number].labels, "lanes": len(lanes), "ok": len(ok), "failed": len(lanes) - len(ok)}
        ranges = ranges_of(study, cells[number], ok["sample"].tolist())
        drawn = units(study, ok["sample"].to_numpy())
        for metric in metrics:
            found = spread(ok[metric].to_numpy(), ranges.get(metric, UNBOUNDED), drawn, confidence)
            row |= {f"{metric}_{name}": value for name, value in found.items()}
        table.append(row)
        if study.recovery is not None:
            counts.add(cells[number], ok["tail_mean"].to_numpy(), study.recovery.tau)
    cells_table = pd.DataFrame(table)
    if study.recovery is None:
        return cells_table
    return cells_table.join(recovery.shares(counts, cells, confidence))


def ranges_of(study: Config, cell: Cell, samples: Sequence[int]) -> dict[str, Range]:
    """Range [m] of the tail errors of some lanes of a cell: from 0 to the greatest that theory allows."""
    return {metric: (0.0, most) for metric, most in ceilings(study, cell, samples).items()}


def summarised(study: Config) -> list[str]:
    """Metrics that tables show: the tail errors, and what the study measures besides the contract."""
    return [*SUMMARISED, *(metric.name for metric in study.measured()[len(CONTRACT) :])]


def units(study: Config, samples: Int[np.ndarray, " lanes"]) -> Int[np.ndarray, " lanes"] | None:
    """The sequence that each sample is of, which are independent; None where the samples themselves are."""
    if study.draws == "random" or not isinstance(study.samples, int):
        return None
    return samples // (study.samples // RANDOMISATIONS)


def units_told(study: Config) -> str:
    """What means have their intervals over."""
    return "lanes" if study.draws == "random" else f"the means of {RANDOMISATIONS} scrambled sequences"


def spread(
    values: np.ndarray,
    within: Range,
    units: Int[np.ndarray, " lanes"] | None = None,
    confidence: float = CONFIDENCE,
) -> dict[str, float]:
    """Mean with its interval, median, quantiles and maximum; not-a-number where there is no lane.

    The interval rests on the range that values are `within`: an end whose bound is infinite is not-a-number.
    Lanes of one of the `units` are not independent of each other; the units are.
    """
    if not len(values):
        return dict.fromkeys(("mean", "low", "high", "median", "q05", "q95", "max"), np.nan)
    sums, counts = values, None
    with np.errstate(invalid="ignore"):  # infinite ones have no spread
        if units is not None:
            _, number, counts = np.unique(units, return_inverse=True, return_counts=True)
            sums, counts = np.bincount(number, values), counts.astype(float)
        low, high = means.ends(sums, *within, confidence, counts)
        q05, median, q95 = np.quantile(values, [0.05, 0.5, 0.95])
    ends = {"mean": values.mean(), "low": low, "high": high}
    return ends | {"median": median, "q05": q05, "q95": q95, "max": values.max()}
