"""Output of `jaxnet search`: the worst choice in each cell, beside random lanes and bounds."""

import numpy as np
import pandas as pd

from jaxnet.config.cells import is_leaderless
from jaxnet.statistics.recovery import criterion_words
from jaxnet.store.results import Results
from jaxnet.view.text.printer import fitted_text
from jaxnet.view.text.width import MOST_ROWS, filled, left_out_note

SEARCH_DROP_ORDER = (
    ("lanes",),
    ("fresh least 5 %",),
    ("greatest",),
    ("nonlinear",),
    ("bound / found",),
)


def search_text(results: Results) -> str:
    labels = list(results.study.cells[0].labels)
    text, left_out = fitted_text(worst_rows(results).head(MOST_ROWS), labels, SEARCH_DROP_ORDER)
    late = f"late: at {late_times(results)}; fresh: from other starts"
    head = f"the worst {maximised_text(results)}; {late}"
    notes = [filled(each) for each in (starts_text(results), *limit_lines(results))]
    return "\n".join(
        [head, text, *notes, *left_out_note(left_out, str(results.path / "worst.csv"))]
    )


def starts_text(results: Results) -> str:
    """From how many starts a choice is tried, beside those of random lanes."""
    asked = results.study.config.search
    assert asked is not None
    same = (
        "the same start" if asked.starts == 1 else f"the same {asked.starts:,} starts, their mean"
    )
    return (
        f"found: every choice from {same}; random lanes: each a choice and a start of its"
        " own, the greatest lane; so random lanes may be above what was found, from a worse start"
    )


def limit_lines(results: Results) -> list[str]:
    """Limits of `subject_to`, how many further starts fulfil them, and where no choice does."""
    asked = results.study.config.search
    assert asked is not None
    if not asked.subject_to:
        return []
    told = ", ".join(f"{name} ≤ {most:g}" for name, most in asked.subject_to.items())
    shares = results.worst["fresh_allowed"].where(results.worst["found"].notna()).dropna()
    nowhere = results.worst["cell"][results.worst["found"].isna()].tolist()
    lines = [f"subject to {told} from every start of the search"]
    if len(shares):
        lines.append(f"of other starts {shares.min():.1%} to {shares.max():.1%} fulfil it")
    if nowhere:
        cells = f"cells {', '.join(map(str, nowhere))}" if len(results.worst) > 1 else "the study"
        lines.append(
            f"no choice that was tried in {cells} fulfils it: search where more of them do"
        )
    return ["; ".join(lines)]


def late_times(results: Results) -> str:
    times = results.worst["until"]
    return " or ".join(f"{time:g} s" for time in sorted(set(times)))


def maximised_text(results: Results) -> str:
    words = metric_with_unit(results)
    return words.replace(" [m]", ", per ā") if is_per_size(results) else words


def is_per_size(results: Results) -> bool:
    """Whether lengths are told per ā: every cell follows a navigator and has a known ā > 0."""
    sized = (results.worst["magnitude"] > 0).all()
    return metric_unit(results) == "m" and not is_leaderless(results.study.cells) and bool(sized)


def metric_with_unit(results: Results) -> str:
    asked = results.study.config.search
    assert asked is not None
    told = f"{asked.maximise} [{metric_unit(results)}]".removesuffix(" []")
    criterion = results.study.config.recovery if asked.maximise == "unrecovered" else None
    return f"{told} ({criterion_words(criterion, results.study.cells)})" if criterion else told


def metric_unit(results: Results) -> str:
    config = results.study.config
    assert config.search is not None
    units = {each.name: each.column_unit for each in config.measured()}
    return units.get(config.search.maximise, "")


def worst_rows(results: Results) -> pd.DataFrame:
    """Return the results of a search, a row per cell; lengths are as `maximised_text` says.

    Bounds are left out where none is known.
    """
    found, labels = results.worst, list(results.study.cells[0].labels)
    size = found["magnitude"] if is_per_size(results) else 1.0
    titles = {"found": "found", "late": "late", "greatest": "greatest", "random": "random lanes"}
    titles |= {"bound": "bound", "ratio": "bound / found"}
    titles |= {"fresh": "fresh mean", "fresh_low": "fresh least 5 %", "nonlinear": "nonlinear"}
    ratio = found["bound"] / found["found"]
    per = {
        title: ratio if name == "ratio" else found[name] / size for name, title in titles.items()
    }
    if not np.isfinite(found["bound"].to_numpy(dtype=float)).any():
        per = {name: values for name, values in per.items() if "bound" not in name}
    who = {"cell": found["cell"], **found[labels], "attacked": found["attacked"]}
    return pd.DataFrame({**who, **per, "lanes": found["lanes"]})
