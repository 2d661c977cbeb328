"""Sentences that compare the values of a swept key, by tests of paired lanes."""

import itertools
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import pandas as pd

from jaxnet.config.cells import is_leaderless, judged_metric
from jaxnet.config.keys import Sequential
from jaxnet.config.naming import is_kind, key_name, labels_title, value_alone, value_name
from jaxnet.model.wording import count, count_between, number_text
from jaxnet.statistics import curves
from jaxnet.statistics.amplitude import ROUNDING_ERROR
from jaxnet.statistics.groups import swept_values_of
from jaxnet.statistics.pairs import CellsCompared, compared_cells
from jaxnet.statistics.recovery import (
    threshold,
)
from jaxnet.store import rows
from jaxnet.store.results import Results
from jaxnet.view.drawings.words import error_text
from jaxnet.view.page.elements import sentence_case
from jaxnet.view.page.where import MOST_TOLD, values_told

TestRows = list[dict[str, Any]]  # of the table of p values
NO_DIFFERENCE = "no difference by"
MOST_COMPARED = 8  # values of a swept key in one sentence


def kinds_words(
    results: Results,
    estimates: pd.DataFrame,
    unit: str,
    tests: TestRows,
    left_out: Sequence[int] = (),
    *,
    listed: bool = True,
) -> str:
    """Sentences that compare the values of each swept kind; "" if none has two.

    `left_out` are cells without an estimate, as their lanes failed. With `listed` the range of the
    estimates is told for each value.
    """
    values, numbers = estimates.loc[:, "value"], estimates.index.tolist()
    swept = swept_texts(results, [*numbers, *left_out])
    kinds = [key for key in swept_kinds(results, numbers) if key != "filter"]
    parts = [
        compared_words(results, key, values, swept, unit, tests, listed=listed)
        for key in kinds  # but filters, which `separation_sentence` compares
    ]
    return "".join(f" {sentence_case(each)}." for each in parts if each)


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


def compared_words(
    results: Results,
    key: str,
    values: pd.Series,
    swept: pd.DataFrame,
    unit: str,
    tests: TestRows,
    *,
    listed: bool,
) -> str:
    """The range of each value of a swept kind, and which values are found better than which."""
    there: Any = swept.loc[values.index, key]
    of_labels: Any = {label: values[there == label] for label in dict.fromkeys(there)}
    parts: dict[str, str] = {}
    number = percent_text if unit == "%" else error_text
    for label, some in sorted(of_labels.items(), key=lambda each: each[1].mean()):
        ends = dict.fromkeys(map(number, (some.min(), some.max())))
        parts[str(label)] = f"<b>{' to '.join(ends)} {unit}</b>"
    lanes, word = judged_lanes(results, values.index, unit), judged_word(results)
    subject, more = word, f"in more lanes the {word} is smaller"
    if unit == "%":
        subject, more = "share", f"more lanes {'agree' if word == 'spread' else 'recover'}"
    tested = tested_words(results, key, [*parts], swept, lanes, more, tests)
    texts, none = [*parts.values()], tested.startswith(NO_DIFFERENCE)
    if not listed:
        return tested
    if unit == "%" and none:  # shares near 0 or 100 % hide differences of errors
        tested = ""
    if len({*texts}) == 1:
        if " to " in texts[0]:
            return "" if none else tested
        tested = f": {tested}" * (bool(tested) and not none)
        return f"the {subject} is {texts[0]} whatever the {escape(key_name(key))}{tested}"
    if unit != "%" and len(parts) == 2 and " to " not in "".join(texts):  # told in the span
        return tested
    names = (named(key, label) for label in parts)
    told = [f"{told} with {name}" for told, name in zip(texts, names, strict=True)][:MOST_COMPARED]
    told += [count(len(parts) - len(told), "other")] * (len(parts) > len(told))
    tested = f". {sentence_case(tested)}" * bool(tested)
    return f"by {escape(key_name(key))} the {subject} is {', '.join(told)}{tested}"


def named(key: str, label: str) -> str:
    """The value of a kind, or of another key that the sentence has named."""
    return escape(value_name(key, label) if is_kind(key) else value_alone(key, label))


