"""Output of `jaxnet search`: the worst choice in each cell, beside random lanes and bounds."""

from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import is_leaderless
from jaxnet.config.keys import SearchSettings
from jaxnet.statistics.recovery import criterion_words
from jaxnet.store.results import Results
from jaxnet.view.text.printer import fitted_text
from jaxnet.view.text.width import filled

SEARCH_DROP_ORDER = (
    ("lanes",),
    ("fresh least 5 %",),
    ("greatest",),
    ("nonlinear",),
    ("bound / found",),
)
LENGTHS = {  # columns of worst.csv that are told per ā, with their titles
    "found": "found",
    "late": "late",
    "greatest": "greatest",
    "random": "random lanes",
    "bound": "bound",
    "ratio": "bound / found",
    "fresh": "fresh mean",
    "fresh_low": "fresh least 5 %",
    "nonlinear": "nonlinear",
}


def search_text(results: Results) -> str:
    labels, file = list(results.study.cells[0].labels), str(results.path / "worst.csv")
    late = f"late: at {late_times(results)}; fresh: from other starts"
    head = f"the worst {maximised_text(results)}; {late}"
    text = fitted_text(worst_rows(results).to_dict("list"), labels, SEARCH_DROP_ORDER, file)
    return "\n".join([head, text, *map(filled, [starts_text(results), *limit_lines(results)])])


def asked_search(results: Results) -> SearchSettings:
    asked = results.study.config.search
    assert asked is not None
    return asked


def starts_text(results: Results) -> str:
    """From how many starts a choice is tried, beside those of random lanes."""
    starts = asked_search(results).starts
    same = "the same start" if starts == 1 else f"the same {starts:,} starts, their mean"
    return (
        f"found: every choice from {same}; random lanes: each a choice and a start of its"
        " own, the greatest lane; so random lanes may be above what was found, from a worse start"
    )


def limit_lines(results: Results) -> list[str]:
    """Limits of `subject_to`, how many further starts fulfil them, and where no choice does."""
    limits = asked_search(results).subject_to
    found: Any = results.worst
    if not limits:
        return []
    told = ", ".join(f"{name} ≤ {most:g}" for name, most in limits.items())
    lines = [f"subject to {told} from every start of the search"]
    none = found["found"].isna()
    shares = found["fresh_allowed"][~none].dropna()
    if len(shares):
        lines.append(f"of other starts {shares.min():.1%} to {shares.max():.1%} fulfil it")
    if none.any():
        numbers = ", ".join(map(str, found["cell"][none]))
        cells = f"cells {numbers}" if len(found) > 1 else "the study"
        lines.append(
            f"no choice that was tried in {cells} fulfils it: search where more of them do"
        )
    return ["; ".join(lines)]


def late_times(results: Results) -> str:
    return " or ".join(f"{time:g} s" for time in sorted(set(results.worst["until"])))


def maximised_text(results: Results) -> str:
    words = metric_with_unit(results)
    return words.replace(" [m]", ", per ā") if is_per_size(results) else words


def is_per_size(results: Results) -> bool:
    """Whether lengths are told per ā: every cell follows a navigator and has a known ā > 0."""
    sized = bool((results.worst["magnitude"] > 0).all())
    led = not is_leaderless(results.study.cells)
    return sized and led and metric_with_unit(results).endswith(" [m]")


def metric_with_unit(results: Results) -> str:
    config, metric = results.study.config, asked_search(results).maximise
    unit = {each.name: each.column_unit for each in config.measured()}.get(metric)
    told = f"{metric} [{unit}]" if unit else metric
    if metric != "unrecovered" or config.recovery is None:
        return told
    return f"{told} ({criterion_words(config.recovery, results.study.cells)})"


def worst_rows(results: Results) -> pd.DataFrame:
    """Return the results of a search, a row per cell; lengths are as `maximised_text` says.

    Bounds are left out where none is known.
    """
    found: Any = results.worst
    ratio = found["bound"] / found["found"]
    lengths = found.assign(ratio=ratio)[list(LENGTHS)]
    if is_per_size(results):
        lengths = lengths.div(found["magnitude"], axis="index").assign(ratio=ratio)
    if not np.isfinite(found["bound"].to_numpy(dtype=float)).any():
        lengths = lengths.drop(columns=["bound", "ratio"])
    who = found[["cell", *results.study.cells[0].labels, "attacked"]]
    return pd.concat([who, lengths.rename(columns=LENGTHS), found["lanes"]], axis="columns")
