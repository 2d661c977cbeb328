"""Ultimate error against the attack's magnitude: tables of bounds, violations and fits."""

import functools
from collections.abc import Callable, Iterator

import pandas as pd
from upath import UPath

from jaxnet.config.cells import is_leaderless
from jaxnet.statistics import fits as fit
from jaxnet.statistics import limits as bounds
from jaxnet.statistics.groups import attacked_groups
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results
from jaxnet.store.tables import write_table


def write_ultimate_error(results: Results, progress: Steps = no_progress) -> Iterator[UPath]:
    """Write `bounds.csv`, `violations.csv` and `fit.csv`, and yield each file when it is written.

    `fit.csv` takes longest. A table that needs the code of a missing kind is left out. Raises
    FolderError for an unfinished run, and if no ā is fixed or swept.
    """
    fit.fitted_groups(results)
    _ = results.cells
    tables: dict[str, Callable[[], pd.DataFrame]] = {
        "bounds.csv": lambda: bounds.slopes_table(results.study.cells),
        "violations.csv": lambda: bounds.violations_table(results),
        "fit.csv": lambda: fit.fit_table(results, progress),
    }
    for name, table in tables.items():
        frame = known_or(None, table)
        if frame is None:
            continue
        yield results.folder.put(name, functools.partial(write_table, frame))


def has_fixed_magnitude(results: Results) -> bool:
    """Whether lanes follow a navigator, attacked with an ā > 0 that is fixed or swept."""
    return not is_leaderless(results.study.cells) and any(
        group.attacked for group in attacked_groups(results.study.cells)
    )
