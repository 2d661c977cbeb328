"""What `jaxnet search` prints: the worst found in each cell, and what it stands beside."""

import pandas as pd

from jaxnet.store.results import Results
from jaxnet.view.text.width import MOST_ROWS, as_lines, narrow

LEAST = (("lanes",), ("fresh least 5 %",), ("nonlinear",))


def text(results: Results) -> str:
    """A line for each cell."""
    labels = list(results.study.cells[0].labels)
    shown, left_out, is_cut = narrow(rows_of(results).head(MOST_ROWS), labels, LEAST)
    asked = results.study.config.search
    assert asked is not None
    head = f"the worst {asked.maximise}, per ā; fresh: the same choice from other starts"
    tail = f"all in {results.path / 'worst.csv'}" if left_out or is_cut else ""
    return "\n".join(filter(None, [head, as_lines(shown), tail]))


def rows_of(results: Results) -> pd.DataFrame:
    """What was found, per ā where that is not 0 and it is no share."""
    found, asked = results.worst, results.study.config.search
    assert asked is not None
    labels = list(results.study.cells[0].labels)
    size = 1.0 if asked.maximise == "unrecovered" else found["magnitude"].where(found["magnitude"] > 0, 1.0)
    per = {
        "found": found["found"] / size,
        "random lanes": found["random"] / size,
        "bound": found["bound"] / size,
        "bound / found": found["bound"] / found["found"],
        "fresh mean": found["fresh"] / size,
        "fresh least 5 %": found["fresh_low"] / size,
        "nonlinear": found["nonlinear"] / size,
    }
    who = {"cell": found["cell"], **found[labels], "attacked": found["attacked"]}
    return pd.DataFrame({**who, **per, "lanes": found["lanes"]})
