"""A table that an analysis writes cell by cell: what it holds of a cell is not computed again."""

from typing import Any

import pandas as pd
from upath import UPath

from jaxnet.config.study import Study
from jaxnet.statistics.recovery import same_thresholds
from jaxnet.store.folder import Folder
from jaxnet.store.tables import csv_text, read_table

AnalysisRow = dict[str, Any]  # of a table, by its columns


class CellTable:
    """The rows of a table with equal thresholds and an equal number of lanes (column `effort`)."""

    def __init__(self, study: Study, folder: Folder, name: str, effort: str, lanes: int):
        self.folder, self.name, self.rows = folder, name, list[AnalysisRow]()
        if self.path.exists():
            table: Any = read_table(self.path)
            same = (table[effort] == lanes) & same_thresholds(study, table)
            self.rows = table[same].to_dict("records")
        self.known = {row["cell"] for row in self.rows}

    @property
    def path(self) -> UPath:
        return self.folder.path / self.name

    def add(self, rows: list[AnalysisRow]) -> None:
        self.rows += rows
        table = pd.DataFrame(self.rows).sort_values("cell", kind="stable")
        self.folder.put(self.name, csv_text(table).encode())
