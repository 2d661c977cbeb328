"""Output of a search, a sensitivity analysis and rare failures, beside the summary of a run."""

from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import judged_metric
from jaxnet.config.naming import worded
from jaxnet.config.study import Study
from jaxnet.statistics.quantities import TITLES
from jaxnet.store.results import Results
from jaxnet.view.text.printer import fitted_text
from jaxnet.view.text.width import filled
from jaxnet.view.text.worst import search_text

SENSITIVITY_LEGEND = (
    "parts of the variance over the lanes, with 95 % intervals. first: of the quantity alone;"
    " total: with its interactions. A dash: nothing varies. No interval: few lanes make up"
    " the variance."
)
RARE_TITLES = {
    "share": "share that fails",
    "low": "at least",
    "high": "at most",
    "lanes": "lanes simulated",
    "plain_lanes": "random lanes for such an interval",
}
RARE_LAST = [["levels"], ["failed"], [RARE_TITLES["lanes"]], [RARE_TITLES["plain_lanes"]]]
RARE_LEGEND = (
    "share that fails: of all lanes, those that do not recover, by subset simulation; at least, at"
    " most: its 95 % interval over ten repeats"
)


def analyses_text(results: Results) -> str:
    found = [search_text(results)] if results.file("worst.csv").exists() else []
    if "sensitivity" in results.analyses:
        metric = judged_metric(results.study.cells)
        found.append(indices_text(results.sensitivity, results.study, metric))
    if "rare" in results.analyses:
        found.append(rare_text(results.rare, results.study))
    return "\n\n".join(found)


def rare_text(table: pd.DataFrame, study: Study) -> str:
    rows, labels = named_cells(table["cell"].tolist(), study)
    rows |= rare_rows(table).drop(columns=["cell", *study.cells[0].labels]).to_dict("list")
    return f"{fitted_text(rows, labels, RARE_LAST, 'rare.csv')}\n{filled(RARE_LEGEND)}"


def named_cells(numbers: list[int], study: Study) -> tuple[dict[str, list[Any]], list[str]]:
    """Columns that name cells as `show` does, and the titles of their swept keys."""
    rows = [worded(study.cells[number].labels) for number in numbers]
    return {"cell": numbers} | {key: [row[key] for row in rows] for key in rows[0]}, [*rows[0]]


def rare_rows(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of `rare.csv` with titles in words."""
    return table.drop(columns=["points", "threshold"]).rename(columns=RARE_TITLES)


def in_hundredths(estimate: float, low: float, high: float) -> str:
    """An index and its interval to hundredths; a dash stands for NaN."""
    if np.isnan(estimate):
        return "-"
    return f"{estimate:z.2f}" if np.isnan(low) else f"{estimate:z.2f} ({low:z.2f} to {high:z.2f})"


def indices_text(table: pd.DataFrame, study: Study, metric: str) -> str:
    chosen: Any = table[table["metric"] == metric]
    rows, labels = named_cells(chosen["cell"].tolist(), study)
    rows["quantity"] = [each.removesuffix(".key") for each in chosen["quantity"]]  # noise, loss
    for order in ("first", "total"):
        indices = zip(*(chosen[f"{order}{end}"] for end in ("", "_low", "_high")), strict=True)
        rows[order] = [in_hundredths(*each) for each in indices]
    lines = [f"{TITLES[metric]} ({metric}):" if metric in TITLES else f"{metric}:"]
    if chosen["left_out"].any():
        rows["left out"] = chosen["left_out"].tolist()
        lines.append(f"left out: samples of which a lane failed, of {table['samples'].iloc[0]:,}")
    text = fitted_text(rows, labels, [["left out"]], "sensitivity.csv")
    return "\n".join([lines[0], text, *lines[1:], filled(SENSITIVITY_LEGEND)])