def tested_words(
    results: Results,
    key: str,
    labels: Sequence[str],
    swept: pd.DataFrame,
    lanes: Mapping[int, pd.Series],
    more: str,
    rows: TestRows,
) -> str:
    """Which values of a swept kind are better than which, in which settings; `rows` get each p.

    `labels` are the values, the best first. `lanes` are numbers of each cell's lanes, the less the
    better; `more` says what lanes with smaller numbers do. A setting is a combination of the other
    swept keys; those of `swept` without lanes are told apart, not compared. Lanes of a setting are
    compared in pairs of the same draw. Only found differences are told: of up to eight pairs all,
    of more those with the first value. There is no test of lanes that are not independent, and of a
    number of lanes that depends on them.
    """
    study, others = results.study.config, swept.drop(columns=key)
    label_of: dict[int, str] = swept[key].to_dict()
    groups = dict[Any, list[int]]()
    for cell, rest in zip(swept.index.tolist(), others.to_numpy().tolist(), strict=True):
        groups.setdefault(tuple(rest), []).append(cell)
    compared = [[cell for cell in cells if cell in lanes] for cells in groups.values()]
    compared = [cells for cells in compared if len(cells) > 1]
    if study.draws != "random" or isinstance(study.samples, Sequential) or not compared:
        return ""
    tests = compared_cells(lanes, compared)
    of_pairs: dict[tuple[str, str], list[CellsCompared]] = {}
    for test in tests:
        pair = sorted((label_of[test.better], label_of[test.worse]), key=labels.index)
        of_pairs.setdefault((pair[0], pair[1]), []).append(test)
        mine = results.study.cells[test.better].labels
        setting = labels_title({name: mine[name] for name in others if len({*others[name]}) > 1})
        better = value_name(key, label_of[test.better]) if test.found else "not found"
        names = "compared", "first", "second", "setting", "better", "how", "pairs", "p"
        ends = (value_name(key, each) for each in pair)
        told_of = key_name(key), *ends, setting, better, more, test.lanes, test.p
        rows.append(dict(zip(names, told_of, strict=True)))
    pairs = [pair for pair in itertools.combinations(labels, 2) if pair in of_pairs]
    if len(pairs) > MOST_COMPARED:
        pairs = [pair for pair in pairs if pair[0] == labels[0]][:MOST_COMPARED]
    told = []
    for pair in pairs:
        names = [named(key, each) for each in pair]
        both = [cells for cells in groups.values() if {*pair} <= {label_of[cell] for cell in cells}]
        for good, bad in ((0, 1), (1, 0)):
            some = [t for t in of_pairs[pair] if t.found and label_of[t.better] == pair[good]]
            words = f"{more} with {names[good]} than with {names[bad]}"
            every = [[cell for cell in cells if label_of[cell] in pair] for cells in both]
            told += settings_told(results, words, some, every, key)
    many = f"with {count_between([test.lanes for test in tests], 'pair')} in a setting"
    part = " that is compared" * (len(compared) < len(groups))
    none = (
        f"{NO_DIFFERENCE} {escape(key_name(key))} is found {many}{part}; a small one would not show"
    )
    return "; ".join(told) or none


P_WORDS = (
    "tests on paired lanes: McNemar's exact test of lanes that recover, or agree, and the exact"
    " sign test of errors and distances; p is adjusted by Holm over the comparisons of a key in"
    " which enough lanes differ"
)


def settings_told(
    results: Results,
    words: str,
    some: Sequence[CellsCompared],
    every: Sequence[Sequence[int]],
    key: str,
) -> list[str]:
    """The words with the settings of some tests; [] of none.

    `every` has the cells of each setting, which differ in `key`.
    """
    if not some:
        return []
    if len(some) == len(every):
        return [words + f" in all {len(every)} settings of the other keys" * (len(every) > 1)]
    mine = sorted({cell for test in some for cell in (test.better, test.worse)})
    among = [results.study.cells[cell] for cells in every for cell in cells]
    where, alike = values_told(results, mine, among)
    where = where if alike == len(mine) else ""
    if not where and len(some) <= MOST_TOLD:
        varied = [k for k, values in swept_values_of(among).items() if len(values) > 1 and k != key]
        labels = (results.study.cells[test.better].labels for test in sorted(some))
        where = "; ".join(escape(labels_title({k: each[k] for k in varied})) for each in labels)
    told_of = f"in {len(some)} of {len(every)} settings of the other keys"
    return [f"{words} {f'({where})' if where else told_of}"]


def judged_lanes(results: Results, numbers: pd.Index, unit: str) -> dict[int, pd.Series]:
    """Errors of lanes that ended, by sample, or with "%" whether they are over the threshold."""
    found, cells = {}, results.study.cells
    metric, sizes = judged_metric(cells), curves.cell_magnitudes(results)
    for cell, lanes in results.by_cell("sample", metric, where=rows.OK, cells={*numbers}):
        errors: Any = lanes.set_index("sample")[metric]
        if unit == "%":
            found[cell] = errors > threshold(cells[cell], results.study.config.recovery)
        else:
            errors = errors / (sizes[cell] if unit == "ā" else 1.0)
            found[cell] = errors.where(errors.abs() >= ROUNDING_ERROR, 0.0)
    return found


def compares_shares(results: Results) -> bool:
    """Whether kinds are compared by the share unrecovered too."""
    shares = {*curves.unrecovered_shares(results)["unrecovered"]}
    return results.study.config.recovery is not None and len(shares) > 1


def judged_word(results: Results) -> str:
    """The word for what lanes are judged by."""
    return "spread" if is_leaderless(results.study.cells) else "error"


def percent_text(share: float) -> str:
    return number_text(share, whole=100.0)
