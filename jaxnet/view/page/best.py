"""The best combination of swept kinds, in one sentence: what the page says first."""

from collections import Counter
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import is_leaderless, judged_metric
from jaxnet.config.naming import (
    choices_words,
    is_kind,
    key_name,
    labels_title,
    value_alone,
    value_name,
)
from jaxnet.lanes.jobs import lane_graphs
from jaxnet.model.graph import Digraph
from jaxnet.model.retained import DropPolicy
from jaxnet.model.wording import count_between
from jaxnet.statistics.groups import swept_values_of
from jaxnet.store.results import Results
from jaxnet.view.page.decided import cells_judged, choices, decisions, swept_texts
from jaxnet.view.page.grid import has_verdict, near_text
from jaxnet.view.page.judged import (
    JudgedLanes,
    fallen_words,
    falling_cells,
    judged_word,
)
from jaxnet.view.page.where import MOST_TOLD, joined_names, where_words
from jaxnet.view.text.facts import attacked_at_once

MOST_COMPARED = 20_000  # of two cells; a few seconds
MOST_SETTINGS = 4  # that have numbers of their own
MOST_GRAPHS = 10  # of lanes that draw their links: those that are looked at


def best_sentence(results: Results, lanes: JudgedLanes) -> str:
    """The combinations of swept choices that no other beats in any setting, with their numbers.

    Lanes are compared under attack, by `decisions`. With a navigator cells whose errors still fall
    are left out. "" where no combination beats another, and where the best are too many to tell.
    """
    falling = [] if is_leaderless(results.study.cells) else falling_cells(results)
    swept: Any = swept_texts(results).drop(index=falling, errors="ignore")
    kinds = choices(results.study.cells)
    if not kinds or swept.empty:
        return ""
    combined = swept[[*kinds]].agg(tuple, axis="columns").map(str)
    if len(combined) * combined.nunique() > 2 * MOST_COMPARED:
        return ""
    found = decisions(results, lanes, combined, swept.drop(columns=[*kinds]))
    worse = {pair: each for pair, each in found.items() if each.better is False}
    beaten = {combined[cell] for cell, _ in worse}
    left = combined[~combined.isin(beaten)]
    best = fewest_fallen(left, lanes) if has_verdict(results) else left
    every, cells = combined.drop_duplicates(), [*best.index]
    by_lanes = {
        combined[cell]
        for (cell, other), each in worse.items()
        if each.by_lanes and combined[other] not in beaten
    }
    of = joined_names([*map(key_name, kinds)])
    several = len(kinds) > 1
    if left.empty:
        return f"<b>No {'combination of ' * several}{escape(of)} is best in every setting</b>."
    if left.nunique() == len(every):
        return ""

    def names(some: Iterable[str]) -> str | None:
        there = every[every.isin([*some])].index
        told = combination_names(results, kinds, every.index, there)
        return told if told is None else escape(told)

    if (where := names(best)) is None:
        return ""
    equal = ", between which no difference that counts is found" * (best.nunique() > 1)
    of = f"combination{'s' * (best.nunique() > 1)} of {of}" if several else of
    among = ", where errors have settled" * bool(falling)
    numbers = numbers_words(results, cells, lanes)
    rest = left.drop(index=cells)
    if not rest.empty:
        lost = fallen_numbers(rest, lanes)
        many = sum(len(lanes[cell]) for cell in rest.index) // len(lost)
        where_too = names(rest) or "other combinations"
        numbers += f". Not proved worse: {where_too}, with {span_text(lost)} of {many:,} such lanes"
    if others := has_verdict(results) and names(beaten - by_lanes):
        numbers += f". Numbers of lanes do not tell {others} from it, only lengths do"
    told = f"{escape(of)}{among}{equal}: {where}"
    fallen = np.concatenate([lanes[cell]["fallen"].to_numpy() for cell in cells])
    none = "None holds in most lanes. " * bool(fallen.mean() > 0.5)
    return f"<b>{none}Best {told}</b>. {numbers}.{dropping_words(results, cells)}"


def fallen_numbers(combined: Any, lanes: JudgedLanes) -> pd.Series:
    """How many lanes of each combination do not hold; `combined` has the combination of a cell."""
    lost = Counter[str]()
    for cell, name in combined.items():
        lost[name] += int(lanes[cell]["fallen"].sum())
    return pd.Series(lost)


def fewest_fallen(combined: Any, lanes: JudgedLanes) -> Any:
    """The cells of those combinations of which the fewest lanes do not hold."""
    lost: Any = fallen_numbers(combined, lanes)
    return combined[combined.isin(lost.index[lost == lost.min()])]


