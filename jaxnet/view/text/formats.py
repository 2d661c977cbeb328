"""Tables for other programs: CSV with all digits, Markdown and LaTeX with three."""

import itertools
import re
from collections.abc import Sequence

import pandas as pd

from jaxnet.store.tables import csv_text
from jaxnet.view.columns import LATEX_ESCAPES, Column, as_frame, plain_column, split_constant


def in_format(columns: Sequence[Column], name: str, notes: Sequence[str] = ()) -> str:
    """Table in the named format; LaTeX has the notes as comments."""
    if name == "csv":
        return csv_text(as_frame(columns)).rstrip("\n")
    if name == "markdown":
        return markdown(columns)
    first, *lines = latex(columns).split("\n")
    return "\n".join([first, *(f"% {' '.join(each.split())}" for each in notes), *lines])


def columns_of(table: pd.DataFrame) -> list[Column]:
    return [plain_column(str(name), table[name].tolist()) for name in table]


def markdown(columns: Sequence[Column]) -> str:
    """Table as Markdown, for GitHub, pandoc and notebooks."""
    rule = ["---:" if each.numeric else "---" for each in columns]
    rows = zip(*(each.texts() for each in columns), strict=True)
    lines = ([each.title for each in columns], rule, *rows)
    escaped = ([cell.replace("|", r"\|") for cell in line] for line in lines)
    return "\n".join(f"| {' | '.join(line)} |" for line in escaped)


def latex(columns: Sequence[Column]) -> str:
    r"""A LaTeX `tabular` of the package booktabs; what is the same in all cells is a comment.

    A value of a swept key stands once where rows below it repeat it, and `\addlinespace` parts the
    groups of the first key.
    """
    shown, constant = split_constant(columns)
    shown = [each for each in shown if each.name != "cell"] or shown
    sides = "".join("r" if each.numeric else "l" for each in shown)
    head = [r"% \usepackage{booktabs}", *([f"% {constant}"] if constant else [])]
    titles = [latex_text(each.latex) if each.across else each.latex for each in shown]
    start, end = rf"\begin{{tabular}}{{{sides}}}", r"\end{tabular}"
    top = [start, r"\toprule", *spanning_titles(shown), tabular_line(titles), r"\midrule"]
    return "\n".join([*head, *top, *grouped_rows(shown), r"\bottomrule", end])


def spanning_titles(shown: Sequence[Column]) -> list[str]:
    """Line of titles above the columns of one quantity each, with its rules."""
    if not any(each.across for each in shown):
        return []
    entries, rules, place = [], [], 1
    for title, run in itertools.groupby(each.across for each in shown):
        width = len(list(run))
        entries += [rf"\multicolumn{{{width}}}{{c}}{{{title}}}"] if title else [""] * width
        rules += [rf"\cmidrule(lr){{{place}-{place + width - 1}}}"] if title else []
        place += width
    return [tabular_line(entries), " ".join(rules)]


def tabular_line(entries: Sequence[str]) -> str:
    """A line of a table, whose start no command before it takes for its option."""
    line = " & ".join(entries)
    return f"{'{}' * line.startswith(('[', '*'))}{line} \\\\"


def grouped_rows(shown: Sequence[Column]) -> list[str]:
    """The rows; all swept keys but the last have their values once, the first has space between."""
    texts = [
        [latex_number(text) if each.numeric else latex_text(text) for text in each.texts()]
        for each in shown
    ]
    keys = sum(1 for _ in itertools.takewhile(lambda each: each.key is not None, shown))
    rows, before = [], None
    for row in zip(*texts, strict=True):
        same = 0
        while before and same < keys - 1 and row[same] == before[same]:
            same += 1
        if before and keys > 1 and not same:
            rows.append(r"\addlinespace")
        rows.append(tabular_line([""] * same + list(row[same:])))
        before = row
    return rows


def latex_number(text: str) -> str:
    """A number with its interval in LaTeX: a dash for what is not known, minus signs as such."""
    dashed = re.sub(r"(?<!\w)-(?!\d)", "--", text)
    return latex_text(dashed, minus="$-$")


def latex_text(text: str, minus: str = "-") -> str:
    """A value in LaTeX; powers of ten are typeset. `minus` stands before negative numbers."""
    signed = re.sub(r"(?<![\w-])-(?=\d)", lambda _: minus, text.translate(LATEX_ESCAPES))
    return re.sub(
        r"(\d)e([-+]?)0*(\d+)",
        lambda found: rf"{found[1]}$\cdot10^{{{found[2].strip('+')}{found[3]}}}$",
        signed,
    )
