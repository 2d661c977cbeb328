"""Comparison of two studies lane by lane, paired by common random numbers.

The same seed and sample give the same draw. So the difference of two lanes of a sample is the
difference of their studies, and its mean varies far less than the means themselves. The share
unrecovered changes only by the lanes that are unrecovered in one study alone. If both directions
were equally likely, the number in one direction would be binomial with p = 1/2: McNemar's exact
test. `compared_cells` tests the signs of other differences likewise. Intervals are those of
`intervals`; that of the share leaves out 0 exactly where McNemar's p is below 0.05.
"""

import functools
import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Bool

from jaxnet.config.cells import Cell, is_leaderless, to_plain
from jaxnet.config.keys import Config, Recovery
from jaxnet.kinds.metrics import AGREEMENT
from jaxnet.kinds.metrics.collisions import COLLISIONS
from jaxnet.kinds.metrics.min_separation import MIN_SEPARATION
from jaxnet.lazy import special
from jaxnet.model.wording import cells_named
from jaxnet.statistics.curves import canonical_value, canonical_values
from jaxnet.statistics.intervals import CONFIDENCE, ROUNDING_SPREAD, paired_share_interval
from jaxnet.statistics.recovery import threshold
from jaxnet.statistics.summary import SUMMARISED, independent_units, metric_statistics
from jaxnet.store.admission import flatten_keys
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results

