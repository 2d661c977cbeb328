"""`Results`: the tables and arrays of a results folder, read at their first use."""

import re
import shlex
import warnings
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, SupportsInt, TypeVar

import pandas as pd
import pyarrow.dataset as ds
from upath import UPath

from jaxnet.config.document import Document
from jaxnet.config.study import Study, read_study
from jaxnet.kinds.metrics import CONTRACT
from jaxnet.store import arrays, layout, rows
from jaxnet.store.admission import admit_made, refuse_edited
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.layout import Shard
from jaxnet.store.looking import Looking, MissingKindError, known_or
from jaxnet.store.manifest import Manifest, changed_modules, changed_settings, samples_of_cells
from jaxnet.store.tables import read_table

if TYPE_CHECKING:
    import xarray

    from jaxnet.store import chunks

AnyResults = TypeVar("AnyResults", bound="Results")
STATISTICS = ("mean", "low", "high", "median", "q05", "q95", "max")  # of a metric in cells.csv
# What a folder may hold without a run, each with a table of its name.
ANALYSES = ("sensitivity", "rare")


@dataclass(frozen=True, repr=False)
class Results:
    """The tables and arrays of a results folder, read at their first use."""

    path: UPath
    out: Folder | None = None  # for what is made of the rows; None is the folder itself
    trust: bool = field(default=False, compare=False)
    config: Path | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        """Return one line with the path, or with the study of results in memory."""
        if not self.in_memory:
            held = "" if self.has_run else "".join(f", {name}" for name in self.analyses)
            return f"Results({str(self.path)!r}{held})"
        study, lanes = self.study, self.manifest["lanes"]["total"]
        return f"Results({study.config.name!r}, cells={len(study.cells)}, lanes={lanes}, in memory)"

    @property
    def in_memory(self) -> bool:
        """Whether the results live in the memory of this process alone."""
        return self.path.protocol == "memory"

    @property
    def place(self) -> str:
        """Path of the folder as messages name it; "the study in memory" without a folder."""
        return "the study in memory" if self.in_memory else str(self.path)

    @cached_property
    def study(self) -> Study:
        """Study of the run. A kind from outside without its code has its name and description."""
        local = self.path if isinstance(self.path, Path) else None
        places = list[Path]()  # from which the user permits the code of kinds
        if self.config is not None:
            places.append(self.config if self.config.is_dir() else self.config.parent)
        if self.trust:
            for name, made in self.manifest.get("modules", {}).items():
                above = list(Path(made["file"]).parents)
                places += above[name.count(".") + made["file"].endswith("__init__.py") :][:1]
            places += [local] if local is not None else []
        scope = Looking(local, self.manifest, places)
        study = read_study(Document.read(self.path / "study.yaml"), (), scope)
        if not scope.missing:
            refuse_edited(Folder(self.path), study.config)
        if changed := changed_settings(self.manifest, study.config):
            told = f"has another {changed[0]} than the tables beside it were made with"
            raise FolderError(f"{self.path}/study.yaml {told}: jaxnet run makes them again")
        for name in changed_modules(self.manifest, study.config):
            told = f"{name} was changed since the rows in {self.place} were made"
            warnings.warn(told, stacklevel=2)
        return study

    @property
    def missing(self) -> list[str]:
        """Names of the study's kinds whose code is not available."""
        scope = self.study.config.scope
        return scope.missing if isinstance(scope, Looking) else []

    def need_code(self) -> None:
        """Raise MissingKindError if the code of a kind is not available."""
        if self.missing:
            raise MissingKindError(", ".join(self.missing))

    def tell_missing(self, what: str) -> None:
        """Warn that `what` is left out if the code of a kind is not available."""
        if self.missing:
            told = f"{what} left out: {MissingKindError(', '.join(self.missing))}"
            warnings.warn(told, stacklevel=2)

    @property
    def analyses(self) -> list[str]:
        """Names of the analyses whose tables are in the folder: `sensitivity`, `rare`."""
        return [name for name in ANALYSES if self.file(f"{name}.csv").exists()]

    @property
    def has_run(self) -> bool:
        """Whether the folder holds rows of a run."""
        return any(self.path.glob("lanes/*.parquet"))

    def need_run(self) -> None:
        """Raise FolderError if the folder holds analyses and no run."""
        if self.analyses and not self.has_run:
            told = f"{self.place} holds {' and '.join(self.analyses)} and no run"
            raise FolderError(f"{told}: jaxnet run CONFIG --out {self.place} adds one")

    @cached_property
    def manifest(self) -> Manifest:
        """Content of `manifest.json`, read at the first use."""
        return Folder(self.path).manifest

    @cached_property
    def folder(self) -> Folder:
        """Folder for fits, figures, replays and the report."""
        return self.out or Folder(self.path)

    def file(self, name: str) -> UPath:
        """Return the path of a file that was made of the rows.

        Parameters
        ----------
        name
            Name of a file or store.

        Returns
        -------
        UPath
            Path in `out` if the file exists there, else in the results folder.
        """
        made = self.folder.path / name
        return made if made.exists() else self.path / name

    @cached_property
    def lanes(self) -> pd.DataFrame:
        """Table with a row per lane, all in memory; see `by_cell`."""
        every = (lanes for _, lanes in rows.scan_cells(Folder(self.path), self.shards))
        return pd.concat(every, ignore_index=True)

    def by_cell(
        self, *columns: str, where: ds.Expression | None = None, cells: Container[int] | None = None
    ) -> Iterator[tuple[int, pd.DataFrame]]:
        """Read the rows of the lanes cell by cell, with one cell's rows in memory.

        Parameters
        ----------
        *columns
            Names of columns; none means all columns.
        where
            A pyarrow expression on the rows.
        cells
            Numbers of the cells; None is all of them.

        Yields
        ------
        tuple[int, pd.DataFrame]
            The number of a cell, and its rows sorted by sample. Cells without rows are omitted.

        Raises
        ------
        FolderError
            A file cannot be read, or holds lanes of another study.
        """
        wanted = getattr(cells, "tolist", lambda: cells)()  # for `in` a Series holds its labels
        shards = [shard for shard in self.shards if wanted is None or shard.cell.number in wanted]
        yield from rows.scan_cells(Folder(self.path), shards, columns or None, where)

    def failed(self, most: int) -> tuple[int, pd.DataFrame]:
        """Count the failed lanes.

        Parameters
        ----------
        most
            Largest number of lanes to list.

        Returns
        -------
        tuple[int, pd.DataFrame]
            The number of failed lanes, and cell, sample and status of the first `most` of them.
            Where a lane is disconnected, also `cut_off` and `cut_off_at` [s]: who was cut off
            first, and when.
        """
        empty = pd.DataFrame({"cell": [], "sample": [], "status": []})
        if not self.manifest["lanes"]["failed"]:
            return 0, empty
        every = (lanes for _, lanes in self.by_cell(where=~rows.OK))
        failed: Any = pd.concat(every, ignore_index=True)
        wanted = ["cell", "sample", "status"]
        if (failed["status"] == "disconnected").any():
            wanted += [name for name in ("cut_off", "cut_off_at") if name in failed]
        return len(failed), failed[wanted].head(most)

    def row(self, cell: SupportsInt, sample: SupportsInt) -> pd.Series | None:
        """Read the row of one lane.

        Parameters
        ----------
        cell, sample
            Numbers of the cell and of the sample, from 0.

        Returns
        -------
        pd.Series | None
            The row; None if it is not in the folder.

        Raises
        ------
        FolderError
            A number is not a nonnegative integer.
        """
        cell, sample = whole_number("cell", cell), whole_number("sample", sample)
        where = ds.field("sample") == sample
        for _, lanes in self.by_cell(where=where, cells=[cell]):
            return lanes.iloc[0]
        return None

    @cached_property
    def samples(self) -> list[int]:
        """Number of samples of each cell: they differ where cells end by a criterion."""
        cells = len(self.study.cells)
        if (there := self.manifest.get("cells", cells)) != cells:
            told = f"its manifest tells of {there} cells, and its study has {cells}"
            raise FolderError(f"{self.place} is not what a run left: {told}")
        return samples_of_cells(self.manifest, cells)

    @cached_property
    def shards(self) -> list[Shard]:
        """Shards whose rows are in the folder."""
        names = (path.stem for path in self.path.glob("lanes/*.parquet"))
        there = {int(name) for name in names if re.fullmatch(r"\d{5,12}", name)}
        size, cells = self.manifest["shard_size"], self.study.cells
        return layout.shards_of(cells, self.samples, size, sorted(there))

    @cached_property
    def cells(self) -> pd.DataFrame:
        """Table with a row per cell of a finished run: means, quantiles and shares of its lanes."""
        self.need_run()
        if not (self.manifest["finished"] and (self.path / "cells.csv").exists()):
            told = "holds an unfinished run: the same command finishes it"
            raise FolderError(f"{self.place} {told}")
        return self.checked("cells.csv", self.path / "cells.csv")

    def checked(self, name: str, file: UPath) -> pd.DataFrame:
        """Read a table; raise FolderError if a reader's columns, numbers or cells are not there."""
        cells, needed = len(self.study.cells), list[str]()
        if name == "cells.csv":
            own = [metric.name for metric in self.study.config.measured()[len(CONTRACT) :]]
            metrics = ("tail_mean", "tail_max", *own)
            needed = ["lanes", "ok", "failed"]
            needed += [f"{metric}_{each}" for metric in metrics for each in STATISTICS]
            shares = ["unrecovered"] if self.study.config.recovery else []
            needed += [f"{share}{end}" for share in shares for end in ("", "_low", "_high")]
        found = read_table(file, sum(self.samples) if self.manifest["finished"] else 0, needed)
        foreign = "cell" in found and not set(found["cell"]) <= set(range(cells))
        if foreign or (name == "cells.csv" and len(found) != cells):
            raise FolderError(f"{file} is not a table of ours (the study has {cells} cells)")
        return found

    @property
    def fits(self) -> pd.DataFrame:
        """Table of the fits of the ultimate error against ā; raises FolderError before `fit`."""
        return self.table("fit.csv")

    @property
    def bounds(self) -> pd.DataFrame:
        """Table of the bounds on the ultimate error; raises FolderError before `fit`."""
        return self.table("bounds.csv")

    @property
    def violations(self) -> pd.DataFrame:
        """Table of the lanes above a bound that holds for them; raises FolderError before `fit`."""
        return self.table("violations.csv")

    @property
    def worst(self) -> pd.DataFrame:
        """Table of the worst choice in each cell; raises FolderError before a search."""
        return self.table("worst.csv", "jaxnet search CONFIG makes it")

    @property
    def searched(self) -> pd.DataFrame:
        """Table with a row per generation of a search; raises FolderError before a search."""
        return self.table("search.csv", "jaxnet search CONFIG makes it")

    @property
    def sensitivity(self) -> pd.DataFrame:
        """Table of Sobol's indices; raises FolderError before `jaxnet.sensitivity`."""
        return self.table("sensitivity.csv", "jaxnet sensitivity CONFIG makes it")

    @property
    def rare(self) -> pd.DataFrame:
        """Table of the shares of rare failures; raises FolderError before `jaxnet.rare`."""
        return self.table("rare.csv", "jaxnet rare CONFIG makes it")

    def table(self, name: str, remedy: str = "") -> pd.DataFrame:
        """Read a table that a command makes after the run.

        Parameters
        ----------
        name
            Name of the table's file.
        remedy
            Advice for the error message; by default it names `jaxnet fit`.

        Returns
        -------
        pd.DataFrame
            The table.

        Raises
        ------
        FolderError
            The table does not exist.
        """
        file = self.file(name)
        if not file.exists():
            made = "Results.fit() makes it"
            if not self.in_memory:
                made = f"jaxnet fit {self.path} makes it, or Results.fit()"
            raise FolderError(f"{self.place} has no {name}: {remedy or made}")
        return self.checked(name, file)

    def replay_command(
        self, cell: SupportsInt, sample: SupportsInt, engine: str | None = None
    ) -> str:
        """Return the command that simulates one lane again, or Python's call for results in memory.

        Parameters
        ----------
        cell, sample
            Numbers of the cell and of the sample, from 0.
        engine
            Name of an engine; None is the study's own engine.

        Returns
        -------
        str
            The command, quoted for a shell.
        """
        cell, sample = whole_number("cell", cell), whole_number("sample", sample)
        if self.in_memory:
            return f"results.replay({cell}, {sample}{f', {engine!r}' if engine else ''})"
        words = ["jaxnet", "replay", str(self.path), "--cell", str(cell), "--sample", str(sample)]
        return shlex.join(words + (["--engine", engine] if engine else []))

    @property
    def errors(self) -> "xarray.Dataset":
        """Mean tracking error and disagreement [m] over (cell, sample, time), if saved."""
        return self.arrays("errors.zarr", "save.errors=true")

    @property
    def vehicles(self) -> "xarray.Dataset":
        """Mean and greatest error [m] over the tail, over (cell, sample, vehicle), if saved."""
        return self.arrays("vehicles.zarr", "save.vehicles=true")

    @property
    def trajectories(self) -> "xarray.Dataset":
        """States, the navigator's path and attack signals [m], kept weights, if saved."""
        return self.arrays("trajectories.zarr", "save.trajectories=all")

    def arrays(self, name: str, remedy: str) -> "xarray.Dataset":
        """Open one of the stores of arrays.

        Parameters
        ----------
        name
            Name of the store.
        remedy
            Override of the config that saves these arrays, for the error message.

        Returns
        -------
        xarray.Dataset
            The arrays, read from the disk at their first use.

        Raises
        ------
        FolderError
            The study did not save these arrays.
        """
        if not (self.path / name).exists():
            raise FolderError(f"{self.place} has no {name}: run it with {remedy}")
        save = self.study.config.save
        filled = {"errors.zarr": save.errors, "vehicles.zarr": save.vehicles}
        if not (filled.get(name, save.trajectories == "all") and self.manifest["finished"]):
            return arrays_at(self.path / name, self.sizes)
        size, samples = self.manifest["shard_size"], self.samples
        sizes = self.sizes | {"sample": max(samples)}
        return arrays_at(self.path / name, sizes, lambda cell, block: block * size < samples[cell])

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Sizes of the dimensions of arrays that are equal in all stores."""
        return known_or({}, lambda: layout.sizes(self.study.cells))


class Part(NamedTuple):
    """A part of a run.

    Attributes
    ----------
    path
        Path of the results folder.
    shards
        Number of shards of the part.
    simulated
        Number of shards that were missing.
    failed
        Number of failed lanes.

    Examples
    --------
    >>> import jaxnet, tempfile
    >>> keys = {"engine": "exact", "horizon": 1.0, "tail": 0.5, "samples": 2}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     jaxnet.run_part(keys, part=0, parts=2, out=folder, progress=False).shards
    ...     jaxnet.run_part(keys, part=1, parts=2, out=folder, progress=False).shards
    1
    0
    """

    path: UPath
    shards: int
    simulated: int
    failed: int


def whole_number(name: str, number: SupportsInt) -> int:
    """Number of a cell or a sample as an int; raise FolderError unless it is 0, 1, ..."""
    found = int(number)
    if found != number or found < 0:
        raise FolderError(f"{name} is a whole number from 0 on (got {number})")
    return found


def arrays_at(
    path: UPath, sizes: Mapping[str, int] | None = None, due: "chunks.Due | None" = None
) -> "xarray.Dataset":
    """Open a store; load a store in memory at once, since its memory is freed with its Results."""
    found = arrays.open_store(path, sizes, due, by_dask=True)
    return found.load() if path.protocol == "memory" else found


def written_into(results: AnyResults, out: str | Path | UPath | None) -> AnyResults:
    """Results whose fits, figures, replays and report are written into a folder; None: their own.

    Raises FolderError if the folder holds files made of other rows.
    """
    if out is None:
        return results
    made = Folder(out)
    admit_made(made, results.manifest, results.study.config)
    return replace(results, out=made)
