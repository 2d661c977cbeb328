"""Two studies held against each other lane by lane, paired by common random numbers.

The same seed and sample give the same draw, so the difference of two lanes of a sample is that of their
studies, and its mean varies far less than the means themselves. Of the share unrecovered only the lanes that
changed sides count. If either way were as likely, the number of those that went one way would be binomial
with p = 1/2, which is McNemar's exact test. Intervals are those of `means`, of the share too: a lane counts
-1, 0 or 1. The interval of the share leaves out 0 where McNemar's p is below 0.05, and nowhere else.
"""

import functools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Bool
from scipy import special

from jaxnet.config.cells import Cell, to_plain
from jaxnet.statistics import means
from jaxnet.statistics.curves import alike
from jaxnet.statistics.limits import ceilings
from jaxnet.statistics.recovery import CONFIDENCE, threshold
from jaxnet.statistics.summary import SUMMARISED, spread, units
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results

SIDES = ("_A", "_B")
DIFFERENCE = {"difference": "mean", "low": "low", "high": "high"}  # and what `spread` calls them
COLUMNS_READ = ("sample", "status", *SUMMARISED)
Pair = tuple[Cell, Cell]


class Comparison(NamedTuple):
    """A study A and a study B, of whose lanes B is held against A: all differences are B − A."""

    folders: tuple[str, str]
    settings: pd.DataFrame  # the keys that differ, with A's and B's values
    alone: list[str]  # cells that have none to be held against
    cells: pd.DataFrame  # a row per pair of cells
    changed: pd.DataFrame  # lanes unrecovered in one study alone
    failed: pd.DataFrame  # lanes that failed in either, which count in no difference


def held_against(first: Results, second: Results) -> Comparison:
    """Hold one study's lanes against another's; raises FolderError if none can be paired."""
    _ = first.cells, second.cells  # refuses an unfinished run
    pairs = paired_cells(first, second)
    tables = [joined(first, second, pair) for pair in pairs]
    if not any(map(len, tables)):
        raise FolderError(f"{first.path} and {second.path} have no sample in common")
    judged = [judge(lanes, pair, taus(first, second)) for lanes, pair in zip(tables, pairs, strict=True)]
    changed = [
        lanes[lanes["ok"] & (lanes["unrecovered_A"] != lanes["unrecovered_B"])].dropna() for lanes in judged
    ]
    rows = [row_of(pair, lanes, (first, second)) for pair, lanes in zip(pairs, judged, strict=True)]
    return Comparison(
        (str(first.path), str(second.path)),
        settings(first, second),
        alone(first, second, pairs),
        pd.DataFrame(rows),
        listed_lanes(
            pairs, changed, ["sample", "tail_mean_A", "tail_mean_B", "unrecovered_A", "unrecovered_B"]
        ),
        listed_lanes(pairs, [lanes[~lanes["ok"]] for lanes in judged], ["sample", "status_A", "status_B"]),
    )


def paired_cells(first: Results, second: Results) -> list[Pair]:
    """Cells of two studies that have the same values of the keys swept in both; raises FolderError."""
    seeds = [results.study.config.seed for results in (first, second)]
    if seeds[0] != seeds[1]:
        raise FolderError(
            f"seed: {seeds[0]} in {first.path}, {seeds[1]} in {second.path}; lanes are paired by their draws,"
            " so the seed must be the same"
        )
    drawn = [design(results) for results in (first, second)]
    if drawn[0] != drawn[1]:
        raise FolderError(
            f"draws: {drawn[0]} in {first.path}, {drawn[1]} in {second.path}; lanes are paired by their draws"
        )
    common = [key for key in first.study.cells[0].labels if key in second.study.cells[0].labels]
    theirs = by_values(second, common, first)
    mine = by_values(first, common, second)
    pairs = [(cell, theirs[values]) for values, cell in mine.items() if values in theirs]
    if not pairs:
        swept = "; ".join(
            f"{key} is {told(first, key)} in {first.path}, {told(second, key)} in {second.path}"
            for key in common
        )
        raise FolderError(f"sweep: no cell of one study has a like in the other: {swept}")
    return pairs


def design(results: Results) -> str:
    """By what samples are drawn; of Sobol's sequences their length matters too."""
    study = results.study.config
    return study.draws if study.draws == "random" else f"{study.draws} with {study.samples} samples"


def by_values(results: Results, common: Sequence[str], other: Results) -> dict[tuple[str, ...], Cell]:
    """Cells by their values of some swept keys; raises FolderError where two have the same."""
    found: dict[tuple[str, ...], Cell] = {}
    for cell in results.study.cells:
        values = tuple(alike(cell.labels[key]) for key in common)
        if values in found:
            more = ", ".join(key for key in cell.labels if key not in common)
            raise FolderError(
                f"sweep: {more} is swept in {results.path} and not in {other.path}, so several cells of one"
                " would stand against one of the other: sweep it in both, or in neither"
            )
        found[values] = cell
    return found


def told(results: Results, key: str) -> str:
    """Values of a swept key."""
    return ", ".join(dict.fromkeys(str(cell.labels[key]) for cell in results.study.cells))


def joined(first: Results, second: Results, pair: Pair) -> pd.DataFrame:
    """Rows of the samples that both cells have, columns marked A and B."""
    a, b = (
        next(lanes for _, lanes in results.by_cell(*COLUMNS_READ, cells=[cell.number]))
        for results, cell in zip((first, second), pair, strict=True)
    )
    return a.merge(b, on="sample", suffixes=SIDES).sort_values("sample")


