"""The best combination of swept kinds, in one sentence: what the page says first."""

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

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
from jaxnet.store.results import Results
from jaxnet.view.drawings.words import error_text
from jaxnet.view.page.decided import choices, decisions, swept_texts
from jaxnet.view.page.judged import (
    JudgedLanes,
    fallen_words,
    falling_cells,
    judged_word,
)
from jaxnet.view.page.where import MOST_TOLD, joined_names, where_words
from jaxnet.view.text.facts import attacked_at_once

MOST_COMPARED = 20_000  # of two cells; a few seconds


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
    beaten = {combined[cell] for (cell, _), each in found.items() if each.better is False}
    left = combined[~combined.isin(beaten)]
    every, best = combined.drop_duplicates(), left.drop_duplicates().index
    of = joined_names([*map(key_name, kinds)])
    several = len(kinds) > 1
    if left.empty:
        return f"<b>No {'combination of ' * several}{escape(of)} is best in every setting</b>."
    if len(best) == len(every):
        return ""
    labels = [results.study.cells[cell].labels for cell in best]
    where = [labels_title({key: each[key] for key in kinds}) for each in labels]
    if len(kinds) == 1:
        (key,) = kinds
        named = value_name if is_kind(key) else value_alone
        where = [named(key, str(each[key])) for each in labels]
    if len(where) > MOST_TOLD:
        there = [results.study.cells[cell].labels for cell in every.index]
        chosen = ([{key: each[key] for key in kinds} for each in some] for some in (labels, there))
        where = choices_words(*chosen)
    if len(where) > MOST_TOLD:
        return ""
    equal = ", between which no difference that counts is found" * (len(best) > 1)
    of = f"combination{'s' * (len(best) > 1)} of {of}" if several else of
    among = ", where errors have settled" * bool(falling)
    told = f"{of}{among}{equal}: {'; '.join(where)}"
    numbers = numbers_words(results, [*left.index], lanes)
    return f"<b>Best {escape(told)}</b>. {numbers}.{dropping_words(results, [*left.index])}"


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
    """How many lanes of each cell do not hold, and the greatest errors."""
    alone = is_leaderless(results.study.cells)
    lost, sizes = np.array([[lanes[n]["fallen"].sum(), len(lanes[n])] for n in cells]).T
    table: Any = results.cells.reset_index(drop=True).loc[cells]
    median = table[f"{judged_metric(results.study.cells)}_median"].max()
    word = judged_word(results)
    told = [f"the {word} of a cell's median lane is at most <b>{error_text(median)} m</b>"]
    if ways := fallen_words(results):
        many = f"{lost.min():,} to " * bool(lost.min() < lost.max()) + f"{lost.max():,}"
        each = " in each cell" * (len(cells) > 1)
        told.insert(0, f"<b>{many} of {count_between(sizes.tolist(), 'lane')}</b>{each} {ways}")
    if not alone:
        worst = error_text(table["tail_max_max"].max())
        told.append(f"that of the worst vehicle <b>{worst} m</b>")
    else:
        told.append(f"the worst way out is <b>{error_text(table['outside_max'].max())} m</b>")
    return f"{'Even there' if lost.sum() > 0.5 * sizes.sum() else 'There'} {joined_names(told)}"
