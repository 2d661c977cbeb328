"""Results: what a run has left in its folder, read when it is asked for."""

import shlex
import warnings
from collections.abc import Container, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, SupportsInt

import pandas as pd
from upath import UPath

from jaxnet.config.document import Document
from jaxnet.config.study import Study, read_study
from jaxnet.store import arrays, layout, rows
from jaxnet.store.admission import admit_made, changed_modules
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.layout import Shard
from jaxnet.store.looking import Looking, MissingKindError

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, repr=False)
class Results:
    """A results folder, read when asked."""

    path: UPath
    out: Folder | None = None  # where what is made of the rows is written, if not into the folder itself
    trust: bool = field(default=False, compare=False)
    config: Path | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        """One line."""
        return f"Results({str(self.path)!r})"

    @cached_property
    def study(self) -> Study:
        """The study that was run; kinds from outside whose code is not here are named, and no more."""
        local = self.path if isinstance(self.path, Path) else None
        study = read_study(
            Document.read(self.path / "study.yaml"), (), Looking(local, self.manifest, self.code_places())
        )
        for name in changed_modules(Folder(self.path), study.config):
            warnings.warn(f"{name} was changed since the rows in {self.path} were made", stacklevel=2)
        return study

    def code_places(self) -> Iterator[Path]:
        """Folders from which the user lets the code of kinds be loaded."""
        if self.config is not None:
            yield self.config if self.config.is_dir() else self.config.parent
        if self.trust:
            for name, made in self.manifest.get("modules", {}).items():
                above = list(Path(made["file"]).parents)
                yield from above[name.count(".") + made["file"].endswith("__init__.py") :][:1]
            if isinstance(self.path, Path):
                yield self.path

    @property
    def missing(self) -> list[str]:
        """Names of the study's kinds whose code is not here."""
        scope = self.study.config.scope
        return scope.missing if isinstance(scope, Looking) else []

    def need_code(self) -> None:
        """Raise MissingKindError if the code of some kind is not here."""
        if self.missing:
            raise MissingKindError(", ".join(self.missing))

    def tell_missing(self, what: str) -> None:
        """Warn that something is left out if the code of some kind is not here."""
        if self.missing:
            warnings.warn(f"{what} left out: {MissingKindError(', '.join(self.missing))}", stacklevel=2)

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """What `manifest.json` says."""
        return Folder(self.path).manifest

    @cached_property
    def folder(self) -> Folder:
        """Where what is made of the rows is written."""
        return self.out or Folder(self.path)

    def file(self, name: str) -> UPath:
        """Where a file or store is that was made of the rows: in `out`, or else in the folder."""
        made = self.folder.path / name
        return made if made.exists() else self.path / name

    @cached_property
    def lanes(self) -> pd.DataFrame:
        """One row per lane, all in memory; see `by_cell`."""
        return rows.read_all(Folder(self.path), self.shards)

    def by_cell(
        self, *columns: str, where: Any = None, cells: Container[int] | None = None
    ) -> Iterator[tuple[int, pd.DataFrame]]:
        """Cell by cell, these columns of its lanes by sample; one cell's are in memory at a time.

        `where` is a condition of pyarrow's datasets on the rows, `cells` are the numbers of those wanted;
        cells without rows are passed over.
        """
        wanted = getattr(cells, "tolist", lambda: cells)()  # for `in` a Series holds its labels
        shards = [shard for shard in self.shards if wanted is None or shard.cell.number in wanted]
        yield from rows.scan(Folder(self.path), shards, columns, where)

    def failed(self, most: int) -> tuple[int, pd.DataFrame]:
        """How many lanes failed, and cell, sample and status of the first of them."""
        empty = pd.DataFrame({"cell": [], "sample": [], "status": []})
        if not self.manifest["lanes"]["failed"]:
            return 0, empty
        found = [lanes for _, lanes in self.by_cell("sample", "status", where=~rows.OK)]
        return sum(map(len, found)), pd.concat(found, ignore_index=True).head(most)

    def row(self, cell: SupportsInt, sample: SupportsInt) -> Any:
        """One lane's row, a pandas Series; None if it is not there."""
        cell, sample = whole("cell", cell), whole("sample", sample)
        mine = [shard for shard in self.shards if shard.cell.number == cell and sample in shard.samples]
        for _, lanes in rows.scan(Folder(self.path), mine):
            return lanes[lanes["sample"] == sample].iloc[0]
        return None

    @cached_property
    def shards(self) -> list[Shard]:
        """Shards whose rows are there."""
        names = (path.name for path in self.path.glob("lanes/*.parquet"))
        there = {number for name in names if (number := rows.number_of(name)) is not None}
        samples, size, cells = self.manifest["samples"], self.manifest["shard_size"], self.study.cells
        shards = (layout.shard_of(cells, samples, size, number) for number in sorted(there))
        return [shard for shard in shards if shard.samples]

    @cached_property
    def cells(self) -> pd.DataFrame:
        """One row per cell."""
        if not (self.manifest["finished"] and (self.path / "cells.csv").exists()):
            raise FolderError(f"{self.path} holds an unfinished run: the command that began it goes on")
        return read_table(self.path / "cells.csv")

    @property
    def fits(self) -> pd.DataFrame:
        """Fits of the ultimate error against ā."""
        return self.table("fit.csv")

    @property
    def bounds(self) -> pd.DataFrame:
        """Bounds on the ultimate error."""
        return self.table("bounds.csv")

    @property
    def violations(self) -> pd.DataFrame:
        """Lanes above a bound that claims to hold for them."""
        return self.table("violations.csv")

    @property
    def worst(self) -> pd.DataFrame:
        """The worst that a search has found in each cell."""
        return self.table("worst.csv", "jaxnet search CONFIG makes it")

    @property
    def searched(self) -> pd.DataFrame:
        """Each generation of a search."""
        return self.table("search.csv", "jaxnet search CONFIG makes it")

    def table(self, name: str, remedy: str = "") -> pd.DataFrame:
        """A table that is made when it is asked for; raises FolderError if it is not there."""
        file = self.file(name)
        if not file.exists():
            remedy = remedy or f"jaxnet fit {self.path} makes it, or Results.fit()"
            raise FolderError(f"{self.path} has no {name}: {remedy}")
        return read_table(file)

    def replay_command(self, cell: SupportsInt, sample: SupportsInt, engine: str | None = None) -> str:
        """What to type to see one lane again."""
        cell, sample = whole("cell", cell), whole("sample", sample)
        words = ["jaxnet", "replay", str(self.path), "--cell", str(cell), "--sample", str(sample)]
        return shlex.join(words + (["--engine", engine] if engine else []))

    @property
    def errors(self) -> "xarray.Dataset":
        """`ẽ` and `ε̃` over time."""
        return self.arrays("errors.zarr", "save.errors=true")

    @property
    def trajectories(self) -> "xarray.Dataset":
        """States, navigator, attack signals and kept weights over time."""
        return self.arrays("trajectories.zarr", "save.trajectories=all")

    def arrays(self, name: str, remedy: str) -> "xarray.Dataset":
        """One of the stores; raises FolderError if the study did not save it."""
        if not (self.path / name).exists():
            raise FolderError(f"{self.path} has no {name}: run it with {remedy}")
        return arrays_at(self.path / name)