def judge(lanes: pd.DataFrame, pair: Pair, taus: Sequence[float]) -> pd.DataFrame:
    """The same lanes, with whether both ended (`ok`) and each was unrecovered: none where nobody may be, and
    where ā is not known without the code of an attack.
    """
    levels = [
        known_or(np.nan, functools.partial(threshold, cell, tau))
        for cell, tau in zip(pair, taus, strict=True)
    ]
    known = not np.isnan(levels).any()
    judged = {
        f"unrecovered{side}": lanes[f"tail_mean{side}"] > level if known else np.nan
        for side, level in zip(SIDES, levels, strict=True)
    }
    return lanes.assign(ok=(lanes["status_A"] == "ok") & (lanes["status_B"] == "ok"), **judged)


def taus(first: Results, second: Results) -> list[float]:
    """`recovery.tau` of both studies, not-a-number where one has none."""
    asked = [results.study.config.recovery for results in (first, second)]
    return [np.nan if each is None else each.tau for each in asked]


def row_of(pair: Pair, lanes: pd.DataFrame, studies: tuple[Results, Results]) -> dict[str, Any]:
    """What the lanes of a pair of cells come to."""
    ok: Any = lanes[lanes["ok"]]
    row = numbers(pair) | pair[0].labels | {"pairs": len(ok), "failed": len(lanes) - len(ok)}
    drawn = units(studies[0].study.config, ok["sample"].to_numpy())
    a, b = (
        ceilings(each.study.config, cell, ok["sample"].tolist())
        for each, cell in zip(studies, pair, strict=True)
    )
    for metric in SUMMARISED:
        apart = (ok[f"{metric}_B"] - ok[f"{metric}_A"]).to_numpy(float)
        found = spread(apart, (-a[metric], b[metric]), drawn)
        row |= {f"{metric}_{name}": found[of] for name, of in DIFFERENCE.items()}
    if ok[["unrecovered_A", "unrecovered_B"]].isna().to_numpy().any() or not len(ok):
        return row | dict.fromkeys(Shift._fields, np.nan)
    a, b = (ok[f"unrecovered{side}"].to_numpy(bool) for side in SIDES)
    return row | shift(a, b)._asdict()


class Shift(NamedTuple):
    """How the share unrecovered of the same lanes differs."""

    saved: int  # lanes unrecovered in A alone
    lost: int  # in B alone
    unrecovered: float  # share in B − share in A
    unrecovered_low: float
    unrecovered_high: float
    p: float  # McNemar's, exact


def shift(a: Bool[np.ndarray, " lanes"], b: Bool[np.ndarray, " lanes"]) -> Shift:
    """Of lanes unrecovered in A and in B."""
    saved, lost, count = int((a & ~b).sum()), int((b & ~a).sum()), len(a)
    changed = saved + lost
    p = min(1.0, 2 * special.bdtr(min(saved, lost), changed, 0.5)) if changed else 1.0
    low, high = means.ends(b.astype(float) - a, -1.0, 1.0, CONFIDENCE)
    return Shift(saved, lost, (lost - saved) / count, low, high, float(p))


def numbers(pair: Pair) -> dict[str, int]:
    """Numbers of both cells, one where they are the same."""
    a, b = (cell.number for cell in pair)
    return {"cell": a} if a == b else {"cell": a, "cell_B": b}


def listed_lanes(pairs: Sequence[Pair], lanes: Sequence[Any], columns: list[str]) -> pd.DataFrame:
    """These lanes of each pair, with the numbers of the cells and what is swept."""
    found = []
    for pair, mine in zip(pairs, lanes, strict=True):
        told = numbers(pair) | pair[0].labels
        found.append(pd.DataFrame({**{key: [value] * len(mine) for key, value in told.items()}}))
        for name in columns:
            found[-1][name] = mine[name].to_numpy()
    return pd.concat(found, ignore_index=True)


def settings(first: Results, second: Results) -> pd.DataFrame:
    """The keys in which two studies differ, but those that both sweep: cells say these."""
    a, b = (by_dotted_key(to_plain(results.study.config)) for results in (first, second))
    swept = [key for key in first.study.cells[0].labels if key in second.study.cells[0].labels]
    rows = [
        {"key": key, "A": a.get(key, "-"), "B": b.get(key, "-")}
        for key in dict.fromkeys([*a, *b])
        if a.get(key) != b.get(key)
        and key != "name"
        and not any(f"{key}.".startswith(f"{other}.") for other in ("save", *swept))
    ]
    return pd.DataFrame(rows, columns=["key", "A", "B"])


def by_dotted_key(data: Mapping[str, Any], before: str = "") -> dict[str, str]:
    """Values by dotted key, as text."""
    found: dict[str, str] = {}
    for key, value in data.items():
        nested = isinstance(value, Mapping) and value
        found |= by_dotted_key(value, f"{before}{key}.") if nested else {f"{before}{key}": str(value)}
    return found


def alone(first: Results, second: Results, pairs: Sequence[Pair]) -> list[str]:
    """Cells of either study that are in no pair."""
    found = []
    for side, results in enumerate((first, second)):
        paired = {pair[side].number for pair in pairs}
        found += [f"{cell} of {'AB'[side]}" for cell in results.study.cells if cell.number not in paired]
    return found
