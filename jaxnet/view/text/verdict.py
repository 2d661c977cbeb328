"""The verdict of `jaxnet check`: what is proved and what may go wrong, in a few sentences."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from jaxnet.config.cells import Cell
from jaxnet.kinds.kind import vehicle_numbers
from jaxnet.model.wording import cells_named, count, ranges
from jaxnet.theory.case import Case
from jaxnet.theory.spread import bounded_vehicles
from jaxnet.view.text.facts import UNSTABLE, Facts, attacked_at_once, dropping_all
from jaxnet.view.text.width import WIDEST, filled, swept_words

NO_AGREEMENT = 1, "No agreement is proved"
UNSAFE = 1, "No vehicle is proved safe from the attack"
OF_BOUNDS, OF_LIARS, OF_REST = 2, 3, 8  # places in the verdict
BOUNDED = OF_BOUNDS, "Errors have a proved bound (`jaxnet fit`)"
UNBOUNDED = OF_BOUNDS, "Errors have no proved bound"
NOTHING = (NO_AGREEMENT, UNSAFE, UNBOUNDED)  # goes without saying where others of the place are
VERDICT_LINES = 9  # with the study's size

Claim = tuple[int, str]  # a place in the verdict, and a sentence without its cells


def claims(case: Case, found: dict[str, Any], lines: Facts) -> Iterator[Claim]:
    """Claims of theory about a cell: proofs under an attack, and what may go wrong."""
    scenario, defence = case.scenario, case.scenario.defence
    graph, attacked, trusted = attacked_at_once(scenario)
    drops, known = defence.may_drop(graph, trusted), not scenario.topology.redrawn()
    dropped, surely = drops.links[np.asarray(drops.number) > 0].any(), dropping_all(scenario).any()
    agreed = "agreement" in found and found["agreement"].proved
    for name in (name for name, line in lines.items() if UNSTABLE in line):
        yield 0, f"WARNING: unstable, deviations grow (line `{name}`)"
    if scenario.attack.present and scenario.leaderless:
        inside = "Guarantee: honest vehicles agree inside the box (not the hull) of their starts"
        yield (1, inside) if agreed else NO_AGREEMENT
    elif scenario.attack.present:
        reasons = found["safe"].reasons if "safe" in found else ()
        safe = np.any([each.vehicles for each in reasons] or [[False]], axis=0)
        some = ranges(vehicle_numbers(safe))
        who = "Every vehicle is" if safe.all() else f"Only vehicles {some} are"
        who = f"Only vehicle {some} is" if some.isdigit() else who
        yield (1, f"{who} proved safe from the attack") if safe.any() else UNSAFE
        if (bounded := bounded_vehicles(scenario)) is not None and bounded.all():
            yield BOUNDED
        elif not safe.all():
            yield UNBOUNDED
    if known and scenario.attack.present and defence.outnumbered(graph, attacked, trusted).any():
        hears = "hears" if scenario.attack.targets() else "may hear"
        yield OF_LIARS, f"A vehicle {hears} more attackers than its defence bears"
    if scenario.attack.present and "honest paths" in found and found["honest paths"].cut_off:
        far = ranges(found["honest paths"].cut_off)
        whom = f"vehicle{'' if far.isdigit() else 's'} {far}"
        drawn = "" if scenario.attack.targets() else ", in some lanes"
        yield 4, f"No honest path leads from the navigator to {whom}{drawn}"
    if known and scenario.leaderless and surely:
        yield 5, "A vehicle drops all sources (F too great), and stays where it starts"
    elif scenario.leaderless and not agreed and dropped:
        yield 5, "Vehicles drop sources, so the fleet may break apart"
    if "cut off" in found:
        then = "its lane fails" if scenario.law.couples() and not defence.coasts() else "coasts"
        what = "drops all sources (F too great)" if surely else "may be cut off"
        yield 5, f"A vehicle {what}, and {then}"
    if "keeps moving" in found and not found["keeps moving"].every_start:
        yield OF_REST, "A vehicle may come to rest from some starts (line `at rest`)"


def verdict_lines(first: Sequence[str], said: Sequence[tuple[Claim, int]], cells: Sequence[Cell]):
    """First sentences, then claims with their cells; in fewer words where lines are too many."""
    where: dict[Claim, list[int]] = {}
    for claim, number in said:
        where.setdefault(claim, []).append(number)
    places = Counter(place for place, _ in where)
    some = [each for each in sorted(where) if each not in NOTHING or places[each[0]] == 1]
    few = WIDEST // 2
    for most, shown in ((WIDEST, some), (few, some), (few, some[:-1]), (0, some), (0, some[:-1])):
        told = [f"{each[1]}{placed(where[each], cells, most)}." for each in shown]
        lines = [line for each in (*first, *told) for line in filled(each).splitlines()]
        if len(lines) <= VERDICT_LINES:
            break
    return lines


def placed(numbers: Sequence[int], cells: Sequence[Cell], most: int) -> str:
    """Cells by their swept values, by numbers where these take too many letters; "" for all."""
    words = swept_words(numbers, cells)
    if len(words) <= most or not words:
        return f": {words}" * bool(words)
    return f", in {cells_named(sorted(numbers))}" if most else f", in {count(len(numbers), 'cell')}"