class Part(NamedTuple):
    """What a part of a run came to: its shards, those of them simulated now, and its failed lanes."""

    path: UPath
    shards: int
    simulated: int
    failed: int


def whole(name: str, number: SupportsInt) -> int:
    """A cell's or sample's number as Python has it; raises FolderError if it cannot be one."""
    found = int(number)
    if found != number or found < 0:
        raise FolderError(f"{name} is a whole number from 0 on (got {number})")
    return found


def arrays_at(path: UPath) -> "xarray.Dataset":
    """A store, read when it is asked for; one in memory at once, for that is freed with its Results."""
    found = arrays.open_store(path)
    return found.load() if path.protocol == "memory" else found


def read_table(path: UPath) -> pd.DataFrame:
    """A table of a results folder; blank is not-a-number, and labels like NA and None are text."""
    with path.open("rb") as file:
        return pd.read_csv(file, keep_default_na=False, na_values=[""])


def open(
    path: str | Path | UPath,
    out: str | Path | UPath | None = None,
    trust: bool = False,
    config: Path | None = None,
) -> Results:
    """Results of a folder that a run has made; what is made of them goes into `out`, if that is given.

    Raises FolderError if it is no such folder, or if `out` holds what was made of other rows.

    No code is run because the folder names it. `config` is the study's config, or its folder: modules beside
    it are loaded. With `trust` modules are loaded from where the folder says that they are.
    """
    if config is not None and not config.exists():
        raise FolderError(f"{config}: there is no such config")
    folder = Folder(path)
    rows_there = any(folder.path.glob("lanes/*.parquet"))
    if not folder.manifest and not rows_there:
        raise FolderError(f"{path} is not a results folder: it has no manifest.json")
    if not folder.manifest or not rows_there:
        raise FolderError(
            f"{path} holds an unfinished run: the command that began it, without --shard, goes on"
        )
    if out is None:
        return Results(folder.path, None, trust, config)
    made = Folder(out)
    admit_made(made, folder.manifest)
    return Results(folder.path, made, trust, config)
