"""Comparison of two studies lane by lane, paired by common random numbers.

The same seed and sample give the same draw. So the difference of two lanes of a sample is the
difference of their studies, and its mean varies far less than the means themselves. The share
unrecovered changes only by the lanes that are unrecovered in one study alone. If both directions
were equally likely, the number in one direction would be binomial with p = 1/2: McNemar's exact
test. Intervals are those of `intervals`; that of the share leaves out 0 exactly where McNemar's p
is below 0.05.
"""

import functools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Bool
from scipy import special

from jaxnet.config.cells import Cell, is_leaderless, to_plain
from jaxnet.config.keys import Recovery
from jaxnet.kinds.metrics import AGREEMENT
from jaxnet.statistics.curves import canonical_value
from jaxnet.statistics.intervals import CONFIDENCE, paired_share_interval
from jaxnet.statistics.recovery import threshold
from jaxnet.statistics.summary import SUMMARISED, independent_units, metric_statistics
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results

SIDES = ("_A", "_B")
DIFFERENCE = {"difference": "mean", "low": "low", "high": "high"} | {
    name: name for name in ("median", "median_low", "median_high")
}  # by name in `metric_statistics`
CellPair = tuple[Cell, Cell]


class Comparison(NamedTuple):
    """Comparison of a study B with a study A; all differences are B − A.

    Attributes
    ----------
    folders
        Places of A and B.
    settings
        The differing keys, with A's and B's values.
    alone
        Cells without a partner in the other study.
    cells
        A row for each pair of cells.
    changed
        Lanes that are unrecovered in only one study.
    failed
        Lanes that failed in either study; no difference counts them.

    Examples
    --------
    >>> import jaxnet
    >>> keys = {"engine": "exact", "horizon": 1.0, "tail": 0.5, "samples": 2}
    >>> attacks = [{"magnitude": 1}, {"magnitude": 10}]
    >>> weak, strong = (jaxnet.simulate(keys | {"attack": a}, progress=False) for a in attacks)
    >>> jaxnet.compare(weak, strong).settings["key"].to_list()
    ['attack.magnitude']
    """

    folders: tuple[str, str]
    settings: pd.DataFrame
    alone: list[str]
    cells: pd.DataFrame
    changed: pd.DataFrame
    failed: pd.DataFrame


def compare_studies(first: Results, second: Results) -> Comparison:
    """Compare two studies lane by lane; raises FolderError if no lanes can be paired."""
    both = first, second
    _ = first.cells, second.cells  # refuses an unfinished run
    pairs = paired_cells(first, second)
    criteria = [results.study.config.recovery for results in both]
    lanes = [mark_unrecovered(join_lanes(first, second, pair), pair, criteria) for pair in pairs]
    if not any(map(len, lanes)):
        raise FolderError(f"{first.path} and {second.path} have no sample in common")
    changed = [
        each.loc[each["ok"] & (each["unrecovered_A"] != each["unrecovered_B"])].dropna()
        for each in lanes
    ]
    failed = [each.loc[~each["ok"]] for each in lanes]
    metric = compared_metrics(first, second)[0]
    told = [f"{name}{side}" for name in (metric, "unrecovered") for side in SIDES]
    rows = [comparison_row(pair, each, both) for pair, each in zip(pairs, lanes, strict=True)]
    return Comparison(
        (str(first.path), str(second.path)),
        differing_settings(first, second),
        unpaired_cells(first, second, pairs),
        pd.DataFrame(rows),
        lane_table(pairs, changed, ["sample", *told]),
        lane_table(pairs, failed, ["sample", "status_A", "status_B"]),
    )


def compared_metrics(first: Results, second: Results) -> tuple[str, ...]:
    """Metrics that are compared: tail errors, or those of agreement if neither has a navigator."""
    alone = all(is_leaderless(results.study.cells) for results in (first, second))
    return AGREEMENT if alone else SUMMARISED


def paired_cells(first: Results, second: Results) -> list[CellPair]:
    """Cells of two studies with equal values of the keys swept in both.

    Raises FolderError if seeds or draws differ, or if there is no such pair.
    """
    paired = "lanes are paired by their draws"
    for name, (a, b) in {
        "seed": [results.study.config.seed for results in (first, second)],
        "draws": [draw_design(results) for results in (first, second)],
    }.items():
        if a != b:
            words = f"{paired}, so the seed must be the same" if name == "seed" else paired
            raise FolderError(f"{name}: {a} in {first.path}, {b} in {second.path}; {words}")
    common = [key for key in first.study.cells[0].labels if key in second.study.cells[0].labels]
    cells_a = by_values(first, common, second)
    cells_b = by_values(second, common, first)
    pairs = [(cell, cells_b[values]) for values, cell in cells_a.items() if values in cells_b]
    if not pairs:
        swept = "; ".join(
            f"{key} is {swept_values_text(first, key)} in {first.place},"
            f" {swept_values_text(second, key)} in {second.place}"
            for key in common
        )
        raise FolderError(f"sweep: no cell of one study has a like in the other: {swept}")
    return pairs


def draw_design(results: Results) -> str:
    """How samples are drawn; for Sobol's sequences with their length."""
    study = results.study.config
    return study.draws if study.draws == "random" else f"{study.draws} with {study.samples} samples"


def by_values(
    results: Results, common: Sequence[str], other: Results
) -> dict[tuple[str, ...], Cell]:
    """Cells by their values of some swept keys; raises FolderError if two have equal values."""
    found: dict[tuple[str, ...], Cell] = {}
    for cell in results.study.cells:
        values = tuple(canonical_value(cell.labels[key]) for key in common)
        if values in found:
            more = ", ".join(key for key in cell.labels if key not in common)
            raise FolderError(
                f"sweep: {more} is swept in {results.place} and not in {other.place}, so several"
                " cells of one would stand against one of the other: sweep it in both, or in"
                " neither"
            )
        found[values] = cell
    return found


