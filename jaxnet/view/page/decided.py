"""Pairs of cells compared by what matters first: lanes that hold, lanes that are lost, errors.

The cells of a pair differ in one choice, or in one combination of choices, and have the same draws.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import pandas as pd

from jaxnet.config.cells import is_leaderless
from jaxnet.store.results import Results
from jaxnet.view.page.compared import wins

# By column of lanes, what a test finds of the better and of the worse cell of a pair. A later group
# counts where no test of an earlier one finds a difference.
GONE = {"gone": ("fewer fail or are lost", "more fail or are lost")}
LED = ({"fallen": ("more hold", "fewer hold")}, GONE, {"error": ("smaller error", "greater error")})
ALONE = (
    {
        "out": ("fewer leave the hull", "more leave the hull"),
        "unrecovered": ("more agree", "fewer agree"),
    },
    GONE,
    {"way": ("less far out", "farther out"), "error": ("smaller spread", "greater spread")},
)
ABOUT_DECISIONS = {  # by whether there is no navigator
    False: "lanes that hold; without a difference, lanes that fail or are lost; then errors",
    True: "lanes that leave the hull, and lanes that agree; without a difference, lanes that fail"
    " or are lost; then ways out and spreads",
}


class PairDecision(NamedTuple):
    """What tests find of a cell against another: in words, and whether it is better.

    `better` is None where they find nothing, or disagree.
    """

    words: str
    better: bool | None


def decisions(
    results: Results, lanes: Mapping[int, Any], values: pd.Series, others: pd.DataFrame
) -> dict[tuple[int, int], PairDecision]:
    """Decide each pair of cells that differ in `values` alone, in both orders.

    `lanes` are from `judged_lanes`; `values` and `others` are as for `compared.wins`. Nothing is
    decided of lanes that are not independent.
    """
    found = dict[tuple[int, int], list[tuple[str, bool]]]()
    for group in ALONE if is_leaderless(results.study.cells) else LED:
        fresh = dict[tuple[int, int], list[tuple[str, bool]]]()
        for column, words in group.items():
            won = wins(results, {n: each[column] for n, each in lanes.items()}, values, others)
            for test in (test for tests in won.tests.values() for test in tests) if won else ():
                both = (test.better, test.worse), (test.worse, test.better)
                for pair, is_better in zip(both, (True, False), strict=True):
                    told = [(words[not is_better], is_better)] * test.found
                    fresh.setdefault(pair, []).extend(told)
        for pair, told in fresh.items():
            found[pair] = found.get(pair) or told
    decided = {}
    for pair, told in found.items():
        ways = {is_better for _, is_better in told}
        words = ", ".join(words for words, _ in told)
        decided[pair] = PairDecision(words, ways.pop() if len(ways) == 1 else None)
    return decided