def combination_names(
    results: Results, kinds: Sequence[str], every: Iterable[int], some: Iterable[int]
) -> str | None:
    """Names of the combinations of these kinds in `some` cells, of `every`; None of too many."""
    there, labels = (
        [{key: results.study.cells[cell].labels[key] for key in kinds} for cell in cells]
        for cells in (every, some)
    )
    names = [labels_title(each) for each in labels]
    if len(kinds) == 1:
        (key,) = kinds
        named = value_name if is_kind(key) else value_alone
        names = [named(key, str(each[key])) for each in labels]
    if len(names) > MOST_TOLD:
        names = choices_words(labels, there)
    return "; ".join(names) if len(names) <= MOST_TOLD else None


def drops_all(graph: Digraph, drops: DropPolicy) -> bool:
    """Whether vehicles hear others, and each may drop all of these, the navigator apart."""
    near = drops.graph.heard & (drops.graph.sources > 0)
    kept = (near & ~drops.links).any() or (drops.number < near.sum(axis=1)).any()
    return bool(not kept and (graph.heard & (graph.sources > 0)).any())


def dropping_words(results: Results, cells: Sequence[int]) -> str:
    """In which cells a defence drops, or may drop, all neighbours of a vehicle, or all sources."""
    found, config = dict[int, bool](), results.study.config
    led = not is_leaderless(results.study.cells)
    for cell in cells:
        scenario = results.study.cells[cell].scenario
        redrawn, defence = scenario.topology.redrawn(), scenario.defence
        graphs = [attacked_at_once(scenario)[0]]
        if redrawn:
            graphs = lane_graphs(config, scenario, range(min(MOST_GRAPHS, config.most_samples)))
        trusted = [(graph, defence.trusts(graph)) for graph in graphs]
        if all(drops_all(each[0], defence.may_drop(*each)) for each in trusted):
            known = None if redrawn else defence.retained(*trusted[0])
            found[cell] = known is not None and known.fixed is not None
    told = ""
    for sure, words in ((True, "Every vehicle drops all"), (False, "A vehicle may drop all")):
        if not (some := [cell for cell, each in found.items() if each == sure]):
            continue
        where = f" {where_words(results, some, cells)}" if len(some) < len(cells) else " there"
        alone = f"neighbours{where}, and hears the navigator alone" if led else f"sources{where}"
        told += f" {words} of its {alone}."
    return told


def numbers_words(results: Results, cells: Sequence[int], lanes: JudgedLanes) -> str:
    """How many lanes of each cell do not hold, by setting where these are few, and errors."""
    alone = is_leaderless(results.study.cells)
    lost, sizes = np.array([[lanes[n]["fallen"].sum(), len(lanes[n])] for n in cells]).T
    table: Any = results.cells.reset_index(drop=True).loc[cells]
    word, most = judged_word(results), "at most " * (len(cells) > 1)
    median = length_text(table[f"{judged_metric(results.study.cells)}_median"].max(), most)
    told = [f"the {word} of {'a cell' if most else 'the cell'}'s median lane is {median}"]
    if ways := fallen_words(results):
        of = count_between(sizes.tolist(), "lane")
        each = " in each cell" * (len(cells) > 1)
        counts = f"<b>{span_text(lost)} of {of}</b>{each}"
        numbers = [*pd.Series(lost, cells).groupby(settings_beside(results, cells), sort=False)]
        if len({span_text(n) for _, n in numbers}) > 1 and len(numbers) <= MOST_SETTINGS:
            several = [f"<b>{span_text(n)}</b> ({escape(str(where))})" for where, n in numbers]
            counts = f"of {of} a cell {joined_names(several)}"
        told.insert(0, f"{counts} {ways}")
    if not alone:
        told.append(f"that of the worst vehicle {length_text(table['tail_max_max'].max())}")
    else:
        told.append(f"the worst way out is {length_text(table['outside_max'].max())}")
    return f"{'Even there' if lost.sum() > 0.5 * sizes.sum() else 'There'} {joined_names(told)}"


def span_text(numbers: Any) -> str:
    return f"{numbers.min():,} to " * bool(numbers.min() < numbers.max()) + f"{numbers.max():,}"


def length_text(length: float, most: str = "") -> str:
    """A length in bold with the word `most` before it, unless it is about 0."""
    text = near_text(length)
    return f"{most * text.isascii()}<b>{text} m</b>"


def settings_beside(results: Results, cells: Sequence[int]) -> list[str]:
    """The values of each cell's swept keys that one does not choose."""
    every = cells_judged(results.study.cells)
    chosen = choices(every)
    varied = [key for key, values in swept_values_of(every).items() if len(values) > 1]
    labels = [results.study.cells[cell].labels for cell in cells]
    return [labels_title({k: each[k] for k in varied if k not in chosen}) for each in labels]
