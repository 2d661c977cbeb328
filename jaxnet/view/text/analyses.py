"""Output of `jaxnet show` beside the summary: a search, a sensitivity analysis, rare failures."""

import pandas as pd

from jaxnet.config.cells import judged_metric
from jaxnet.store.results import Results
from jaxnet.view.text.sensitivity import indices_text
from jaxnet.view.text.width import MOST_ROWS, table_text
from jaxnet.view.text.worst import search_text


def analyses_text(results: Results) -> str:
    """Return the tables of all analyses in a folder, as their commands print them."""
    searched = [search_text(results)] if results.file("worst.csv").exists() else []
    return "\n\n".join([*searched, *(ANALYSIS_TEXTS[name](results) for name in results.analyses)])


def rare_text(table: pd.DataFrame) -> str:
    """Return the shares of rare failures with their intervals, a line per cell."""
    return table_text(table.drop(columns=["points", "threshold"]).head(MOST_ROWS))


ANALYSIS_TEXTS = {
    "sensitivity": lambda results: indices_text(
        results.sensitivity, results.study, judged_metric(results.study.cells)
    ),
    "rare": lambda results: rare_text(results.rare),
}
