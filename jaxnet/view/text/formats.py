"""Tables for other programs: CSV with all digits, Markdown and LaTeX with four."""

import re
from collections.abc import Callable, Sequence

import pandas as pd

from jaxnet.view.columns import Column, as_frame, split_constant

LATEX_ESCAPES = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "\N{NO-BREAK SPACE}": "~",
        **{character: f"\\{character}" for character in "&%$#_{}"},
    }
)


def in_format(columns: Sequence[Column], name: str) -> str:
    """Return a table in the named format."""
    return FORMAT_WRITERS[name](columns).rstrip("\n")


def columns_of(table: pd.DataFrame) -> list[Column]:
    """Return the columns of a table that has no intervals."""
    values = {str(name): table[name].tolist() for name in table}
    return [Column(name, name, name.translate(LATEX_ESCAPES), each) for name, each in values.items()]


def csv(columns: Sequence[Column]) -> str:
    """Return a table as CSV, with all digits."""
    return as_frame(columns).to_csv(index=False)


def markdown(columns: Sequence[Column]) -> str:
    """Return a table as Markdown, for GitHub, pandoc and notebooks."""
    rule = ["---:" if each.numeric else "---" for each in columns]
    rows = zip(*(each.texts() for each in columns), strict=True)
    lines = ([each.title for each in columns], rule, *rows)
    escaped = ([cell.replace("|", r"\|") for cell in line] for line in lines)
    return "\n".join(f"| {' | '.join(line)} |" for line in escaped)


def latex(columns: Sequence[Column]) -> str:
    r"""Return a LaTeX `tabular` of the package booktabs; what is the same in all cells is a comment."""
    shown, constant = split_constant(columns)
    shown = [each for each in shown if each.name != "cell"] or shown
    sides = "".join("r" if each.numeric else "l" for each in shown)
    texts = ([latex_text(text) for text in each.texts()] for each in shown)
    rows = [f"{' & '.join(row)} \\\\" for row in zip(*texts, strict=True)]
    head = [r"% \usepackage{booktabs}", *([f"% {constant}"] if constant else [])]
    titles = f"{' & '.join(each.latex for each in shown)} \\\\"
    start, end = rf"\begin{{tabular}}{{{sides}}}", r"\end{tabular}"
    return "\n".join([*head, start, r"\toprule", titles, r"\midrule", *rows, r"\bottomrule", end])


def latex_text(text: str) -> str:
    """Return a value in LaTeX; powers of ten are typeset."""
    return re.sub(
        r"(\d)e([-+]?)0*(\d+)",
        lambda found: rf"{found[1]}$\cdot10^{{{found[2].strip('+')}{found[3]}}}$",
        text.translate(LATEX_ESCAPES),
    )


FORMAT_WRITERS: dict[str, Callable[[Sequence[Column]], str]] = {
    "csv": csv,
    "markdown": markdown,
    "latex": latex,
}
