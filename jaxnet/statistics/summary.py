"""Statistics of rows: one line per cell."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Int
from scipy import special

from jaxnet.config.cells import Cell
from jaxnet.config.keys import RANDOMISATIONS, Config
from jaxnet.kinds.metrics import CONTRACT
from jaxnet.statistics import recovery
from jaxnet.store import rows
from jaxnet.store.folder import Folder
from jaxnet.store.layout import Shard

SUMMARISED = ("tail_mean", "tail_max")  # norms, so their means are not negative
CONFIDENCE = 0.95


def summarise(
    folder: Folder, shards: Sequence[Shard], cells: Sequence[Cell], study: Config, samples: int
) -> pd.DataFrame:
    """`cells.csv`: swept keys, lanes, ok, failed, the spread of the tail errors over ok lanes.

    And, if asked for, the share that did not recover; `samples` of a cell are those that all shards have.
    """
    table, counts, metrics = [], recovery.nobody(cells), summarised(study)
    for number, lanes in rows.scan(folder, shards, ("sample", "status", *metrics)):
        ok: Any = lanes[lanes["status"] == "ok"]
        row = {**cells[number].labels, "lanes": len(lanes), "ok": len(ok), "failed": len(lanes) - len(ok)}
        for metric in metrics:
            least = 0.0 if metric in SUMMARISED else -np.inf
            found = spread(ok[metric].to_numpy(), least, units(study, ok["sample"].to_numpy()))
            row |= {f"{metric}_{name}": value for name, value in found.items()}
        table.append(row)
        if study.recovery is not None:
            counts.add(cells[number], ok["tail_mean"].to_numpy(), study.recovery.tau)
    cells_table = pd.DataFrame(table)
    if study.recovery is None:
        return cells_table
    return cells_table.join(recovery.shares(counts, cells, recovery.confidence_of(study.samples, samples)))


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
    values: np.ndarray, least: float, units: Int[np.ndarray, " lanes"] | None = None
) -> dict[str, float]:
    """Mean with its t interval, median, quantiles and maximum; not-a-number where there is no lane.

    `least` is what a mean can be at least: the interval does not go below it. Where lanes are of
    `units`, the means of these are what is independent.
    """
    count = len(values)
    if count == 0:
        return dict.fromkeys(("mean", "low", "high", "median", "q05", "q95", "max"), np.nan)
    mean, half = values.mean(), np.nan
    with np.errstate(invalid="ignore"):  # infinite ones have no spread
        means = values
        if units is not None:
            _, number = np.unique(units, return_inverse=True)
            means = np.bincount(number, values) / np.bincount(number)
        if len(means) > 1:
            quantile = special.stdtrit(len(means) - 1, (1 + CONFIDENCE) / 2)
            half = quantile * means.std(ddof=1) / np.sqrt(len(means))
        q05, median, q95 = np.quantile(values, [0.05, 0.5, 0.95])
    return {
        "mean": mean,
        "low": np.maximum(mean - half, least),
        "high": mean + half,
        "median": median,
        "q05": q05,
        "q95": q95,
        "max": values.max(),
    }
