"""Output of `jaxnet sensitivity`: the number of lanes, and Sobol's indices."""

from collections.abc import Mapping
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.study import Study
from jaxnet.explore.sensitivity import SENSITIVITY_FILE
from jaxnet.model.wording import count
from jaxnet.view.text.width import MOST_ROWS, fit_terminal, table_notes, table_text, terminal_width

INTERVAL_SUFFIXES = ("", "_low", "_high")
SENSITIVITY_DROP_ORDER = (("left out",),)
SENSITIVITY_LEGEND = (
    "parts of the variance over the lanes, with 95 % intervals. first: of the quantity alone; total: with its"
    " interactions. A dash: nothing varies. No interval: few lanes make up the variance."
)


def plan_text(lanes: Mapping[int, int], samples: int) -> str:
    """Return the number of lanes to simulate."""
    cells, most = count(len(lanes), "cell"), max(lanes.values()) // samples - 2
    return (
        f"{count(sum(lanes.values()), 'lane')}: in {cells} {samples:,} for each quantity drawn,"
        f" of which there are {most} at most, and twice as many more"
    )


def in_hundredths(estimate: float, low: float, high: float) -> str:
    """Return an index and its interval to hundredths; a dash stands for NaN."""
    if np.isnan(estimate):
        return "-"
    return f"{estimate:z.2f}" if np.isnan(low) else f"{estimate:z.2f} ({low:z.2f} to {high:z.2f})"


def indices_text(table: pd.DataFrame, study: Study, metric: str) -> str:
    """Return the indices of one metric, a line per cell and quantity."""
    rows: Any = pd.DataFrame(
        [
            {"cell": row["cell"], **study.cells[row["cell"]].labels, "quantity": row["quantity"]}
            | {
                order: in_hundredths(*(row[f"{order}{end}"] for end in INTERVAL_SUFFIXES))
                for order in ("first", "total")
            }
            | {"left out": row["left_out"]}
            for row in table.loc[table["metric"] == metric].to_dict("records")
        ]
    )
    rows = rows.drop(columns="left out") if not rows["left out"].any() else rows
    shown, left_out, is_cut = fit_terminal(
        rows.head(MOST_ROWS), list(study.cells[0].labels), SENSITIVITY_DROP_ORDER
    )
    lines = [f"{metric}:", table_text(shown)]
    if len(rows) > MOST_ROWS:
        lines.append(f"… {len(rows) - MOST_ROWS} more lines in {SENSITIVITY_FILE}")
    if "left out" in rows:
        lines.append(f"left out: samples of which a lane failed, of {table['samples'].iloc[0]:,}")
    return "\n".join(
        [
            *lines,
            fill(SENSITIVITY_LEGEND, terminal_width()),
            *table_notes(left_out, is_cut, SENSITIVITY_FILE),
        ]
    )
