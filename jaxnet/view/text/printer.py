"""The printer of all tables: numbers at the right, labels wrapped, as many columns as fit."""

import itertools
import re
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from rich.cells import cell_len, chop_cells, set_cell_size

from jaxnet.config.naming import NO_BREAK
from jaxnet.model.wording import NAME_DIGITS, RESULT_DIGITS
from jaxnet.view.text.width import (
    GREATEST_WIDTH,
    MOST_ROWS,
    digits_text,
    left_out_note,
    terminal_width,
)

if TYPE_CHECKING:
    from jaxnet.view.columns import Column

MEDIAN_ERRORS = ("tail_mean_median", "outside_max", "spread_median")  # columns that go last
WORST_ERRORS = ("tail_max_max", "in_hull")  # that go just before
LEAST_TITLE, MOST_LINES = 9, 3  # letters of a line of a title, and its lines
LEAST_LABEL, FREE_LABEL = 14, 24  # letters that a label is wrapped to: at least, with room
GAP = 2  # letters between columns
NUMBER = re.compile(r"(> )?-?(\d|inf|nan).*|-|")

# Values by title; of a pandas table, `to_dict("list")`.
TableColumns = Mapping[Any, Sequence[object]]


def table_text(
    table: TableColumns, labels: Sequence[str] = (), width: int = 2 * GREATEST_WIDTH
) -> str:
    """Table as text of this width; the columns of `labels` are wrapped to fit."""
    columns = texts_of(table, labels)
    titles = {name: title_lines(name, texts) for name, texts in columns.items()}
    high, sizes = max(map(len, titles.values()), default=0), {}
    for name, texts in columns.items():
        sizes[name] = max(map(cell_len, [*titles[name], *texts]), default=0)
    wide = sum(sizes.values()) + GAP * (len(sizes) - 1)
    wrapped = [name for name in columns if name in labels]
    for _ in range(min(wide - width, sum(sizes[name] - 1 for name in wrapped))):
        sizes[max(wrapped, key=sizes.__getitem__)] -= 1
    cells = []
    for name, texts in columns.items():
        head = "\n".join([""] * (high - len(titles[name])) + titles[name])
        right = name not in labels and all(map(NUMBER.fullmatch, texts))
        cells.append([placed_lines(text, sizes[name], right) for text in (head, *texts)])
    lines = []
    for row in zip(*cells, strict=True):
        for parts in zip_longest(*row, fillvalue=""):
            lines.append((" " * GAP).join(map(set_cell_size, parts, sizes.values())).rstrip())
    return "\n".join(lines)


def placed_lines(text: str, width: int, right: bool) -> list[str]:
    """A text on lines of this width; a word that is longer is broken, on lines of its own."""
    lines: list[str] = []
    for whole in text.split("\n"):
        lines.append("")
        for word in whole.split(" "):
            joined = f"{lines[-1]} {word}" if lines[-1] else word
            if cell_len(joined) <= width:
                lines[-1] = joined
            else:
                lines[len(lines) - (not lines[-1]) :] = chop_cells(word, width)
    return [" " * (width - cell_len(line)) * right + line for line in lines]


def texts_of(table: TableColumns, labels: Sequence[str]) -> dict[str, list[str]]:
    """Values as text; those of `labels`, which are swept, have the digits of names."""
    digits = {name: NAME_DIGITS if name in labels else RESULT_DIGITS for name in table}
    return {k: [digits_text(value, digits[k]) for value in values] for k, values in table.items()}


def title_lines(title: str, texts: Sequence[str]) -> list[str]:
    """A title on lines about as long as the values, three at most; no word or share is broken."""
    room = max([LEAST_TITLE, *map(len, texts)])
    widths = range(room, max(room, len(title)) + 1)
    whole = title.replace(" %", f"{NO_BREAK}%")
    tried = (wrap(whole, each, break_long_words=False, break_on_hyphens=False) for each in widths)
    lines = next(lines for lines in tried if len(lines) <= MOST_LINES)
    return [line.replace(f"{NO_BREAK}%", " %") for line in lines] or [""]


def fits_terminal(table: TableColumns, labels: Sequence[str], least: int = LEAST_LABEL) -> bool:
    """Whether a terminal is as wide as a table with its labels wrapped to `least` letters."""
    total = -GAP
    for name, texts in texts_of(table, labels).items():
        whole = max(map(len, [*title_lines(name, texts), *texts]))
        total += GAP + (min(whole, least) if name in labels else whole)
    return total <= terminal_width()


