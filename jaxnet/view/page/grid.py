"""The verdict table of a study: where the fleet holds, by its swept keys.

Rows and columns are choices, such as topology and defence. A field is about all settings of the
other keys: attacks, their magnitudes, noise. A study without a choice has a row for each setting.
"""

import math
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
    is_kind,
    key_name,
    quantity,
    value_alone,
    value_name,
    values_named,
)
from jaxnet.model.wording import count, count_between, counted, number_text
from jaxnet.statistics.curves import failed_kinds
from jaxnet.statistics.groups import Label, swept_values_of
from jaxnet.statistics.horizon import LOST
from jaxnet.statistics.intervals import clopper_pearson
from jaxnet.statistics.isolation import ISOLATED
from jaxnet.statistics.recovery import confidence_told
from jaxnet.store.results import Results
from jaxnet.view.drawings.words import ROUNDED, error_text
from jaxnet.view.page.decided import ABOUT_DECISIONS, cells_judged, choices, decisions, swept_texts
from jaxnet.view.page.elements import notes_html, paragraph, sentence_case, unbroken
from jaxnet.view.page.judged import (
    JudgedLanes,
    criterion_text,
    fallen_words,
    falling_cells,
    judged_word,
    negligible_errors,
    percent_text,
    separation_asked,
)
from jaxnet.view.page.proved import outside_by_draw
from jaxnet.view.page.where import joined_names

MOST_ROWS, MOST_COLUMNS, MOST_NUMBERS = 40, 8, 4  # numbers are of a field's cells
NONE = "none"
OF_ASSUMPTIONS = "the assumptions"
ABOUT_ASSUMPTIONS = (
    f"outside {OF_ASSUMPTIONS}: lanes in which a vehicle hears more attacked sources than its"
    " defence is set for (any, where it cannot trim), or trusts one"
)
OF_ROBUSTNESS = (
    f"outside {OF_ASSUMPTIONS}: lanes whose graph is not robust enough for their attackers"
)
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


def layout(cells: Sequence[Cell]) -> GridLayout | None:
    """Lay out the cells that are judged; None of one cell, and of too many values.

    The last choice makes the columns, if it can one that may be left out. A single choice makes the
    rows, and a setting the columns; without a choice the first kind that is swept makes the rows.
    """
    cells = cells_judged(cells)
    values = {key: each for key, each in swept_values_of(cells).items() if len(each) > 1}
    chosen = choices(cells)
    optional = [key for key in chosen if NONE in map(str, values[key])]
    narrow = [key for key in values if len(values[key]) <= MOST_COLUMNS]
    chosen = chosen or sorted(values, key=lambda key: not is_kind(key))[:1]
    columns = [key for key in optional or chosen if key in narrow][-1:]
    if len(chosen) == 1:
        columns = [key for key in narrow if key not in chosen][:1]
    rows = [key for key in chosen if key not in columns]
    while math.prod(len(values[key]) for key in rows) > MOST_ROWS:
        rows.remove(max(rows, key=lambda key: len(values[key])))
    if not rows:
        return None
    settings = {key: each for key, each in values.items() if key not in (*rows, *columns)}
    fields = dict[Combination, dict[Combination, list[int]]]()
    for cell in cells:
        row, column = (tuple(cell.labels[key] for key in keys) for keys in (rows, columns))
        fields.setdefault(row, {}).setdefault(column, []).append(cell.number)
    return GridLayout(rows, columns, settings, fields, "".join(optional[-1:]))


def grid_html(results: Results, lanes: JudgedLanes) -> str:
    """The table with its notes as HTML, "" where it has no place."""
    laid = layout(results.study.cells)
    if laid is None:
        return ""
    heads = [quantity(key) for key in laid.rows]
    heads += [", ".join(map(value_name, laid.columns, each)) or "result" for each in laid.heads]
    against = against_none(results, laid.optional, lanes) if laid.optional else {}
    differ = any(against.values())
    numbers = cell_numbers(results, lanes, against if differ else {})
    fields = fields_html(results, laid, lanes, numbers)
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
    about = OF_ROBUSTNESS if is_leaderless(results.study.cells) else ABOUT_ASSUMPTIONS
    notes += [about] * (OF_ASSUMPTIONS in body)
    mean = "worst lane: the greatest error of a lane, a mean over vehicles and the tail"
    notes += [mean] * ("worst lane" in body and not is_leaderless(results.study.cells))
    left = len(cells_judged(results.study.cells)) < len(results.study.cells)
    notes += ["cells without an attack are not in this table"] * left
    box = f'<div class="box" tabindex="0">{table}</div>'
    return f"{paragraph(unbroken(caption))}{box}{notes_html(notes)}"


