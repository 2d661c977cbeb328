"""The verdict table of a study: where the fleet holds, by the keys whose values one chooses.

Rows and columns are choices, such as topology and defence. A field is about all settings of the
other keys: attacks, their magnitudes, noise.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from jaxnet.config.cells import Cell, is_leaderless, judged_metric
from jaxnet.config.naming import (
    NO_BREAK,
    Combination,
    key_name,
    quantity,
    value_alone,
    value_name,
    values_named,
)
from jaxnet.model.wording import count_between, counted, number_text
from jaxnet.statistics.curves import failed_kinds
from jaxnet.statistics.groups import Label, swept_values_of
from jaxnet.statistics.horizon import LOST
from jaxnet.statistics.intervals import clopper_pearson
from jaxnet.statistics.recovery import attacked_mask, confidence_told
from jaxnet.store.results import Results
from jaxnet.view.drawings.words import ROUNDED, error_text
from jaxnet.view.page.compared import swept_texts
from jaxnet.view.page.decided import ABOUT_DECISIONS, decisions
from jaxnet.view.page.elements import notes_html, paragraph, sentence_case, unbroken
from jaxnet.view.page.judged import (
    JudgedLanes,
    criterion_text,
    fallen_words,
    falling_cells,
    judged_word,
    negligible_errors,
    percent_text,
)
from jaxnet.view.page.where import joined_names

# Keys that nobody chooses: settings in which the others are compared
CONDITIONS = ("attack", "channel.loss", "channel.delay", "channel.noise", "navigator", "initial")
CONDITIONS += ("channel.quantisation", "sensing", "vehicle", "horizon", "tail", "tick", "engine")
MOST_ROWS, MOST_COLUMNS, MOST_NUMBERS = 40, 8, 4  # numbers are of a field's cells
NONE = "none"
COMPARED = "vs none: against no {}, on the same draws (McNemar's and sign tests, 5 %, Holm): {}"
NOT_DIFFERENT = "no test on the same draws finds a field better or worse than no {}"


class GridLayout(NamedTuple):
    """The verdict table without its numbers.

    Attributes
    ----------
    rows, columns
        Keys of the rows, and the key of the columns if there is one.
    settings
        The other swept keys with their values, all of which a field is about.
    fields
        Numbers of the cells of each field, by the values of its row and of its column.
    optional
        The choice that is compared with none; "" if no choice has none.
    """

    rows: list[str]
    columns: list[str]
    settings: dict[str, list[Label]]
    fields: dict[Combination, dict[Combination, list[int]]]
    optional: str

    @property
    def heads(self) -> list[Combination]:
        """The values of the columns."""
        return list(dict.fromkeys(column for row in self.fields.values() for column in row))

    @property
    def listed(self) -> bool:
        """Whether a field lists the numbers of its few cells, which differ in one key."""
        sizes = {len(cells) for row in self.fields.values() for cells in row.values()}
        few = [len(values) for values in self.settings.values() if len(values) <= MOST_NUMBERS]
        return len(self.settings) == 1 and sizes == {*few}


def choices(cells: Sequence[Cell]) -> list[str]:
    """The swept keys whose value one chooses."""
    return [
        key
        for key, values in swept_values_of(cells).items()
        if len(values) > 1 and key != "channel" and not key.startswith(CONDITIONS)
    ]


def layout(cells: Sequence[Cell]) -> GridLayout | None:
    """Lay out the cells under attack; None without a choice, and of too many rows or columns.

    The last choice makes the columns, if it can one that may be left out; a single choice makes the
    rows, and a setting the columns.
    """
    cells = [cell for cell, attacked in zip(cells, attacked_mask(cells), strict=True) if attacked]
    chosen = choices(cells) if cells else []
    if not chosen:
        return None
    values = {key: each for key, each in swept_values_of(cells).items() if len(each) > 1}
    optional = [key for key in chosen if NONE in map(str, values[key])]
    columns = (optional or chosen)[-1:]
    if len(chosen) == 1:
        columns = [key for key in values if key not in chosen][:1]
    rows = [key for key in chosen if key not in columns]
    settings = {key: each for key, each in values.items() if key not in (*rows, *columns)}
    fields = dict[Combination, dict[Combination, list[int]]]()
    for cell in cells:
        row, column = (tuple(cell.labels[key] for key in keys) for keys in (rows, columns))
        fields.setdefault(row, {}).setdefault(column, []).append(cell.number)
    laid = GridLayout(rows, columns, settings, fields, "".join(optional[-1:]))
    return laid if len(fields) <= MOST_ROWS and len(laid.heads) <= MOST_COLUMNS else None


def grid_html(results: Results, lanes: JudgedLanes) -> str:
    """The table with its notes as HTML, "" where it has no place."""
    laid = layout(results.study.cells)
    if laid is None:
        return ""
    heads = [quantity(key) for key in laid.rows]
    heads += [", ".join(map(value_name, laid.columns, column)) for column in laid.heads]
    against = against_none(results, laid.optional, lanes) if laid.optional else {}
    differ = any(against.values())
    fields = fields_html(results, laid, lanes, against if differ else {})
    lines = []
    for row in laid.fields:
        values = map(value_alone, laid.rows, row)
        begin = "".join(f'<th scope="row">{escape(value)}</th>' for value in values)
        rest = (fields.get((row, column), "<td>not run</td>") for column in laid.heads)
        lines.append(begin + "".join(rest))
    head = "".join(f'<th scope="col">{escape(each)}</th>' for each in heads)
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    table = f'<table class="verdict"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
    tests = ""
    if against:
        about = ABOUT_DECISIONS[is_leaderless(results.study.cells)]
        tests = (COMPARED if differ else NOT_DIFFERENT).format(key_name(laid.optional), about)
    caption, *notes = grid_words(results, laid, lanes, tests)
    box = f'<div class="box" tabindex="0">{table}</div>'
    return f"{paragraph(unbroken(caption))}{box}{notes_html(notes)}"


def fields_html(
    results: Results, laid: GridLayout, lanes: JudgedLanes, against: Mapping[int, str]
) -> dict[tuple[Combination, Combination], str]:
    """Each field: lanes that do not hold, why lanes failed, errors, and what is found `against`."""
    alone, failures = is_leaderless(results.study.cells), failed_kinds(results)
    table: Any = results.cells.reset_index(drop=True)
    medians = table[f"{judged_metric(results.study.cells)}_median"]
    falling = {*falling_cells(results)}
    medians = medians.mask(medians < negligible_errors(results), 0.0)
    word, tells, found = judged_word(results), has_verdict(results), {}
    for row, mine in laid.fields.items():
        for column, cells in mine.items():
            shares = pd.Series([100 * lanes[cell]["fallen"].mean() for cell in cells])
            reasons = sum((failures.get(cell, Counter()) for cell in cells), Counter())
            error = lengths_text(word, medians[cells], laid.listed)
            told = [f"<b>{numbers_text(shares, percent_text, laid.listed)} %</b>" * tells]
            told += [counted(reasons), error]
            lost = pd.Series([100 * lanes[cell]["lost"].mean() for cell in cells])
            if lost.any():
                told.append(f"lost {numbers_text(lost, percent_text, laid.listed)} %")
            if alone:
                told.append(lengths_text("out", table.loc[cells, "outside_max"], laid.listed))
            told.append(f"{word} still falls" * bool(falling & {*cells}))
            told.append(found_words([against[cell] for cell in cells if cell in against]))
            colour = f' style="--lost: {shares.mean():.0f}"' * tells
            text = "<br>".join(filter(None, told))
            found[row, column] = f"<td{colour}>{text}</td>"
    return found


def has_verdict(results: Results) -> bool:
    """Whether a lane that ends may hold or not: recovery is asked, or the hull tells."""
    return results.study.config.recovery is not None or is_leaderless(results.study.cells)


def lengths_text(word: str, values: pd.Series, listed: bool) -> str:
    told = numbers_text(values, near_text, listed) if values.notna().any() else ""
    return f"{word} {told}{NO_BREAK}m" * bool(told)


def near_text(length: float) -> str:
    text = error_text(length)
    return "≈ 0" if text in ("0", ROUNDED) else text


def numbers_text(values: pd.Series, text: Callable[[float], str], listed: bool) -> str:
    """Each number, one for all if they read alike, or the least and the greatest."""
    texts = [*map(text, values if listed else (values.min(), values.max()))]
    alike = len({*texts}) == 1
    return texts[0] if alike else (", " if listed else " to ").join(texts)


def against_none(results: Results, key: str, lanes: JudgedLanes) -> dict[int, str]:
    """What tests find of cells against those whose choice is none; "" of no difference."""
    texts: Any = swept_texts(results)[attacked_mask(results.study.cells)]
    found = decisions(results, lanes, texts[key], texts.drop(columns=key))
    return {cell: each.words for (cell, other), each in found.items() if texts[key][other] == NONE}


def found_words(found: Sequence[str]) -> str:
    told = [
        f"{words}{f' in {many} of {len(found)} cells' * (many < len(found))}"
        for words, many in Counter(found).items()
        if words
    ]
    return f"vs none: {'; '.join(told) or 'no difference found'}" * bool(found)


def grid_words(results: Results, laid: GridLayout, lanes: JudgedLanes, tests: str) -> list[str]:
    """What a field tells: a caption, then notes on its lines."""
    cells = [cell for row in laid.fields.values() for some in row.values() for cell in some]
    lost, sizes = np.array([[lanes[n]["fallen"].sum(), len(lanes[n])] for n in cells]).T
    over = f", over all values of {joined_names([*map(key_name, laid.settings)])}"
    if laid.listed:
        ((key, values),) = laid.settings.items()
        over = f", for {values_named(key, values, 'and')} in this order"
    caption, notes = f"{judged_word(results)} of the median lane", [tests]
    if has_verdict(results):
        caption = f"lanes that {fallen_words(results)}{criterion_text(results)}, and {caption}"
        if results.study.config.draws == "random":
            sure = confidence_told(results.study.config.samples)
            low, high = clopper_pearson(lost, sizes, sure)
            reach = 100 * max((high - lost / sizes).max(), (lost / sizes - low).max())
            most = f"{number_text(reach)} percentage points from the value"
            notes.append(f"{100 * sure:g} % intervals of these shares reach at most {most}")
    if any(lanes[cell]["lost"].any() for cell in cells):
        notes.insert(0, f"lost: an error over {LOST:,} times the sum of ā and the farthest start")
    if is_leaderless(results.study.cells):
        notes.insert(0, "out: how far the worst lane of a cell leaves the hull of the starts")
    many = count_between(sizes.tolist(), "lane")
    return [f"{sentence_case(caption)}{over * bool(laid.settings)}. {many} a cell:", *notes]