def fitted_columns(
    table: TableColumns, labels: Sequence[str], steps: Sequence[Sequence[str]]
) -> TableColumns:
    """The first rows of the columns that fit a terminal: those of each step go until the rest fits.

    Labels stay, as they tell rows apart.
    """
    shown = {name: values[:MOST_ROWS] for name, values in table.items()}
    gone = itertools.accumulate(steps, lambda before, more: (*before, *more), initial=())
    left = [{name: shown[name] for name in shown if name not in each} for each in gone]
    tried = ((each, least) for least in (FREE_LABEL, LEAST_LABEL) for each in left)
    return next((each for each, least in tried if fits_terminal(each, labels, least)), left[-1])


def fitted_text(
    table: TableColumns, labels: Sequence[str], steps: Sequence[Sequence[str]], file: str
) -> str:
    """`fitted_columns` as text, and what it leaves out of the file."""
    shown = fitted_columns(table, labels, steps)
    lines = [table_text(shown, labels, terminal_width())]
    more = max(map(len, table.values()), default=0) - MOST_ROWS
    lines += [f"… {more} more rows; all are in {file}"] * (more > 0)
    left_out = [name for name in table if name not in shown]
    return "\n".join([*lines, *left_out_note(left_out, file)])


def columns_text(shown: Sequence["Column"]) -> str:
    """Columns as text in a terminal's width; labels are wrapped to fit."""
    return table_text(*with_labels(shown), terminal_width())


def with_labels(shown: Sequence["Column"]) -> tuple[TableColumns, list[str]]:
    labels = [each.title for each in shown if each.key is not None and not each.numeric]
    return {each.title: each.texts() for each in shown}, labels


def narrow_columns(
    whole: Sequence["Column"], asked: bool = False
) -> tuple[list["Column"], list[str]]:
    """Columns that fit the terminal, and what is left out; the first quantity always stays.

    The last quantities lose their intervals, but not the first; pivoted ones lose them together.
    Then, unless they are `asked` for, columns go: the last ones, all intervals, the worst errors,
    the median errors, keys of numbers, labels.
    """
    quantities = [each.name for each in whole if each.key is None and each.name != "cell"]
    ranks = {name: rank for rank, each in enumerate((MEDIAN_ERRORS, WORST_ERRORS)) for name in each}
    quantities[1:] = sorted(quantities[1:], key=lambda name: ranks.get(name, len(ranks)))
    kept = 1 + sum(name in ranks for name in quantities[1:])
    together = any(each.across for each in whole)
    keys = sorted((each for each in whole if each.key is not None), key=lambda each: each.numeric)
    roomy = [[*whole]]
    for first in [0] if together else range(len(quantities) - 1, 0, -1):
        bare = quantities[first:]
        roomy.append([each.bare() if each.name in bare else each for each in whole])
    tight = roomy
    if not asked:
        roomy += without_each(roomy[-1], quantities[: kept - 1 : -1])
        tight = [roomy[-1], [each.bare() for each in roomy[-1]]]
        tight += without_each(tight[-1], quantities[kept - 1 : 0 : -1])
        tight += without_each(tight[-1], [each.name for each in reversed(keys)])
    steps = [(each, FREE_LABEL) for each in roomy] + [(each, LEAST_LABEL) for each in tight]
    fit = (each for each, least in steps if fits_terminal(*with_labels(each), least))
    shown = next(fit, tight[-1])
    left = {each.name: each for each in shown}
    lost = [each for each in whole if each.name in left and each.ends and not left[each.name].ends]
    which = f"{'some' if any(each.ends for each in shown) else 'all'} intervals"
    return shown, [which] * bool(lost) + [each.title for each in whole if each.name not in left]


def parted(shown: Sequence["Column"]) -> list[list["Column"]]:
    """Tables that fit the terminal: all columns, or some that are pivoted beside all others."""
    beside, tables = [each for each in shown if not each.across], list[list["Column"]]()
    for each in (each for each in shown if each.across):
        if not tables or not fits_terminal(*with_labels([*tables[-1], each])):
            tables.append([*beside])
        tables[-1].append(each)
    return tables or [beside]


def without_each(columns: Sequence["Column"], names: Sequence[str]) -> list[list["Column"]]:
    """Columns without the first of the names, without the first two, and so on."""
    gone = (names[:number] for number in range(1, len(names) + 1))
    return [[each for each in columns if each.name not in some] for some in gone]
