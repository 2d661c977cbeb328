"""Output of `jaxnet show` beside the summary: a search, a sensitivity analysis, rare failures."""

import pandas as pd

from jaxnet.config.cells import judged_metric
from jaxnet.store.results import Results
from jaxnet.view.text.printer import table_text
from jaxnet.view.text.sensitivity import indices_text
from jaxnet.view.text.width import MOST_ROWS
from jaxnet.view.text.worst import search_text


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