def cell_numbers(results: Results, lanes: JudgedLanes, against: Mapping[int, str]) -> pd.DataFrame:
    """What a field tells of each cell; lengths that are far below what the study asks for are 0.

    - `fallen`, `unrecovered`, `out`, `lost`, `near` [%]: shares of its lanes
    - `median`, `worst`, `way` [m]: of lanes that ended
    - `falling`: whether errors still fall when the run ends
    - `against`: what is found against none
    """
    cells = results.study.cells
    judged, stored = judged_metric(cells), results.cells.reset_index(drop=True)
    found = pd.DataFrame(index=range(len(cells)))
    for name in ("fallen", "unrecovered", "out", "lost", "near"):
        found[name] = [100 * lanes[cell][name].mean() for cell in found.index]
    for name, column in (("median", f"{judged}_median"), ("worst", f"{judged}_max")):
        found[name] = stored[column].mask(stored[column] < negligible_errors(results), 0.0)
    found["way"] = stored["outside_max"] if is_leaderless(cells) else np.nan
    found["falling"] = found.index.isin(falling_cells(results))
    found["against"] = [against.get(cell) for cell in found.index]
    return found


def fields_html(
    results: Results, laid: GridLayout, lanes: JudgedLanes, numbers: pd.DataFrame
) -> dict[tuple[Combination, Combination], str]:
    """Each field: lanes that do not hold, why lanes failed, lengths, and what is found."""
    failures, word, tells = failed_kinds(results), judged_word(results), has_verdict(results)
    agree = is_leaderless(results.study.cells) and results.study.config.recovery is not None
    outside, found = outside_by_draw(results, lanes) if tells else {}, {}
    for row, mine in laid.fields.items():
        for column, cells in mine.items():
            known: Any = numbers.loc[cells]
            reasons = sum((failures.get(cell, Counter()) for cell in cells), Counter())
            median = lengths_text(known["median"], laid.listed)
            greatest = known["worst"] if laid.listed else known["worst"].nlargest(1)
            worst = lengths_text(greatest, laid.listed)
            way = lengths_text(known["way"], laid.listed)
            lost, near, out, apart = (
                numbers_text(known[name], percent_text, laid.listed)
                for name in ("lost", "near", "out", "unrecovered")
            )
            told = [f"<b>{shares_text(results, laid, known['fallen'])}</b>" * tells]
            told += [counted(reasons), f"no agreement {apart} %" * agree]
            ended = sum(int((~lanes[n]["failed"]).sum()) for n in cells)
            few = f" of {count(ended, 'lane')} that ended" * bool(reasons)
            told += [
                f"{word} {median}{few}" * bool(median),
                f"worst lane {worst}" * (worst != median),
            ]
            told += [f"lost {lost} %" * bool(known["lost"].any())]
            told += isolated_texts(pd.concat([lanes[cell] for cell in cells]))
            told += [f"out {out} %" + f", by up to {way}" * (out != "0")] * bool(way)
            told += [f"too near {near} %" * bool(known["near"].any())]
            told += [f"{word} still falls" * bool(known["falling"].any())]
            told += [draws_text([(lanes[n]["fallen"], outside[n]) for n in cells if n in outside])]
            told += [found_words(known["against"].dropna().tolist())]
            colour = f' style="--lost: {known["fallen"].mean():.0f}"' * tells
            text = "<br>".join(filter(None, told))
            found[row, column] = f"<td{colour}>{text}</td>"
    return found


def isolated_texts(lanes: pd.DataFrame) -> list[str]:
    """In how many of the lanes that do not hold a vehicle came to rest, or was cut off."""
    told, fallen = list[str](), lanes["fallen"]
    for column in [each for each in ISOLATED if each in lanes]:
        many: Any = (lanes[column] & fallen).sum()
        if many:
            told.append(f"in {many:,} of these {fallen.sum():,} lanes {ISOLATED[column]}")
    return told


