"""The ultimate error against the size of the lie: what the lanes say of it, and what theory does."""

from pathlib import Path

import pandas as pd

from jaxnet.study import bounds, fit
from jaxnet.study.api import Results
from jaxnet.study.config import Attacked, is_drawn
from jaxnet.study.folder import Folder


def analyse(results: Results) -> list[Path]:
    """Write `fit.csv`, `bounds.csv` and `violations.csv`; raises FolderError where no ā is fixed or swept."""
    folder = Folder(results.path)
    tables = {
        "fit.csv": fit.table(results),
        "bounds.csv": bounds.table(results.study.cells),
        "violations.csv": bounds.violations(results),
    }
    for name, table in tables.items():
        store(folder, name, table)
    return [folder.path / name for name in tables]


def asked(results: Results) -> bool:
    """Whether lanes are attacked with an ā > 0 that is fixed or swept."""
    attacks = [cell.scenario.attack for cell in results.study.cells]
    magnitudes = [attack.magnitude for attack in attacks if isinstance(attack, Attacked)]
    return not any(map(is_drawn, magnitudes)) and any(magnitudes)


def store(folder: Folder, name: str, table: pd.DataFrame) -> None:
    """Write a table whole."""
    folder.put(name, lambda file: table.to_csv(file, index=False))
