"""The best combination of swept kinds, in one sentence: what the page says first."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import pandas as pd

from jaxnet.config.cells import is_leaderless, judged_metric
from jaxnet.config.naming import choices_words, key_name
from jaxnet.statistics.recovery import attacked_mask
from jaxnet.store.results import Results
from jaxnet.view.drawings.words import error_text
from jaxnet.view.page.compared import named, swept_texts, wins
from jaxnet.view.page.grid import choices
from jaxnet.view.page.judged import (
    fallen_words,
    falling_cells,
    judged_lanes,
    judged_word,
)
from jaxnet.view.page.where import MOST_TOLD, joined_names
from jaxnet.view.text.facts import attacked_at_once

MOST_COMPARED = 20_000  # of two cells; a few seconds


def best_sentence(results: Results, fallen: Mapping[int, pd.Series]) -> str:
    """The combinations of swept choices that no other beats in any setting, with their numbers.

    Under attack, and where errors have settled, lanes are compared by whether they hold (`fallen`,
    by cell), then by their errors. "" where all combinations do as well, where another beats each
    of them, and where lanes are not compared.
    """
    swept: Any = swept_texts(results)[attacked_mask(results.study.cells)]
    swept = swept.drop(index=falling_cells(results), errors="ignore")
    kinds = choices(results.study.cells)
    if not kinds or swept.empty:
        return ""
    combined = swept[[*kinds]].agg(tuple, axis="columns").map(str)
    if len(combined) * combined.nunique() > 2 * MOST_COMPARED:
        return ""
    left, others = combined, swept.drop(columns=[*kinds])
    for lanes in (fallen, judged_lanes(results, swept.index, "m")):
        if won := wins(results, lanes, left, others.loc[left.index]):
            left = left[~left.isin(won.beaten())]
    labels = [results.study.cells[cell].labels for cell in combined.drop_duplicates().index]
    there = [{key: each[key] for key in kinds} for each in labels]
    best = [there[place] for place, each in enumerate(combined.unique()) if each in {*left}]
    where, of = choices_words(best, there) if best else [], joined_names([*map(key_name, kinds)])
    if len(kinds) == 1:
        where = [named(kinds[0], str(each[kinds[0]])) for each in best]
    if len(best) in (0, len(there)) or len(where) > MOST_TOLD:
        return ""
    among = ", where errors have settled" * bool(falling_cells(results))
    told = f"{'combination of ' * (len(kinds) > 1)}{of}{among}: {'; '.join(where)}"
    numbers = numbers_words(results, [*left.index], fallen)
    return f"<b>Best {escape(told)}</b>. {numbers}.{dropping_words(results, [*left.index])}"


def dropping_words(results: Results, cells: Sequence[int]) -> str:
    """Whether a defence may drop all neighbours of each vehicle of cells, or all sources."""
    led = True
    for scenario in (results.study.cells[cell].scenario for cell in cells):
        graph, _, trusted = attacked_at_once(scenario)
        drops, led = scenario.defence.may_drop(graph, trusted), scenario.navigator.present
        neighbours = graph.heard & (graph.sources > 0)
        kept = (neighbours & ~drops.links).any() or (drops.number < neighbours.sum(axis=1)).any()
        if kept or not neighbours.any():
            return ""
    alone = "neighbours there, and hear the navigator alone" if led else "sources there"
    return f" A vehicle may drop all of its {alone}."


def numbers_words(results: Results, cells: Sequence[int], fallen: Mapping[int, pd.Series]) -> str:
    """How many lanes of cells do not hold, and the greatest errors."""
    alone = is_leaderless(results.study.cells)
    lanes = pd.concat([fallen[cell] for cell in cells])
    table: Any = results.cells.reset_index(drop=True).loc[cells]
    median = table[f"{judged_metric(results.study.cells)}_median"].max()
    word = judged_word(results)
    told = [f"the {word} of a cell's median lane is at most <b>{error_text(median)} m</b>"]
    if ways := fallen_words(results):
        told.insert(0, f"<b>{lanes.sum():,} of {len(lanes):,} lanes</b> {ways}")
    if not alone:
        worst = error_text(table["tail_max_max"].max())
        told.append(f"that of the worst vehicle <b>{worst} m</b>")
    else:
        told.append(f"the worst way out is <b>{error_text(table['outside_max'].max())} m</b>")
    return f"{'Even there' if lanes.mean() > 0.5 else 'There'} {joined_names(told)}"
