"""Output of a search, a sensitivity analysis and rare failures, beside the summary of a run."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import judged_metric
from jaxnet.config.study import Study
from jaxnet.model.wording import count
from jaxnet.store.results import Results
from jaxnet.view.text.printer import fitted_text, table_text
from jaxnet.view.text.width import MOST_ROWS, filled, left_out_note
from jaxnet.view.text.worst import search_text

INDICES_FILE = "sensitivity.csv"
INTERVAL_SUFFIXES = ("", "_low", "_high")
SENSITIVITY_LEGEND = (
    "parts of the variance over the lanes, with 95 % intervals. first: of the quantity alone;"
    " total: with its interactions. A dash: nothing varies. No interval: few lanes make up"
    " the variance."
)


def analyses_text(results: Results) -> str:
    found = [search_text(results)] if results.file("worst.csv").exists() else []
    if "sensitivity" in results.analyses:
        metric = judged_metric(results.study.cells)
        found.append(indices_text(results.sensitivity, results.study, metric))
    if "rare" in results.analyses:
        found.append(rare_text(results.rare))
    return "\n\n".join(found)


def rare_text(table: pd.DataFrame) -> str:
    return table_text(table.drop(columns=["points", "threshold"]).head(MOST_ROWS))


def plan_text(lanes: Mapping[int, int], samples: int) -> str:
    cells, most = count(len(lanes), "cell"), max(lanes.values()) // samples - 2
    return (
        f"{count(sum(lanes.values()), 'lane')}: in {cells} {samples:,} for each quantity drawn,"
        f" of which there are {most} at most, and twice as many more"
    )


def in_hundredths(estimate: float, low: float, high: float) -> str:
    """An index and its interval to hundredths; a dash stands for NaN."""
    if np.isnan(estimate):
        return "-"
    return f"{estimate:z.2f}" if np.isnan(low) else f"{estimate:z.2f} ({low:z.2f} to {high:z.2f})"


def indices_text(table: pd.DataFrame, study: Study, metric: str) -> str:
    chosen: Any = table[table["metric"] == metric]
    labels = list(study.cells[0].labels)
    swept = [study.cells[number].labels for number in chosen["cell"]]
    rows = pd.DataFrame(
        {"cell": chosen["cell"].tolist()}
        | {key: [each[key] for each in swept] for key in labels}
        | {"quantity": chosen["quantity"].tolist()}
        | {
            order: [
                in_hundredths(*ends)
                for ends in chosen[[f"{order}{end}" for end in INTERVAL_SUFFIXES]].to_numpy()
            ]
            for order in ("first", "total")
        }
        | {"left out": chosen["left_out"].tolist()}
    )
    rows = rows if any(rows["left out"].tolist()) else rows.drop(columns="left out")
    text, left_out = fitted_text(rows.head(MOST_ROWS), labels, [["left out"]])
    lines = [f"{metric}:", text]
    if len(rows) > MOST_ROWS:
        lines.append(f"… {len(rows) - MOST_ROWS} more lines in {INDICES_FILE}")
    if "left out" in rows:
        lines.append(f"left out: samples of which a lane failed, of {table['samples'].iloc[0]:,}")
    return "\n".join([*lines, filled(SENSITIVITY_LEGEND), *left_out_note(left_out, INDICES_FILE)])
