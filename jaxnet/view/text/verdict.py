"""The verdict of `jaxnet check`: what is proved and what may go wrong, in a few sentences."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from jaxnet.config.cells import Cell
from jaxnet.config.scenario import BOUNDS, missing
from jaxnet.model.wording import cells_named
from jaxnet.theory.case import Case
from jaxnet.view.text.facts import UNSTABLE, Facts, attacked_at_once
from jaxnet.view.text.width import MOST_NAMED, filled, swept_words

UNBOUNDED, BOUNDED = "Errors have no proved bound", "Errors have a proved bound (`jaxnet fit`)"
MOST_LINES = 9  # with the study's size

Claim = tuple[int, str]  # a place in the verdict, and a sentence without its cells


def claims(case: Case, found: dict[str, Any], lines: Facts) -> Iterator[Claim]:
    """What is proved of a cell with an attack, and what may go wrong in any cell."""
    scenario, defence = case.scenario, case.scenario.defence
    graph, attacked, trusted = attacked_at_once(scenario)
    drops, F = defence.may_drop(graph, trusted).links, defence.tolerates()
    agreed = "agreement" in found and found["agreement"].proved
    for name in (name for name, line in lines.items() if UNSTABLE in line):
        yield 0, f"WARNING: unstable, deviations grow (line `{name}`)"
    if scenario.attack.present and scenario.leaderless:
        yield 1, "Guarantee: honest vehicles agree" if agreed else "No agreement is proved"
    elif scenario.attack.present:
        reasons = found["safe"].reasons if "safe" in found else ()
        safe = np.any([each.vehicles for each in reasons] or [[False]], axis=0)
        who = "No vehicle is" if not safe.any() else "Only some vehicles are"
        yield 1, f"{'Every vehicle is' if safe.all() else who} proved safe from the attack"
        unknown = missing(scenario, BOUNDS) or np.isinf(found.get("inverse norm", 0.0))
        if not safe.all():
            yield 2, UNBOUNDED if unknown else BOUNDED
    if scenario.attack.present and defence.outnumbered(graph, attacked, trusted).any():
        hears = "hears" if scenario.attack.targets() else "may hear"
        yield 3, f"A vehicle {hears} more attackers than its defence bears"
    if scenario.attack.present and "honest paths" in found and found["honest paths"].cut_off:
        yield 4, "No honest path leads from the navigator to some vehicle"
    if scenario.leaderless and not agreed and drops.any():
        yield 5, "Vehicles drop sources, so the fleet may break apart"
    if "cut off" in found:
        then = "its lane fails" if scenario.law.couples() and not defence.coasts() else "it coasts"
        heard = graph.heard.sum(axis=1)
        surely = F is not None and ((heard > 0) & (heard <= F) & (heard == drops.sum(axis=1))).any()
        why = "F is so great that a vehicle drops all its sources"
        yield 5, f"{why if surely else 'A vehicle may be cut off'}, then {then}"
    if "keeps moving" in found and not found["keeps moving"].every_start:
        yield 6, "A vehicle may come to rest from some starts (line `at rest`)"


def verdict_lines(first: Sequence[str], said: Sequence[tuple[Claim, int]], cells: Sequence[Cell]):
    """First sentences, then claims with their cells: by number where words are too many."""
    where: dict[Claim, list[int]] = {}
    for claim, number in said:
        where.setdefault(claim, []).append(number)
    if (2, BOUNDED) in where:
        where.pop((2, UNBOUNDED), None)
    for most in (MOST_NAMED, MOST_NAMED // 2, 0):
        told = [f"{each[1]}{where_words(where[each], cells, most)}." for each in sorted(where)]
        lines = [line for each in (*first, *told) for line in filled(each).splitlines()]
        if len(lines) <= MOST_LINES:
            break
    return lines


def where_words(numbers: Sequence[int], cells: Sequence[Cell], most: int) -> str:
    """Cells by their swept values, by numbers where these take too many letters; "" for all."""
    words = swept_words(numbers, cells)
    if len(words) <= most or not words:
        return f": {words}" * bool(words)
    return (
        f", in {cells_named(sorted(numbers)) if most else f'{len(numbers)} of {len(cells)} cells'}"
    )
