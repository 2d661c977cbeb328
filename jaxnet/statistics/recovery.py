"""How often the defence fails: the share of lanes whose mean error stays above τ ā (theorems.md
O6).

Without a navigator, the spread counts in place of the mean error: such lanes end without agreement.

In a sequential study, lanes are added until the exact interval of the share is narrow enough, so
the interval is computed repeatedly, once per look. Look i comes after 256 · 1.5^(i - 1) samples and
has the error α / (i (i + 1)). These errors sum to α. With probability 1 - α all intervals therefore
hold at once, wherever the study stops. Looks lie ever further apart, because a look after few new
lanes costs a part of the error and adds little information.
"""

import itertools
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int

from jaxnet.config.amplitude import known_amplitude
from jaxnet.config.cells import Cell, is_leaderless, judged_metric
from jaxnet.config.keys import Criterion, Recovery, Sequential
from jaxnet.config.naming import NO_BREAK
from jaxnet.config.study import Study
from jaxnet.model.wording import Named, cells_named, number_text
from jaxnet.statistics.amplitude import attack_size
from jaxnet.statistics.curves import mostly_failed, unrecovered_shares
from jaxnet.statistics.groups import attacked_groups, labels_without_magnitude
from jaxnet.statistics.intervals import CONFIDENCE, ROUNDING_SPREAD, clopper_pearson
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results

FIRST_LOOK = 256  # samples of a cell
LEAST_APART = 1e-9  # [m], or of ā; lanes that differ by less are equally bad


class RecoveryCounts(NamedTuple):
    """For each cell, the number of lanes that ended and how many of them did not recover."""

    unrecovered: Int[np.ndarray, " cells"]
    ended: Int[np.ndarray, " cells"]


def threshold(cell: Cell, asked: Recovery | None) -> float:
    """Mean error or spread above which a lane of the cell is unrecovered [m].

    The threshold is not-a-number without an attack, and if a study does not ask for recovery.
    """
    if asked is None:
        return np.nan
    in_force = asked.of == "amplitude" and attack_size(cell) > 0
    return asked.tau * (known_amplitude(cell.scenario) if in_force else attack_size(cell))


def attacked_thresholds(asked: Recovery, cells: Sequence[Cell]) -> set[float]:
    """The different thresholds of the cells with an attack [m]."""
    masked = zip(cells, attacked_mask(cells), strict=True)
    return {threshold(cell, asked) for cell, attacked in masked if attacked}


def criterion_words(asked: Recovery, cells: Sequence[Cell]) -> str:
    """What a lane that does not recover has, with its length if all attacked cells have one."""
    size = "ā" if asked.of == "magnitude" else "of the amplitude in force"
    judged = {cell.scenario.judged for cell in cells}
    what = "spread" if is_leaderless(cells) else "mean error"
    other = "" if len(judged) == 1 else " (without a navigator: spread)"
    limits = known_or(set[float](), lambda: attacked_thresholds(asked, cells))
    length = f" = {number_text(limits.pop())}{NO_BREAK}m" if len(limits) == 1 else ""
    return f"{what} over the tail{other} > {asked.tau:g}{NO_BREAK}{size}{length}"


def share_name(cells: Sequence[Cell]) -> str:
    """Name the share unrecovered: without a navigator, lanes end without agreement."""
    return "without agreement" if is_leaderless(cells) else "unrecovered"


def share_definition(asked: Recovery, cells: Sequence[Cell]) -> str:
    """Define the share unrecovered: its name, in files too if that differs, and its criterion."""
    also = " (unrecovered)" if is_leaderless(cells) else ""
    return f"{share_name(cells)}{also}: {criterion_words(asked, cells)}"


def lowered_words(results: Results, cells: Sequence[Cell], named: Named = cells_named) -> str:
    """Tell where the share unrecovered surely falls as ā grows, and why that may be; else "".

    The threshold τ ā allows an error that does not depend on ā at a great ā, not at a small one.
    """
    asked, shares = results.study.config.recovery, unrecovered_shares(results)
    shares = shares.drop(index=mostly_failed(results), errors="ignore")
    low, high = shares["unrecovered_low"].to_dict(), shares["unrecovered_high"].to_dict()
    groups = known_or([], lambda: [[*each.attacked] for each in attacked_groups(cells)])
    known = ([number for number in group if number in low] for group in groups)
    pairs = itertools.chain.from_iterable(itertools.combinations(group, 2) for group in known)
    falls = [(small, great) for small, great in pairs if low[small] > high[great]]
    if asked is None or not falls:
        return ""
    where = named(sorted({number for pair in falls for number in pair}))
    what = "spread" if is_leaderless(cells) else "error"
    size = "ā" if asked.of == "magnitude" else "times the amplitude in force"
    return (
        f"the share {share_name(cells)} falls as ā grows in {where}. The threshold of"
        f" {asked.tau:g}{NO_BREAK}{size} grows with ā, the {what} does not grow in proportion. At a"
        f" small ā noise, loss, delay or a transient may decide, or only great attacks are stopped:"
        f" compare the {what}s in metres"
    )


