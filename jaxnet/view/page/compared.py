"""Swept kinds compared: which value does better, by tests of paired lanes, as words and tables."""

import itertools
import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from jaxnet.config.keys import Sequential
from jaxnet.config.naming import is_kind, key_name, labels_title, value_alone, value_name
from jaxnet.model.wording import cells_named, count_between
from jaxnet.statistics.groups import swept_values_of
from jaxnet.statistics.pairs import CellsCompared, compared_cells
from jaxnet.store.results import Results
from jaxnet.view.page.elements import notes_html, sentence_case, sortable_table
from jaxnet.view.page.judged import ComparedBy, falling_cells, judged_word, percent_text
from jaxnet.view.page.where import MOST_TOLD, values_told

Pair = tuple[str, str]  # two values of a key as text: the better, the worse
TestRows = list[dict[str, Any]]  # of the table of p values
P_WORDS = (
    "tests on paired lanes: McNemar's exact test of lanes that recover, or agree, and the exact"
    " sign test of errors and distances; p is adjusted by Holm over the comparisons of a key in"
    " which enough lanes differ"
)
SETTING_WORDS = (
    "a setting is one combination of the other swept keys; in 2 of 3: in so many settings paired"
    " lanes show a difference (p values below)"
)
RANGE_WORDS = "from … to …: the least and the greatest of the cells"


class Wins(NamedTuple):
    """Which values of a swept kind are better than which.

    Attributes
    ----------
    found
        The tests that find a difference, by the better and the worse value.
    settings
        The cells of each setting, a combination of the other swept keys, that are compared.
    lanes
        Numbers of paired lanes in the settings.
    every
        Number of settings, also of those whose lanes failed.
    """

    found: Mapping[Pair, Sequence[CellsCompared]]
    settings: Sequence[Mapping[str, int]]
    lanes: Sequence[int]
    every: int

    def of(self, pair: Pair) -> int:
        """In how many settings two values are compared."""
        return sum({*pair} <= {*cells} for cells in self.settings)


def swept_texts(results: Results, numbers: Sequence[int]) -> pd.DataFrame:
    """Values of the swept keys in these cells, as text."""
    labels = [results.study.cells[n].labels for n in numbers]
    return pd.DataFrame(labels, [*numbers], list(results.study.cells[0].labels)).map(str)


def swept_kinds(results: Results, numbers: Sequence[int]) -> list[str]:
    """Swept keys of kinds or texts that have two values in these cells."""
    labels = [results.study.cells[n].labels for n in numbers]
    return [
        key
        for key in results.study.cells[0].labels
        if len({str(each[key]) for each in labels}) > 1
        and (is_kind(key) or all(isinstance(each[key], str) for each in labels))
    ]


def named(key: str, label: str) -> str:
    """The value of a kind, or of another key that the sentence has named."""
    return value_name(key, label) if is_kind(key) else value_alone(key, label)


def wins(
    results: Results, key: str, quantity: ComparedBy, swept: pd.DataFrame, tests: TestRows
) -> Wins | None:
    """Compare the values of a swept kind in every setting; `tests` gets a row for each pair.

    Lanes of a setting are compared in pairs of the same draw. There is no test (None) of lanes that
    are not independent, and of a number of lanes that depends on them.
    """
    study, others = results.study.config, swept.drop(columns=key)
    label_of: dict[int, str] = swept[key].to_dict()
    groups = dict[Any, dict[str, int]]()
    for cell, rest in zip(swept.index.tolist(), others.to_numpy().tolist(), strict=True):
        groups.setdefault(tuple(rest), {})[label_of[cell]] = cell
    ended = ({k: n for k, n in cells.items() if n in quantity.lanes} for cells in groups.values())
    settings = [cells for cells in ended if len(cells) > 1]
    if study.draws != "random" or isinstance(study.samples, Sequential) or not settings:
        return None
    found, lanes = dict[Pair, list[CellsCompared]](), list[int]()
    for test in compared_cells(quantity.lanes, [[*cells.values()] for cells in settings]):
        ends = label_of[test.better], label_of[test.worse]
        lanes.append(test.lanes)
        if test.found:
            found.setdefault(ends, []).append(test)
        mine = results.study.cells[test.better].labels
        setting = labels_title({name: mine[name] for name in others if len({*others[name]}) > 1})
        better, worse = (value_name(key, each) for each in ends)
        told = key_name(key), quantity.name, better, worse, setting
        names = "compared", "by", "first", "second", "setting"
        row = dict(zip(names, told, strict=True))
        row |= {"better": better if test.found else "not found", "pairs": test.lanes, "p": test.p}
        tests.append(row)
    return Wins(found, settings, lanes, len(groups))