def swept_values_text(results: Results, key: str) -> str:
    return ", ".join(dict.fromkeys(str(cell.labels[key]) for cell in results.study.cells))


def join_lanes(first: Results, second: Results, pair: CellPair) -> pd.DataFrame:
    """Rows of the samples that both cells have, with columns marked A and B."""
    sides, metrics = [], compared_metrics(first, second)
    for results, cell, side in zip((first, second), pair, SIDES, strict=True):
        columns = dict.fromkeys(("status", *metrics, cell.scenario.judged))
        found = next(lanes for _, lanes in results.by_cell("sample", *columns, cells=[cell.number]))
        sides.append(found.set_index("sample")[[*columns]].add_suffix(side))
    return sides[0].join(sides[1], how="inner").sort_index().reset_index()


def mark_unrecovered(
    lanes: pd.DataFrame, pair: CellPair, criteria: Sequence[Recovery | None]
) -> pd.DataFrame:
    """The lanes with `ok`, whether both lanes ended, and whether each lane is unrecovered.

    `unrecovered` is not-a-number without a criterion or an attack, and where ā is unknown because
    an attack's code is missing.
    """
    levels = [
        known_or(np.nan, functools.partial(threshold, cell, asked))
        for cell, asked in zip(pair, criteria, strict=True)
    ]
    known = not np.isnan(levels).any()
    judged = {
        f"unrecovered{side}": lanes[f"{cell.scenario.judged}{side}"] > level if known else np.nan
        for side, cell, level in zip(SIDES, pair, levels, strict=True)
    }
    return lanes.assign(ok=(lanes["status_A"] == "ok") & (lanes["status_B"] == "ok"), **judged)


def comparison_row(
    pair: CellPair, lanes: pd.DataFrame, studies: tuple[Results, Results]
) -> Mapping[str, object]:
    ok: Any = lanes[lanes["ok"]]
    row = cell_numbers(pair) | pair[0].labels | {"pairs": len(ok), "failed": len(lanes) - len(ok)}
    units = independent_units(studies[0].study.config, ok["sample"].to_numpy())
    for metric in compared_metrics(*studies):
        apart = (ok[f"{metric}_B"] - ok[f"{metric}_A"]).to_numpy(float)
        found = metric_statistics(apart, units)
        row |= {f"{metric}_{name}": found[of] for name, of in DIFFERENCE.items()}
    sides = ok[["unrecovered_A", "unrecovered_B"]]
    if sides.isna().to_numpy().any() or not len(ok):
        return row | dict.fromkeys(Shift._fields, np.nan)
    return row | share_shift(*sides.to_numpy(bool).T)._asdict()


class Shift(NamedTuple):
    """Difference of the share unrecovered between paired lanes."""

    saved: int  # lanes unrecovered only in A
    lost: int  # lanes unrecovered only in B
    unrecovered: float  # share in B − share in A
    unrecovered_low: float
    unrecovered_high: float
    p: float  # McNemar's, exact


def share_shift(a: Bool[np.ndarray, " lanes"], b: Bool[np.ndarray, " lanes"]) -> Shift:
    saved, lost, count = int((a & ~b).sum()), int((b & ~a).sum()), len(a)
    changed = saved + lost
    p = min(1.0, 2 * special.bdtr(min(saved, lost), changed, 0.5)) if changed else 1.0
    low, high = paired_share_interval(lost, saved, count, CONFIDENCE)
    return Shift(saved, lost, (lost - saved) / count, low, high, float(p))


def cell_numbers(pair: CellPair) -> dict[str, int]:
    a, b = (cell.number for cell in pair)
    return {"cell": a} if a == b else {"cell": a, "cell_B": b}


def lane_table(
    pairs: Sequence[CellPair], lanes: Sequence[pd.DataFrame], columns: list[str]
) -> pd.DataFrame:
    found = [
        pd.DataFrame(
            {
                key: [value] * len(rows)
                for key, value in (cell_numbers(pair) | pair[0].labels).items()
            }
            | {name: rows[name].to_numpy() for name in columns}
        )
        for pair, rows in zip(pairs, lanes, strict=True)
    ]
    return pd.concat([each for each in found if len(each)] or found, ignore_index=True)


def differing_settings(first: Results, second: Results) -> pd.DataFrame:
    """Keys in which two studies differ, without the keys that both sweep."""
    a, b = (by_dotted_key(to_plain(results.study.config)) for results in (first, second))
    swept = [key for key in first.study.cells[0].labels if key in second.study.cells[0].labels]
    hidden = tuple(f"{key}." for key in ("name", "save", *swept))
    rows = [
        {"key": key, "A": a.get(key, "-"), "B": b.get(key, "-")}
        for key in dict.fromkeys([*a, *b])
        if a.get(key) != b.get(key) and not f"{key}.".startswith(hidden)
    ]
    return pd.DataFrame(rows, columns=["key", "A", "B"])


def by_dotted_key(data: Mapping[str, object], before: str = "") -> dict[str, str]:
    found: dict[str, str] = {}
    for key, value in data.items():
        if isinstance(value, Mapping) and value:
            found |= by_dotted_key(value, f"{before}{key}.")
        else:
            found[f"{before}{key}"] = str(value)
    return found


def unpaired_cells(first: Results, second: Results, pairs: Sequence[CellPair]) -> list[str]:
    found = []
    for side, results in enumerate((first, second)):
        paired = {pair[side].number for pair in pairs}
        alone = [cell for cell in results.study.cells if cell.number not in paired]
        found += [f"{cell} of {'AB'[side]}" for cell in alone]
    return found
