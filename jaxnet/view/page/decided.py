"""Pairs of cells compared by what matters first: lanes that hold, lanes that are lost, errors.

The cells of a pair differ in one choice, or in one combination of choices, and have the same draws.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import pandas as pd

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.keys import Sequential
from jaxnet.config.naming import key_name, labels_title, value_name
from jaxnet.model.wording import count
from jaxnet.statistics.groups import swept_values_of
from jaxnet.statistics.pairs import CellsCompared, compared_cells
from jaxnet.statistics.recovery import attacked_mask
from jaxnet.store.results import Results
from jaxnet.view.page.elements import notes_html, sortable_table
from jaxnet.view.page.judged import JudgedLanes

# Keys that nobody chooses: settings in which the others are compared
CONDITIONS = ("attack", "channel.loss", "channel.delay", "channel.noise", "navigator", "initial")
CONDITIONS += ("channel.quantisation", "sensing", "vehicle", "horizon", "tail", "tick", "engine")
# By column of lanes, what a test is about, and what it finds of the better and of the worse cell of
# a pair. A later group counts where no test of an earlier one finds a difference.
GONE = {"gone": ("fail or are lost", "fewer", "more")}
TOO_NEAR = {"near": ("come too near", "fewer", "more")}
LED = (
    {"fallen": ("hold", "more", "fewer")} | TOO_NEAR,
    GONE,
    {"error": ("error", "smaller", "greater")},
)
ALONE = (
    {"out": ("leave the hull", "fewer", "more"), "unrecovered": ("agree", "more", "fewer")}
    | TOO_NEAR,
    GONE,
    {"way": ("way out", "shorter", "longer"), "error": ("spread", "smaller", "greater")},
)
ABOUT_DECISIONS = {  # by whether there is no navigator
    False: "lanes that hold; without a difference, lanes that fail or are lost; then errors",
    True: "lanes that leave the hull, and lanes that agree; without a difference, lanes that fail"
    " or are lost; then ways out and spreads",
}
MOST_TESTS = 200  # in the table of p values
P_WORDS = (
    "McNemar's exact test of lanes that hold, fail or are lost, and the exact sign test of errors,"
    " on paired lanes, of cells in which six lanes differ or more; p is adjusted by Holm over the"
    " comparisons of a key"
)


class PairDecision(NamedTuple):
    """What tests find of a cell against another: in words, and whether it is better.

    `better` is None where they find nothing, or disagree; `by_lanes` is whether numbers of lanes
    decide, not lengths.
    """

    words: str
    better: bool | None
    by_lanes: bool


def choices(cells: Sequence[Cell]) -> list[str]:
    """The swept keys whose value one chooses."""
    return [
        key
        for key, values in swept_values_of(cells).items()
        if len(values) > 1 and key != "channel" and not key.startswith(CONDITIONS)
    ]


def cells_judged(cells: Sequence[Cell]) -> list[Cell]:
    """The cells under attack, or all if none is."""
    mask = attacked_mask(cells)
    return [cell for cell, attacked in zip(cells, mask, strict=True) if attacked] or [*cells]


def swept_texts(results: Results) -> pd.DataFrame:
    """Values of the swept keys as text, by number of the cells that are judged."""
    cells = cells_judged(results.study.cells)
    return pd.DataFrame([cell.labels for cell in cells], [cell.number for cell in cells]).map(str)


def decisions(
    results: Results, lanes: JudgedLanes, values: pd.Series, others: pd.DataFrame
) -> dict[tuple[int, int], PairDecision]:
    """Decide each pair of cells that differ in `values` alone, in both orders.

    `lanes` are from `judged_lanes`; `values` has the value of each cell, `others` the other swept
    keys.
    """
    found = dict[tuple[int, int], list[tuple[str, bool]]]()
    by_lanes = set[tuple[int, int]]()
    for group in judged_columns(results):
        fresh = dict[tuple[int, int], list[tuple[str, bool]]]()
        for column, (what, *found_of) in group.items():
            for test in paired_tests(results, lanes, column, values, others):
                both = (test.better, test.worse), (test.worse, test.better)
                for pair, words, is_better in zip(both, found_of, (True, False), strict=True):
                    told = [(f"{words} {what}", is_better)] * test.found
                    fresh.setdefault(pair, []).extend(told)
        for pair, told in fresh.items():
            found[pair] = found.get(pair) or told
        if "error" not in group:
            by_lanes = {pair for pair, told in found.items() if told}
    decided = {}
    for pair, told in found.items():
        ways = {is_better for _, is_better in told}
        words = ", ".join(words for words, _ in told)
        decided[pair] = PairDecision(
            words, ways.pop() if len(ways) == 1 else None, pair in by_lanes
        )
    return decided


def judged_columns(results: Results) -> Sequence[Mapping[str, tuple[str, str, str]]]:
    return ALONE if is_leaderless(results.study.cells) else LED


def paired_tests(
    results: Results, lanes: JudgedLanes, column: str, values: pd.Series, others: pd.DataFrame
) -> list[CellsCompared]:
    """Tests of the cells that differ in `values` alone, by a column of `lanes`.

    There is no test of lanes that are not independent, and of a number of lanes that depends on
    them. Filters are for distances: cells with different ones are not compared by errors.
    """
    study = results.study.config
    if study.draws != "random" or isinstance(study.samples, Sequential):
        return []
    settings = dict[tuple[Any, ...], list[int]]()
    for cell, rest in zip(values.index.tolist(), others.to_numpy().tolist(), strict=True):
        of_filter = results.study.cells[cell].labels.get("filter") if column == "error" else None
        settings.setdefault((*rest, of_filter), []).append(cell)
    numbers = {cell: lanes[cell][column] for cell in values.index.tolist()}
    return compared_cells(numbers, [each for each in settings.values() if len(each) > 1])


def tests_html(results: Results, lanes: JudgedLanes) -> str:
    """The table of tests of every two values of a choice, which opens at a click, as HTML."""
    rows = list[dict[str, Any]]()
    texts: Any = swept_texts(results)
    columns = {name: words for group in judged_columns(results) for name, words in group.items()}
    for key in choices(results.study.cells):
        others = texts.drop(columns=key)
        for column, (what, better, _) in columns.items():
            for test in paired_tests(results, lanes, column, texts[key], others):
                if not test.can_tell:
                    continue
                names = (value_name(key, texts[key][n]) for n in (test.better, test.worse))
                labels = results.study.cells[test.better].labels
                setting = labels_title({name: labels[name] for name in others})
                row = dict(zip(("first", "second"), names, strict=True)) | {"setting": setting}
                finding = f"first: {better} {what}" if test.found else "no difference"
                row |= {"found": finding, "pairs": test.lanes, "p": test.p}
                rows.append({"compared": key_name(key), "by": what} | row)
    if not rows:
        return ""
    tests = sorted(rows, key=lambda each: each["p"])[:MOST_TESTS]
    which = f"The least {len(tests)} " if len(tests) < len(rows) else ""
    table = f"{sortable_table(pd.DataFrame(tests))}{notes_html([P_WORDS])}"
    title = f"{which}p values of {count(len(rows), 'comparison')}"
    return f"<details><summary>{title}</summary>{table}</details>"
