"""What theory proves of a study, and where a defence's assumptions do not hold, in sentences."""

from collections.abc import Sequence
from html import escape

import numpy as np
import pandas as pd

from jaxnet.config.keys import Scenario
from jaxnet.kinds.kind import vehicle_numbers
from jaxnet.lanes.jobs import first_attacked_vehicles, lane_graphs
from jaxnet.model.graph import Digraph
from jaxnet.model.wording import count, ranges
from jaxnet.store.results import Results
from jaxnet.theory.tolerance import is_borne
from jaxnet.view.page.judged import JudgedLanes
from jaxnet.view.page.where import where_words
from jaxnet.view.text.check import AlikeCells
from jaxnet.view.text.facts import UNPROVED, attacked_at_once, starved_words
from jaxnet.view.text.verdict import NO_AGREEMENT, OF_BOUNDS, OF_LIARS, OF_REST, Claim

MOST_DRAWS = 20_000  # different sets of drawn vehicles that are tried; a few seconds


def proved_sentence(results: Results, theory: Sequence[AlikeCells]) -> str:
    """What `jaxnet check` says first, without what other sentences tell: bounds, liars, rest.

    An agreement that is not proved has its reason, unless too many are attacked.
    """
    where = dict[Claim, list[int]]()
    for each in theory:
        beaten = any(place == OF_LIARS for place, _ in each.claims)
        for place, claim in each.claims:
            if (place, claim) == NO_AGREEMENT:
                why = each.facts.get("guarantee", "").partition(UNPROVED)[2]
                claim = f"{claim} ({why})" * bool(why and not beaten)
            if claim and place not in (OF_BOUNDS, OF_LIARS, OF_REST):
                cells = where.setdefault((place, claim), [])
                cells.extend(cell.number for cell in each.cells)
    told = (
        f"<li>{escape(claim)}"
        + f": {where_words(results, sorted(cells))}" * (len(cells) < len(results.study.cells))
        + ".</li>"
        for (_, claim), cells in sorted(where.items())
    )
    return f"<b>By theory</b> (<code>jaxnet check</code>):<ul>{''.join(told)}</ul>" if where else ""


def ideal_sentence(results: Results) -> str:
    """Where detectors know what no vehicle can."""
    detectors = [cell.scenario.detector for cell in results.study.cells]
    ideal = [cell for cell, each in enumerate(detectors) if each.present and each.predicts.exact]
    if not ideal:
        return ""
    told = f"<b>Detectors know the true motion</b> {where_words(results, ideal)}".rstrip()
    return f"{told}: an ideal observer, which no real vehicle has."


def outside_by_draw(results: Results, lanes: JudgedLanes) -> dict[int, pd.Series]:
    """Whether the draw of a lane is outside the assumptions of its defence, by sample.

    Only of cells whose lanes draw their attacked vehicles or their links, while there are at most
    a few thousand different draws.
    """
    found, left = dict[int, pd.Series](), MOST_DRAWS
    for cell in results.study.cells:
        scenario, samples = cell.scenario, lanes[cell.number].index
        redrawn, attack = scenario.topology.redrawn(), scenario.attack
        if not attack.number() or (attack.targets() and not redrawn):
            continue
        given = results.study.config, scenario, samples.tolist()
        sets, which = np.unique(first_attacked_vehicles(*given), axis=1, return_inverse=True)
        left -= len(samples) if redrawn else sets.shape[1]
        if left < 0:
            break
        if redrawn:
            draws = zip(lane_graphs(*given), sets.T[which], strict=True)
            which = slice(None)
        else:
            draws = ((attacked_at_once(scenario)[0], each) for each in sets.T)
        beyond = [is_outside(scenario, graph, vehicle_numbers(each)) for graph, each in draws]
        found[cell.number] = pd.Series(np.array(beyond)[which], index=samples)
    return found


def is_outside(scenario: Scenario, graph: Digraph, vehicles: list[int]) -> bool:
    """Whether a defence is not set for an attack on these vehicles of a graph.

    Without a navigator a defence for up to F liars asks for a graph that is robust enough, else no
    vehicle may hear more attacked sources than it bears.
    """
    defence, attacked = scenario.defence, scenario.attack.on(vehicles).attacked_links(graph)
    if scenario.leaderless and (F := defence.tolerates()) is not None:
        borne = is_borne(graph, attacked, len(vehicles), F)
        if borne is not None:
            return not borne
    return bool(defence.outnumbered(graph, attacked, defence.trusts(graph)).any())


def outnumbered_sentence(results: Results) -> str:
    """Where vehicles hear more attacked sources than they can drop, or at some ticks too few."""
    found, starved = dict[tuple[str, str, str], list[int]](), dict[str, list[int]]()
    for cell in results.study.cells:
        if cell.scenario.topology.redrawn():
            continue
        defence, given = cell.scenario.defence, attacked_at_once(cell.scenario)
        (graph, attacked, trusted), which = given, defence.outnumbered(*given)
        drops = defence.may_drop(graph, trusted).links.any(axis=1)
        few = f"it drops nobody: the rule asks {defence.asks()}"
        for each, why in (which & drops, "more than it can drop"), (which & ~drops, few):
            if each.any():
                most = count(int(attacked[each].sum(axis=1).max()), "attacked source")
                key = ranges(vehicle_numbers(each)), why, most
                found.setdefault(key, []).append(cell.number)
        if attacked.any() and (words := starved_words(cell.scenario)):
            starved.setdefault(words, []).append(cell.number)
    whom = (
        f"<li>vehicle{'' if who.isdigit() else 's'} {who} {where_words(results, cells)}".rstrip()
        + f": up to {most}, {why}</li>"
        for (who, why, most), cells in found.items()
    )
    told = [f":<ul>{''.join(whom)}</ul>"] if found else []
    ticks = "; ".join(f"{w} {where_words(results, n)}".rstrip() for w, n in starved.items())
    told += [f" at some ticks: {ticks}."] * bool(ticks)
    return " ".join(f"<b>Outside the assumptions of the defence</b>{each}" for each in told)