def same_thresholds(study: Study, table: pd.DataFrame) -> Bool[np.ndarray, " rows"]:
    """Which rows of a stored table were made with the thresholds of their cells."""
    wanted = [threshold(study.cells[number], study.config.recovery) for number in table["cell"]]
    made = table["threshold"] if "threshold" in table else np.full(len(table), -1.0)
    return np.isclose(wanted, made, rtol=1e-12, atol=0.0, equal_nan=True)


def samples_at(look: int) -> int:
    """Samples of a cell at a look, from 1: 256, then half as many more each time, rounded up."""
    return -(-FIRST_LOOK * 3 ** (look - 1) // 2 ** (look - 1))


def look_of(samples: int) -> int:
    return next(look for look in itertools.count(1) if samples_at(look) >= samples)


def looks(there: int, at_most: int) -> Iterator[int]:
    """Yield the samples of a cell at which to look, `there` samples first.

    No two numbers belong to one look, even over runs that each allow more samples. So the errors of
    all looks sum to the allowed error at most.
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
    """Confidence at which intervals are computed: 95 %, or that of the last look."""
    if not isinstance(asked, Sequential):
        return CONFIDENCE
    return confidence_at(look_of(samples), asked.until.confidence)


def confidence_told(samples: int | Sequential) -> float:
    """Confidence of the intervals in `cells.csv`, which holds over all looks."""
    return samples.until.confidence if isinstance(samples, Sequential) else CONFIDENCE


def half_intervals(
    counts: RecoveryCounts, cells: Sequence[Cell], samples: Sequence[int], criterion: Criterion
) -> Float[np.ndarray, " cells"]:
    """Half of each cell's interval, for the study's stopping rule; `samples` are the cells'.

    The half is 0 for a cell without an attack or without a lane that ended.
    """
    sure = np.array([confidence_at(look_of(each), criterion.confidence) for each in samples])
    low, high = clopper_pearson(*counts, sure)
    return np.where(attacked_mask(cells) & (counts.ended > 0), high - low, 0.0) / 2


def attacked_mask(cells: Sequence[Cell]) -> Bool[np.ndarray, " cells"]:
    """Which cells have an attack with a known ā."""
    return np.array([attack_size(cell) > 0 for cell in cells])


def worst_first(lanes: pd.DataFrame, by: str) -> pd.DataFrame:
    """Lanes with the greatest values first; of lanes that differ by rounding the lowest sample."""
    ordered: Any = lanes.sort_values(by, ascending=False, kind="stable")
    values = ordered[by].to_numpy(float)
    apart = np.fmax(ROUNDING_SPREAD * np.abs(values[:-1]), LEAST_APART)
    rank = np.cumsum(np.concatenate([[0], values[:-1] - values[1:] > apart])[: len(values)])
    place = np.lexsort((ordered["sample"], rank))
    return ordered.iloc[place]


def worst_lanes(rows: pd.DataFrame, cells: Sequence[Cell], number: int) -> list[tuple[int, int]]:
    """Cell and sample of the ok lanes with the greatest judged metric per ā.

    The list takes the worst lane of each group of cells that differ only in ā, then the second of
    each group, and so on. Otherwise one group would often fill the list with similar lanes.
    """
    sizes = np.array([*map(attack_size, cells)])
    groups = np.array([str(labels_without_magnitude(cell)) for cell in cells])
    lanes = rows[["cell", "sample"]].assign(
        ratio=rows[judged_metric(cells)] / sizes[rows["cell"]], group=groups[rows["cell"]]
    )
    lanes = worst_first(lanes.dropna(), "ratio")
    lanes["place"] = lanes.groupby("group").cumcount()
    chosen = lanes.sort_values("place", kind="stable").head(number)
    return list(zip(chosen["cell"].tolist(), chosen["sample"].tolist(), strict=True))
