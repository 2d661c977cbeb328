"""The ultimate error against the attack's magnitude: what the lanes say of it, and what theory does."""

from collections.abc import Callable, Iterator

import pandas as pd
from upath import UPath

from jaxnet.statistics import fits as fit
from jaxnet.statistics import limits as bounds
from jaxnet.statistics.groups import attacked_groups
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results


def write_ultimate_error(results: Results, told: Steps = no_progress) -> Iterator[UPath]:
    """Write `bounds.csv`, `violations.csv` and, which takes longest, `fit.csv`; each when it is written.

    A table that needs the code of a kind that is not here is left out.
    Raises FolderError for an unfinished run, and where no ā is fixed or swept.
    """
    fit.fitted_groups(results)
    _ = results.cells
    tables: dict[str, Callable[[], pd.DataFrame]] = {
        "bounds.csv": lambda: bounds.slopes_table(results.study.cells),
        "violations.csv": lambda: bounds.violations_table(results),
        "fit.csv": lambda: fit.fit_table(results, told),
    }
    for name, table in tables.items():
        made = known_or(None, table)
        if made is None:
            continue
        yield results.folder.put(name, lambda file, made=made: made.to_csv(file, index=False))


def has_fixed_magnitude(results: Results) -> bool:
    """Whether lanes are attacked with an ā > 0 that is fixed or swept."""
    return any(group.attacked for group in attacked_groups(results.study.cells))
