"""The ultimate error against the size of the lie: what the lanes say of it, and what theory does."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pandas as pd

from jaxnet.study import bounds, fit
from jaxnet.study.api import Results
from jaxnet.study.config import Attacked, is_drawn
from jaxnet.study.folder import Folder


def analyse(results: Results) -> Iterator[Path]:
    """Write `bounds.csv`, `violations.csv` and, which takes longest, `fit.csv`; each when it is written.

    Raises FolderError where no ā is fixed or swept.
    """
    tables: dict[str, Callable[[], pd.DataFrame]] = {
        "bounds.csv": lambda: bounds.table(results.study.cells),
        "violations.csv": lambda: bounds.violations(results),
        "fit.csv": lambda: fit.table(results),
    }
    for name, table in tables.items():
        store(Folder(results.path), name, table())
        yield results.path / name


def asked(results: Results) -> bool:
    """Whether lanes are attacked with an ā > 0 that is fixed or swept."""
    attacks = [cell.scenario.attack for cell in results.study.cells]
    magnitudes = [attack.magnitude for attack in attacks if isinstance(attack, Attacked)]
    return not any(map(is_drawn, magnitudes)) and any(magnitudes)


def store(folder: Folder, name: str, table: pd.DataFrame) -> None:
    """Write a table whole."""
    folder.put(name, lambda file: table.to_csv(file, index=False))