def verdict_words(key: str, labels: Sequence[str], won: Wins) -> str:
    """Which value of a key does best, if one does; else which do as well, or that it depends."""
    if not won.found:
        many = count_between(won.lanes, "pair")
        return f"no difference is found with {many} in a setting; a small one would not show"
    beaten = {worse for _, worse in won.found}
    best = [label for label in labels if label not in beaten]
    if not best:
        return "which is better depends on the other keys (table)"
    told = joined_names([f"<b>{escape(named(key, each))}</b>" for each in best])
    others = [label for label in labels if label in beaten]
    pairs = [*itertools.product(best, others)]
    times = [len(won.found.get(pair, ())) for pair in pairs]
    if not min(times):
        return f"no other is better than {told}"
    than = escape(named(key, others[0])) if len(others) == 1 else "each of the others"
    verb = "is" if len(best) == 1 else "are"
    return f"{told} {verb} better than {than}{settings_words(times, [*map(won.of, pairs)], won)}"


def joined_names(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def settings_words(times: Sequence[int], every: Sequence[int], won: Wins) -> str:
    """In how many settings something is found; "" of a study with one."""
    if won.every == 1:
        return ""
    if [*times] == [*every]:
        if min(every) == won.every:
            return " in both settings" if won.every == 2 else f" in all {won.every} settings"
        these = f"all {min(every)} settings" if min(every) > 1 else "the one setting"
        return f" in {these} of {won.every} that can be compared"
    found, there = (f"{min(n)} to {max(n)}" if min(n) < max(n) else max(n) for n in (times, every))
    return f" in {found} of {there} settings, and worse in none"


def better_words(results: Results, key: str, label: str, won: Wins) -> str:
    """The values of a key to which one is better, with the settings; a dash if there are none."""
    there = [results.study.cells[cell] for cells in won.settings for cell in cells.values()]
    grouped = dict[str, list[str]]()
    for (better, worse), found in won.found.items():
        if better != label:
            continue
        mine = sorted({cell for test in found for cell in (test.better, test.worse)})
        among = [cell for cell in there if str(cell.labels[key]) in (better, worse)]
        words, alike = values_told(results, mine, among)
        where, every = f" ({words})" * bool(words and alike == len(mine)), won.of((better, worse))
        where = f" in {len(found)} of {every}{where}" * (won.every > 1)
        grouped.setdefault(where, []).append(named(key, worse))
    return "; ".join(f"{', '.join(names)}{where}" for where, names in grouped.items()) or "–"


def comparisons(
    results: Results,
    quantities: Sequence[ComparedBy],
    keys: Sequence[str],
    tests: TestRows,
) -> tuple[list[str], list[str]]:
    """A sentence and a table for each swept kind."""
    sentences, tables = list[str](), list[str]()
    for key in keys:
        verdicts, heads, labels = dict[str, list[str]](), dict[str, dict[str, str]](), list[str]()
        for each in quantities:
            swept = swept_texts(results, each.values.index.tolist())
            there: Any = swept.loc[each.values.index, key]
            values: Any = each.values.groupby(there, sort=False)
            order: list[str] = values.mean().sort_values(kind="stable").index.tolist()
            labels = labels or order
            heads[f"{each.name} [{each.unit}]"] = {
                label: " to ".join(dict.fromkeys(map(each.told, (some.min(), some.max()))))
                for label, some in values
            }
            if won := wins(results, key, each, swept, tests):
                verdicts.setdefault(verdict_words(key, order, won), []).append(each.name)
                heads[each.better] = {
                    label: better_words(results, key, label, won) for label in order
                }
        rest = "; ".join(f"by {' and '.join(names)}: {told}" for told, names in verdicts.items())
        if rest:
            sentences.append(f"<b>{escape(sentence_case(key_name(key)))}</b>, {rest}.")
        column = [named(key, label) for label in labels]
        shown = {head: [told.get(label, "–") for label in labels] for head, told in heads.items()}
        tables.append(sortable_table(pd.DataFrame({key_name(key): column, **shown})))
    return sentences, tables


def averages_words(results: Results, shares: pd.Series) -> str:
    """The share [%] averaged over the cells of each swept value, the key that moves it most first.

    Only a full product of the swept values has fair averages; "" of other cells, and of one key.
    """
    cells = [results.study.cells[n] for n in shares.index]
    known = {key: there for key, there in swept_values_of(cells).items() if len(there) > 1}
    if len(known) < 2 or math.prod(map(len, known.values())) != len(cells):
        return ""
    found = shares.to_numpy()
    spans = list[tuple[float, str]]()
    for key, values in known.items():
        of_value = [[cell.labels[key] == value for cell in cells] for value in values]
        means = [found[which].mean() for which in of_value]
        ends = (
            f"{percent_text(means[place])} % with {escape(value_name(key, values[place]))}"
            for place in (int(np.argmin(means)), int(np.argmax(means)))
        )
        spans.append((float(np.ptp(means)), " to ".join(ends)))
    told = [words for span, words in sorted(spans, reverse=True) if span][:MOST_TOLD]
    if not told:
        return ""
    return f"Averaged over the other keys, the share goes from {'; from '.join(told)}."


def tables_html(results: Results, tables: Sequence[str], *, tested: bool) -> str:
    """Tables of `comparisons`, with notes below them."""
    if not tables:
        return ""
    notes = [RANGE_WORDS, *[SETTING_WORDS] * tested]
    if falling := falling_cells(results):
        notes.append(f"left out, as the {judged_word(results)} still falls: {cells_named(falling)}")
    return "".join(tables) + notes_html(notes)
