"""The best combination of swept kinds, in one sentence: what the page says first."""

from collections import Counter
from collections.abc import Iterable, Sequence
from functools import partial
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
    every, best = combined.drop_duplicates(), left.drop_duplicates().index
    by_lanes = {
        combined[cell]
        for (cell, other), each in worse.items()
        if each.by_lanes and combined[other] not in beaten
    }
    close = every[every.isin(beaten - by_lanes)].index
    of = joined_names([*map(key_name, kinds)])
    several = len(kinds) > 1
    if left.empty:
        return f"<b>No {'combination of ' * several}{escape(of)} is best in every setting</b>."
    if len(best) == len(every):
        return ""
    names = partial(combination_names, results, kinds, every.index)
    if (where := names(best)) is None:
        return ""
    equal = ", between which no difference that counts is found" * (len(best) > 1)
    of = f"combination{'s' * (len(best) > 1)} of {of}" if several else of
    among = ", where errors have settled" * bool(falling)
    told = f"{of}{among}{equal}: {where}"
    numbers = numbers_words(results, [*left.index], lanes)
    least, fewest = fewest_fallen(left, lanes)
    if len(fewest) < len(best) and has_verdict(results):
        where = escape(str(names(every[every.isin(fewest)].index)))
        numbers += f". The fewest such lanes, <b>{least:,}</b> in all, are with {where}"
    if others := len(close) and has_verdict(results) and names(close):
        numbers += f". Numbers of lanes do not tell {escape(others)} from it, only lengths do"
    return f"<b>Best {escape(told)}</b>. {numbers}.{dropping_words(results, [*left.index])}"


def fewest_fallen(combined: Any, lanes: JudgedLanes) -> tuple[int, list[str]]:
    """The least number of lanes of a combination that do not hold, and which combinations have it.

    `combined` has the combination of each cell.
    """
    lost = Counter[str]()
    for cell, name in combined.items():
        lost[name] += int(lanes[cell]["fallen"].sum())
    least = min(lost.values())
    return least, [name for name, number in lost.items() if number == least]


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


def dropping_words(results: Results, cells: Sequence[int]) -> str:
    """In which cells a defence may drop all neighbours of each vehicle, or all sources."""
    found, led = list[int](), True
    for cell in cells:
        scenario = results.study.cells[cell].scenario
        if scenario.topology.redrawn():
            continue
        graph, _, trusted = attacked_at_once(scenario)
        drops, led = scenario.defence.may_drop(graph, trusted), scenario.navigator.present
        neighbours = graph.heard & (graph.sources > 0)
        kept = (neighbours & ~drops.links).any() or (drops.number < neighbours.sum(axis=1)).any()
        if not kept and neighbours.any():
            found.append(cell)
    if not found:
        return ""
    where = f" {where_words(results, found, cells)}" if len(found) < len(cells) else " there"
    alone = f"neighbours{where}, and hear the navigator alone" if led else f"sources{where}"
    return f" A vehicle may drop all of its {alone}."


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