SIDES = ("_A", "_B")
OF_FILTERS = (MIN_SEPARATION.name, COLLISIONS.name)
DIFFERENCE = {"difference": "mean", "low": "low", "high": "high"} | {
    name: name for name in ("median", "median_low", "median_high", "max")
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
        Cells without a partner in the other study, those together that share a value it lacks.
    cells
        A row for each pair of cells.
    changed
        Lanes that are unrecovered, or failed, in only one study.
    failed
        Lanes that failed in either study. Shares count them as unrecovered; metrics are of pairs of
        which both ended.

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
    leaderless = all(is_leaderless(results.study.cells) for results in both)
    pairs, metrics = paired_cells(*both), AGREEMENT if leaderless else SUMMARISED
    if any(a.scenario.filter != b.scenario.filter for a, b in pairs):
        measured = ({each.name for each in one.study.config.measured()} for one in both)
        metrics = tuple(filter(set.intersection(*measured).__contains__, OF_FILTERS)) or metrics
    criteria = [results.study.config.recovery for results in both]
    each = [mark_unrecovered(join_lanes(both, pair, metrics), pair, criteria) for pair in pairs]
    lanes: Any = pd.concat(each, keys=range(len(pairs)))
    labels = pd.DataFrame([cell_labels(pair) for pair in pairs])
    rows = [comparison_row(mine, metrics, first.study.config) for mine in each]

    def named(which: pd.Series, names: list[str]) -> pd.DataFrame:
        some = lanes.loc[which, names]
        cells = labels.iloc[some.index.get_level_values(0)].reset_index(drop=True)
        return cells.join(some.reset_index(drop=True))

    sides = [f"{name}{side}" for name in (metrics[0], "unrecovered") for side in SIDES]
    judged = lanes[["unrecovered_A", "unrecovered_B"]]
    changed = judged.notna().all(axis=1) & (judged["unrecovered_A"] != judged["unrecovered_B"])
    in_a, in_b = zip(*pairs, strict=True)
    alone = [f"{each} of A" for each in unpaired(first, second, in_a)]
    alone += [f"{each} of B" for each in unpaired(second, first, in_b)]
    return Comparison(
        (str(first.path), str(second.path)),
        differing_settings(first, second),
        alone,
        labels.join(pd.DataFrame(rows)),
        named(changed, ["sample", *sides]),
        named(~lanes["ok"], ["sample", "status_A", "status_B"]),
    )


def paired_cells(first: Results, second: Results) -> list[CellPair]:
    """Cells of two studies with equal values of the keys swept in both.

    Raises FolderError if seeds or draws differ, or if there is no such pair.
    """
    a, b = first.study.config, second.study.config
    paired = "lanes are paired by their draws"
    same_seed = f"{paired}, so the seed must be the same"
    designs = [
        each.draws if each.draws == "random" else f"{each.draws} with {each.samples} samples"
        for each in (a, b)
    ]
    for name, values, words in (
        ("seed", [a.seed, b.seed], same_seed),
        ("draws", designs, paired),
    ):
        if values[0] != values[1]:
            told = f"{values[0]} in {first.path}, {values[1]} in {second.path}"
            raise FolderError(f"{name}: {told}; {words}")
    common = [key for key in first.study.cells[0].labels if key in second.study.cells[0].labels]
    cells_a, cells_b = by_values(first, common, second), by_values(second, common, first)
    pairs = [(cell, cells_b[values]) for values, cell in cells_a.items() if values in cells_b]
    if not pairs:
        swept = "; ".join(
            f"{key} is {swept_values_text(first, key)} in {first.place},"
            f" {swept_values_text(second, key)} in {second.place}"
            for key in common
        )
        raise FolderError(f"sweep: no cell of one study has a like in the other: {swept}")
    return pairs


def unpaired(mine: Results, other: Results, paired: Sequence[Cell]) -> list[str]:
    """Names of the cells that are in no pair, together those of a value that the other lacks."""
    found, numbers = list[str](), {each.number for each in paired}
    left = [each for each in mine.study.cells if each.number not in numbers]
    others = [each.labels for each in other.study.cells]
    for key in [key for key in mine.study.cells[0].labels if key in others[0]]:
        known = {canonical_value(labels[key]) for labels in others}
        lacked = [each for each in left if canonical_value(each.labels[key]) not in known]
        left = [each for each in left if canonical_value(each.labels[key]) in known]
        values = ", ".join(dict.fromkeys(str(each.labels[key]) for each in lacked))
        named = cells_named([each.number for each in lacked])
        found += [f"{named} ({key}={values})"] * bool(lacked)
    return [*found, *map(str, left)]


def by_values(
    results: Results, common: Sequence[str], other: Results
) -> dict[tuple[str, ...], Cell]:
    """Cells by their values of some swept keys; raises FolderError if two have equal values."""
    cells = results.study.cells
    found = {canonical_values(cell.labels[key] for key in common): cell for cell in cells}
    if len(found) < len(cells):
        more = ", ".join(key for key in cells[0].labels if key not in common)
        raise FolderError(
            f"sweep: {more} is swept in {results.place} and not in {other.place}, so several cells"
            " of one would stand against one of the other: sweep it in both, or in neither"
        )
    return found


def swept_values_text(results: Results, key: str) -> str:
    return ", ".join(dict.fromkeys(str(cell.labels[key]) for cell in results.study.cells))


def join_lanes(
    studies: tuple[Results, Results], pair: CellPair, metrics: Sequence[str]
) -> pd.DataFrame:
    """Rows of the samples that both cells have, with columns marked A and B."""
    sides = []
    for results, cell, side in zip(studies, pair, SIDES, strict=True):
        columns = [*dict.fromkeys(("status", *metrics, cell.scenario.judged))]
        found = next(lanes for _, lanes in results.by_cell("sample", *columns, cells=[cell.number]))
        sides.append(found.set_index("sample")[columns].add_suffix(side))
    return sides[0].join(sides[1], how="inner").sort_index().reset_index()


def mark_unrecovered(
    lanes: pd.DataFrame, pair: CellPair, criteria: Sequence[Recovery | None]
) -> pd.DataFrame:
    """The lanes with `ok`, whether both lanes ended, and whether each lane is unrecovered.

    A lane that failed is unrecovered. `unrecovered` is not-a-number without a criterion or an
    attack, and where ā is unknown because an attack's code is missing.
    """
    levels = [
        known_or(np.nan, functools.partial(threshold, cell, asked))
        for cell, asked in zip(pair, criteria, strict=True)
    ]
    known = not np.isnan(levels).any()
    judged = {}
    for side, cell, level in zip(SIDES, pair, levels, strict=True):
        failed = lanes[f"status{side}"] != "ok"
        over = (failed | (lanes[f"{cell.scenario.judged}{side}"] > level)).astype(object)
        judged[f"unrecovered{side}"] = over if known else np.nan
    return lanes.assign(ok=(lanes["status_A"] == "ok") & (lanes["status_B"] == "ok"), **judged)


def comparison_row(lanes: pd.DataFrame, metrics: Sequence[str], study: Config) -> dict[str, object]:
    ok: Any = lanes[lanes["ok"]]
    row: dict[str, object] = {"pairs": len(ok), "failed": len(lanes) - len(ok)}
    units = independent_units(study, ok["sample"].to_numpy())
    for metric in metrics:
        apart = (ok[f"{metric}_B"] - ok[f"{metric}_A"]).to_numpy(float)
        found = metric_statistics(apart, units)
        row |= {f"{metric}_{name}": found[of] for name, of in DIFFERENCE.items()}
    sides = lanes[["unrecovered_A", "unrecovered_B"]]
    if sides.isna().to_numpy().any() or not len(lanes):
        return row | dict.fromkeys(Shift._fields, np.nan)
    return row | share_shift(*sides.to_numpy(bool).T)._asdict()


class Shift(NamedTuple):
    """Difference of the share failed or unrecovered between paired lanes."""

    saved: int  # lanes failed or unrecovered only in A
    lost: int  # lanes failed or unrecovered only in B
    unrecovered: float  # share in B − share in A
    unrecovered_low: float
    unrecovered_high: float
    p: float  # McNemar's, exact


def share_shift(a: Bool[np.ndarray, " lanes"], b: Bool[np.ndarray, " lanes"]) -> Shift:
    saved, lost, count = int((a & ~b).sum()), int((b & ~a).sum()), len(a)
    low, high = paired_share_interval(lost, saved, count, CONFIDENCE)
    return Shift(saved, lost, (lost - saved) / count, low, high, sign_test(saved, lost))


def sign_test(up: int, down: int) -> float:
    """Exact p of so uneven a split of the pairs that differ, if both directions are as likely."""
    return float(min(1.0, 2 * special.bdtr(min(up, down), up + down, 0.5))) if up + down else 1.0


class CellsCompared(NamedTuple):
    """A test of whose paired lanes have the greater values.

    Attributes
    ----------
    better, worse
        Numbers of the cells; more lanes of `worse` have the greater value.
    lanes
        Number of paired lanes.
    p
        Exact p of the signs. It is Holm's adjusted one, unless the lanes cannot tell.
    can_tell
        Whether at least six lanes differ, so that p could be below 0.05.
    """

    better: int
    worse: int
    lanes: int
    p: float
    can_tell: bool

    @property
    def found(self) -> bool:
        return self.can_tell and self.p <= 1 - CONFIDENCE


def compared_cells(
    values: Mapping[int, pd.Series], settings: Sequence[Sequence[int]]
) -> list[CellsCompared]:
    """Compare the cells of each setting, every one with every other, by the signs of paired lanes.

    `values` are numbers of a cell's lanes, by sample. At most 5 % of studies have any wrong finding
    (Holm, 1979). Tests that cannot tell do not count (Tarone, 1990).
    """
    tests = []
    for cells in settings:
        lanes = pd.DataFrame({cell: values[cell] for cell in cells}).to_numpy(float)
        for a, b in itertools.combinations(range(len(cells)), 2):
            apart = lanes[:, a] - lanes[:, b]
            least = ROUNDING_SPREAD * np.abs(lanes[:, a])
            up, down = int((apart > least).sum()), int((apart < -least).sum())
            better, worse = (cells[b], cells[a]) if up > down else (cells[a], cells[b])
            tells = sign_test(0, up + down) <= 1 - CONFIDENCE
            many = int(np.isfinite(apart).sum())
            tests.append(CellsCompared(better, worse, many, sign_test(up, down), tells))
    tests.sort(key=lambda each: (not each.can_tell, each.p))
    told = sum(each.can_tell for each in tests)
    adjusted = np.maximum.accumulate([(told - n) * tests[n].p for n in range(told)]).tolist()
    found = (t._replace(p=min(1.0, p)) for t, p in zip(tests, adjusted, strict=False))
    return [*found, *tests[told:]]


def cell_labels(pair: CellPair) -> dict[str, Any]:
    a, b = (cell.number for cell in pair)
    return {"cell": a} | ({} if a == b else {"cell_B": b}) | pair[0].labels


def differing_settings(first: Results, second: Results) -> pd.DataFrame:
    """Keys in which two studies differ, without the keys that both sweep."""
    a, b = (flatten_keys(to_plain(each.study.config)) for each in (first, second))
    swept = [key for key in first.study.cells[0].labels if key in second.study.cells[0].labels]
    hidden = tuple(f"{key}." for key in ("name", "save", *swept))
    rows = [
        (key, *values_apart(a.get(key, "-"), b.get(key, "-")))
        for key in dict.fromkeys([*a, *b])
        if str(a.get(key)) != str(b.get(key)) and not f"{key}.".startswith(hidden)
    ]
    return pd.DataFrame(rows, columns=["key", "A", "B"])


def values_apart(a: Any, b: Any) -> tuple[str, str]:
    """Two values as text; of lists of choices only those that the other list lacks."""
    if isinstance(a, list) and isinstance(b, list) and dict in map(type, [*a, *b]):
        only = [each for each in a if each not in b], [each for each in b if each not in a]
        if any(only):  # else their order differs
            a, b = (", ".join(map(str, each)) or "-" for each in only)
    return str(a), str(b)
