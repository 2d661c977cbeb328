"""Tables as CSV files, for spreadsheets and for reading again.

A spreadsheet computes text that begins with `=`, `+`, `-` or `@`. Such text is written with an
apostrophe before it, and read without it. A number is no text.
"""

import io
import re
from collections.abc import Callable, Sequence

import pandas as pd
from pandas.api.types import is_numeric_dtype
from upath import UPath

from jaxnet.store import gate
from jaxnet.store.gate import FolderError

FORMULA = re.compile(r"'*[=+\-@\t\r]")
ROW_TEXT = 2**12  # bytes of a lane in a table, at most
COLUMNS = {  # that readers of a table need
    "fit.csv": "metric model quantile parameter estimate low high",
    "bounds.csv": "bound vehicle slope",
    "violations.csv": "cell sample bound tail_max limit command",
    "search.csv": "cell generation phase lanes best generation_best generation_median failed",
    "worst.csv": "cell found late until greatest magnitude attacked random bound fresh nonlinear"
    " lanes",
    "sensitivity.csv": "cell metric quantity first first_low first_high total total_low total_high"
    " threshold",
    "rare.csv": "cell share low high levels lanes failed plain_lanes points threshold",
}
TEXTS = "metric model parameter bound vehicle command attacked phase quantity"  # columns of text


def csv_text(table: pd.DataFrame) -> str:
    return with_texts(table, guard_text).to_csv(index=False)


def read_table(
    path: UPath, lanes: int = 0, needed: Sequence[str] = (), labels: Sequence[str] = ()
) -> pd.DataFrame:
    """Read a CSV table. Blank entries are not-a-number, and labels like NA and None are text.

    `lanes` are those that the table may tell of, `needed` its columns, by default those of a table
    of this name. They hold numbers unless they are among TEXTS, or labels of swept values.
    Raises FolderError for a file that is no such table.
    """
    fault = "is not a table of ours"
    content = gate.read_whole(path, gate.MOST_TEXT + ROW_TEXT * lanes, fault)
    with gate.reading(path, fault):
        found = pd.read_csv(io.BytesIO(content), keep_default_na=False, na_values=[""])
    for name in (*labels, *(needed or COLUMNS.get(path.name, "").split())):
        if name not in found:
            raise FolderError(f"{path} {fault} (no column {name})")
        text = name in (*labels, *TEXTS.split())
        if len(found) and not (text or is_numeric_dtype(found[name])):
            raise FolderError(f"{path} {fault} ({name} holds text)")
    return with_texts(found.copy(), bare_text)  # as one block: a column more is cheap


def with_texts(table: pd.DataFrame, change: Callable[[str], str]) -> pd.DataFrame:
    found = table.rename(columns=lambda name: change(name) if isinstance(name, str) else name)
    for place, name in enumerate(found):
        column = found.iloc[:, place]
        if is_numeric_dtype(column):
            continue
        texts = {each: change(each) for each in column.unique() if isinstance(each, str)}
        if new := {old: text for old, text in texts.items() if text != old}:
            found = found.assign(**{str(name): column.replace(new)})
    return found


def guard_text(text: str) -> str:
    if not FORMULA.match(text):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text


def bare_text(text: str) -> str:
    return text[1:] if text.startswith("'") and FORMULA.match(text) else text