def draws_text(drawn: Sequence[tuple[pd.Series, pd.Series]]) -> str:
    """How many lanes do not hold, of those whose draw is outside the assumptions, and within."""
    if not drawn:
        return ""
    fallen, beyond = (pd.concat(each).to_numpy() for each in zip(*drawn, strict=True))
    if beyond.all() or not beyond.any():
        return ""
    outside, within = (f"{fallen[each].sum():,} of {each.sum():,}" for each in (beyond, ~beyond))
    return f"do not hold: {outside} lanes outside {OF_ASSUMPTIONS}, {within} within"


def has_verdict(results: Results) -> bool:
    """Whether a lane that ends may hold or not: recovery is asked, or the hull tells."""
    return results.study.config.recovery is not None or is_leaderless(results.study.cells)


def shares_text(results: Results, laid: GridLayout, shares: pd.Series) -> str:
    """Shares [%] of a field; if one setting of numbers decides, how far those at its ends reach."""
    for key, values in laid.settings.items():
        if laid.listed or any(isinstance(each, str) for each in values):
            continue
        sizes = [results.study.cells[cell].labels[key] for cell in shares.index]
        texts: Any = shares.map(percent_text).set_axis(sizes)
        if (texts.groupby(level=0).nunique() > 1).any():
            continue  # other settings decide, too
        sized: Any = shares.set_axis(sizes).groupby(level=0).mean()
        texts = texts.groupby(level=0).first()
        first, last = texts.iloc[0], texts.iloc[-1]
        if first != last and {*sized.iloc[[0, -1]]} == {sized.min(), sized.max()}:
            until = value_name(key, texts.index[(texts == first).cummin()][-1])
            since = value_name(key, texts.index[(texts == last)[::-1].cummin()[::-1]][0])
            return f"{first} % up to {until}, {last} % from {since}"
    told = f"{numbers_text(shares, percent_text, laid.listed)} %"
    return told if laid.listed else by_setting(results, laid, shares) or told


def by_setting(results: Results, laid: GridLayout, shares: pd.Series) -> str:
    """Shares [%] for each value of the setting that decides; "" if none does.

    It decides if shares differ four times less among cells with the same value.
    """
    for key, values in laid.settings.items():
        labels = [results.study.cells[cell].labels[key] for cell in shares.index]
        groups: Any = shares.groupby(labels, sort=False)
        within, every = (groups.max() - groups.min()).max(), shares.max() - shares.min()
        if every > 0 and 4 * within <= every and len(values) <= MOST_NUMBERS:
            each = [numbers_text(mine, percent_text, False) for _, mine in groups]
            return f"{', '.join(each)} % for {values_named(key, [v for v, _ in groups], 'and')}"
    return ""


def lengths_text(lengths: pd.Series, listed: bool) -> str:
    told = numbers_text(lengths, near_text, listed) if lengths.notna().any() else ""
    return f"{told}{NO_BREAK}m" * bool(told)


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
    texts: Any = swept_texts(results)
    found = decisions(results, lanes, texts[key], texts.drop(columns=key))
    return {cell: each.words for (cell, other), each in found.items() if texts[key][other] == NONE}


def found_words(found: Sequence[str]) -> str:
    """What tests find of the cells of a field, each finding with the number of its cells."""
    each = Counter(words for told in found for words in told.split(", ") if words)
    told = [
        f"{words}{f' in {many} of {len(found)} cells' * (many < len(found))}"
        for words, many in each.items()
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
    if asked := separation_asked(results):
        near = f"too near: lanes in which two vehicles come nearer than D = {asked[1]:g} m"
        notes.insert(0, f"{near}; filters are compared by these lanes, not by errors")
    if is_leaderless(results.study.cells):
        notes.insert(0, "out: lanes that leave the hull of the starts, and how far the worst goes")
    many = count_between(sizes.tolist(), "lane")
    return [f"{sentence_case(caption)}{over * bool(laid.settings)}. {many} a cell:", *notes]
