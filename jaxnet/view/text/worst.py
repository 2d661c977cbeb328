"""What `jaxnet search` prints: the worst found in each cell, and what it stands beside."""

import pandas as pd

from jaxnet.store.results import Results
from jaxnet.view.text.width import MOST_ROWS, as_lines, narrow

LEAST = (("lanes",), ("fresh least 5 %",), ("greatest",), ("nonlinear",), ("bound / found",))


def text(results: Results) -> str:
    """A line for each cell."""
    labels = list(results.study.cells[0].labels)
    shown, left_out, is_cut = narrow(rows_of(results).head(MOST_ROWS), labels, LEAST)
    head = f"the worst {maximised(results)}; late: at {when(results)}; fresh: from other starts"
    tail = f"all in {results.path / 'worst.csv'}" if left_out or is_cut else ""
    return "\n".join(filter(None, [head, as_lines(shown), tail]))


def when(results: Results) -> str:
    """The time to which the choices were run."""
    times = results.worst["until"]
    return " or ".join(f"{time:g} s" for time in sorted(set(times)))


def maximised(results: Results) -> str:
    """What was maximised, and in what it is told."""
    return with_unit(results).replace(" [m]", ", per ā")


def with_unit(results: Results) -> str:
    """What was maximised, with its unit if it has one."""
    asked = results.study.config.search
    assert asked is not None
    return f"{asked.maximise} [{unit_of(results)}]".removesuffix(" []")


def unit_of(results: Results) -> str:
    """The unit of what was maximised; none of a share."""
    config = results.study.config
    assert config.search is not None
    return {each.name: each.unit for each in config.measured()}.get(config.search.maximise, "")


def rows_of(results: Results) -> pd.DataFrame:
    """What was found: a length per ā, where that is known and not 0."""
    found, labels = results.worst, list(results.study.cells[0].labels)
    size = found["magnitude"].where(found["magnitude"] > 0, 1.0) if unit_of(results) == "m" else 1.0
    per = {
        "found": found["found"] / size,
        "late": found["late"] / size,
        "greatest": found["greatest"] / size,
        "random lanes": found["random"] / size,
        "bound": found["bound"] / size,
        "bound / found": found["bound"] / found["found"],
        "fresh mean": found["fresh"] / size,
        "fresh least 5 %": found["fresh_low"] / size,
        "nonlinear": found["nonlinear"] / size,
    }
    who = {"cell": found["cell"], **found[labels], "attacked": found["attacked"]}
    return pd.DataFrame({**who, **per, "lanes": found["lanes"]})
