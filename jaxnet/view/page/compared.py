"""Swept kinds compared: which value does better, by tests of paired lanes, as words and tables."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from jaxnet.config.keys import Sequential
from jaxnet.config.naming import (
    choices_words,
    is_kind,
    key_name,
    labels_title,
    value_alone,
    value_name,
)
from jaxnet.model.wording import cells_named, count, count_between
from jaxnet.statistics.groups import Label, swept_values_of
from jaxnet.statistics.pairs import CellsCompared, compared_cells
from jaxnet.statistics.tiles import lost_name
from jaxnet.store.results import Results
from jaxnet.view.page.elements import notes_html, sentence_case, sortable_table
from jaxnet.view.page.judged import (
    FAILED,
    ComparedBy,
    falling_cells,
    judged_word,
    known_shares,
    percent_text,
    settled,
)
from jaxnet.view.page.where import MOST_LETTERS, MOST_TOLD, joined_names

Pair = tuple[str, str]  # two values of a key as text: the better, the worse
TestRow = dict[str, Any]  # of the table of p values
NOT_FOUND = "no difference is found"
LEAST_SPAN = 5.0  # [%], of averages that are told
MOST_TESTS = 200  # in the table of p values
P_WORDS = (
    "tests on paired lanes: McNemar's exact test of lanes that recover, or agree, and the exact"
    " sign test of errors and distances; errors of lanes that recover, or agree, are equal; p is"
    " adjusted by Holm over the comparisons of a key in which enough lanes differ"
)
SETTING_WORDS = (
    "a setting is one combination of the other swept keys; in 2 of 3 settings: paired lanes show"
    " the difference in so many of them"
)


class Wins(NamedTuple):
    """Tests of which values of a swept kind are better than which.

    Attributes
    ----------
    tests
        The tests by the better and the worse value, whether they find a difference or not.
    settings
        The cells of each setting, a combination of the other swept keys, that are compared.
    every
        Number of settings, also of those whose lanes failed.
    """

    tests: Mapping[Pair, Sequence[CellsCompared]]
    settings: Sequence[Mapping[str, int]]
    every: int

    def found(self, better: str, worse: str) -> list[CellsCompared]:
        """The tests that find one value better than another."""
        return [test for test in self.tests.get((better, worse), ()) if test.found]

    def of(self, pair: Pair) -> int:
        """In how many settings two values are compared."""
        return sum({*pair} <= {*cells} for cells in self.settings)

    def beaten(self) -> set[str]:
        """The values to which another is better in some setting."""
        return {worse for better, worse in self.tests if self.found(better, worse)}


Tested = Sequence[tuple[ComparedBy, Wins]]


class Comparisons(NamedTuple):
    """A sentence for each swept kind, and a row for each test of two values."""

    sentences: list[str]
    tests: list[TestRow]

    def folded(self) -> str:
        """The table of tests, which opens at a click, as HTML."""
        if not self.tests:
            return ""
        tests = sorted(self.tests, key=lambda each: each["p"])[:MOST_TESTS]
        which = f"The least {len(tests)} " if len(tests) < len(self.tests) else ""
        title = f"{which}p values of {count(len(self.tests), 'comparison')}"
        table = f"{sortable_table(pd.DataFrame(tests))}{notes_html([P_WORDS])}"
        return f"<details><summary>{title}</summary>{table}</details>"


def swept_texts(results: Results) -> pd.DataFrame:
    """Values of the swept keys as text, by number of the cell."""
    return pd.DataFrame([cell.labels for cell in results.study.cells]).map(str)


def swept_kinds(results: Results) -> list[str]:
    """Swept keys of kinds or texts that have two values."""
    values = swept_values_of(results.study.cells)
    return [
        key
        for key, each in values.items()
        if len(each) > 1 and (is_kind(key) or all(isinstance(value, str) for value in each))
    ]


def named(key: str, label: str) -> str:
    """The value of a kind, or of another key that the sentence has named."""
    return value_name(key, label) if is_kind(key) else value_alone(key, label)


def wins(
    results: Results, lanes: Mapping[int, pd.Series], values: pd.Series, others: pd.DataFrame
) -> Wins | None:
    """Compare values in every setting, lane by lane in pairs of the same draw.

    `values` has the value of each cell, `others` the other swept keys. There is no test (None) of
    lanes that are not independent, and of a number of lanes that depends on them.
    """
    study = results.study.config
    label_of: dict[int, str] = values.to_dict()
    groups = dict[Any, dict[str, int]]()
    for cell, rest in zip(label_of, others.to_numpy().tolist(), strict=True):
        groups.setdefault(tuple(rest), {})[label_of[cell]] = cell
    ended = ({k: n for k, n in cells.items() if n in lanes} for cells in groups.values())
    settings = [cells for cells in ended if len(cells) > 1]
    if study.draws != "random" or isinstance(study.samples, Sequential) or not settings:
        return None
    tests = dict[Pair, list[CellsCompared]]()
    for test in compared_cells(lanes, [[*cells.values()] for cells in settings]):
        tests.setdefault((label_of[test.better], label_of[test.worse]), []).append(test)
    return Wins(tests, settings, len(groups))


def verdict_words(key: str, labels: Sequence[str], won: Wins) -> str:
    """Which value of a key does best, if one does; else which do as well, or that it depends."""
    beaten = won.beaten()
    if not beaten:
        many = count_between([t.lanes for tests in won.tests.values() for t in tests], "pair")
        return f"{NOT_FOUND} with {many} in a setting; a small one would not show"
    best = [label for label in labels if label not in beaten]
    if not best:
        return "which is better depends on the other keys"
    told = joined_names([f"<b>{escape(named(key, each))}</b>" for each in best])
    others = [label for label in labels if label in beaten]
    pairs = [*itertools.product(best, others)]
    every = {won.of(pair) for pair in pairs}
    if len(every) > 1 or any(len(won.found(*pair)) < won.of(pair) for pair in pairs):
        return f"no other is better than {told}" + " in any setting" * (won.every > 1)
    than = escape(named(key, others[0])) if len(others) == 1 else "each of the others"
    verb = "is" if len(best) == 1 else "are"
    (many,) = every
    return f"{told} {verb} better than {than}{settings_words(many, many, won)}"


def settings_words(times: int, every: int, won: Wins) -> str:
    """In how many settings something is found; "" of a study with one."""
    if won.every == 1:
        return ""
    if times < every:
        return f" in {times} of {every} settings"
    if every == won.every:
        return " in both settings" if won.every == 2 else f" in all {won.every} settings"
    these = f"all {every} settings" if every > 1 else "the one setting"
    return f" in {these} of {won.every} that can be compared"


def against_words(results: Results, key: str, pair: Pair, judged: Tested) -> str:
    """Clauses that compare the first value of a pair with the second, with their settings."""

    def labels_of(cells: Iterable[int]) -> list[dict[str, Label]]:
        each = (results.study.cells[cell].labels for cell in cells)
        return [{name: label for name, label in labels.items() if name != key} for labels in each]

    grouped = dict[str, list[str]]()
    for quantity, won in judged:
        every = won.of(pair)
        for words, ends in ((quantity.better, pair), (quantity.worse, pair[::-1])):
            if not (found := won.found(*ends)):
                continue
            where = settings_words(len(found), every, won)
            if len(found) < won.every:
                there = labels_of(range(len(results.study.cells)))
                mine = labels_of(sorted(test.better for test in found))
                settings = "; ".join(choices_words(mine, there))
                where += f" ({escape(settings)})" * (len(settings) <= MOST_LETTERS)
            grouped.setdefault(where, []).append(words)
    return "; ".join(f"{joined_names(words)}{where}" for where, words in grouped.items())


def against_first(results: Results, key: str, labels: Sequence[str], judged: Tested) -> str:
    """Each value against none if it is swept, else the first; a list of more than one."""
    reference = "none" if "none" in labels else labels[0]
    told = dict[str, list[str]]()
    for label in labels:
        if label != reference:
            words = against_words(results, key, (label, reference), judged)
            told.setdefault(words or NOT_FOUND, []).append(named(key, label))
    if len(labels) == 2:
        ((words, (other,)),) = told.items()
        against = escape(named(key, reference))
        return f" With <b>{escape(other)}</b>, against {against}, {words}."
    items = (f"<li>{escape(', '.join(names))}: {words}</li>" for words, names in told.items())
    return f" Against {escape(named(key, reference))}:<ul>{''.join(items)}</ul>"


def comparisons(results: Results, asked: Mapping[str, Sequence[ComparedBy]]) -> Comparisons:
    """Compare the values of each swept kind by quantities; of more than two, all with the first."""
    told, texts = Comparisons([], []), swept_texts(results)
    for key, quantities in asked.items():
        verdicts, judged = dict[str, list[str]](), list[tuple[ComparedBy, Wins]]()
        labels: list[str] = texts[key].drop_duplicates().tolist()
        for each in quantities:
            swept: Any = texts.loc[each.values.index]
            won = wins(results, each.lanes, swept[key], swept.drop(columns=key))
            if won is None:
                continue
            judged.append((each, won))
            told.tests.extend(rows_of_tests(results, key, each, won))
            if each.name != FAILED:  # of which another sentence tells
                verdicts.setdefault(verdict_words(key, labels, won), []).append(each.name)
        words = [f"by {joined_names(names)}: {which}" for which, names in verdicts.items()]
        if words:
            differ = any(won.beaten() for _, won in judged)
            if differ and len(labels) == 2:  # whose difference says which is better
                words = [each for each in words if NOT_FOUND in each]
            verdict = f" {sentence_case('; '.join(words))}." * bool(words)
            against = against_first(results, key, labels, judged) if differ else ""
            both = [verdict, against] if len(labels) > 2 else [against, verdict]
            name = escape(sentence_case(key_name(key)))
            told.sentences.append(f"<b>{name}.</b>{''.join(both)}")
    return told


def rows_of_tests(results: Results, key: str, quantity: ComparedBy, won: Wins) -> Iterator[TestRow]:
    """A row of the table of p values for each test of two values."""
    others = [name for name, each in swept_values_of(results.study.cells).items() if len(each) > 1]
    for pair, tests in won.tests.items():
        better, worse = (value_name(key, each) for each in pair)
        for test in tests:
            labels = results.study.cells[test.better].labels
            setting = labels_title({name: labels[name] for name in others if name != key})
            names = {"first": better, "second": worse, "setting": setting}
            found = {"better": better if test.found else "not found"}
            row = {"compared": key_name(key), "by": quantity.name, **names, **found}
            yield row | {"pairs": test.lanes, "p": test.p}


def averages_sentence(results: Results) -> str:
    """The share [%] averaged over the cells of each swept value, the key that moves it most first.

    Only a full product of the swept values has fair averages; "" of other cells, and of one key.
    """
    shares: Any = settled(results, known_shares(results))["value"]
    cells = [results.study.cells[n] for n in shares.index]
    if not cells:
        return ""
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
    told = [words for span, words in sorted(spans, reverse=True) if span >= LEAST_SPAN]
    if not told:
        return ""
    share = f"the share of lanes {lost_name(results)} goes from"
    return f"<b>Averaged over the other keys</b> {share} {'; from '.join(told[:MOST_TOLD])}."


def tests_html(results: Results, told: Comparisons) -> str:
    """Notes on the sentences, and the tests, which a reader opens."""
    if not told.tests:
        return ""
    notes = [SETTING_WORDS]
    if falling := falling_cells(results):
        notes.append(f"left out, as the {judged_word(results)} still falls: {cells_named(falling)}")
    return notes_html(notes) + told.folded()
