"""What a script calls: `load` a study, `run` it, `open` its results."""

import shlex
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, NamedTuple

import yaml
from upath import UPath

from jaxnet.study import sweep
from jaxnet.study.config import Config
from jaxnet.study.document import Document
from jaxnet.study.folder import Folder, FolderError
from jaxnet.study.sweep import Cell

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from jaxnet.study.layout import Shard


@dataclass(frozen=True)
class Study:
    """A validated config and the cells that its sweep spans."""

    config: Config
    cells: tuple[Cell, ...]

    @property
    def lanes(self) -> int:
        """How many lanes it has, at most."""
        return len(self.cells) * self.config.most_samples


@dataclass(frozen=True)
class Results:
    """A results folder, read when asked."""

    path: UPath

    @cached_property
    def study(self) -> Study:
        """The study that was run."""
        return load(self.path / "study.yaml")

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """What `manifest.json` says."""
        return Folder(self.path).manifest

    @cached_property
    def lanes(self) -> "pd.DataFrame":
        """One row per lane, all in memory; see `by_cell`."""
        from jaxnet.study import rows

        return rows.read_all(Folder(self.path), self.shards)

    def by_cell(
        self, *columns: str, where: Any = None, cells: Container[int] | None = None
    ) -> "Iterator[tuple[int, pd.DataFrame]]":
        """Cell by cell, these columns of its lanes by sample; one cell's are in memory at a time.

        `where` is a condition of pyarrow's datasets on the rows, `cells` are the numbers of those wanted;
        cells without rows are passed over.
        """
        from jaxnet.study import rows

        shards = [shard for shard in self.shards if cells is None or shard.cell.number in cells]
        return rows.scan(Folder(self.path), shards, columns, where)

    def failed(self, most: int) -> "tuple[int, pd.DataFrame]":
        """How many lanes failed, and cell, sample and status of the first of them."""
        import pandas as pd

        from jaxnet.study import rows

        empty = pd.DataFrame({"cell": [], "sample": [], "status": []})
        if not self.manifest["lanes"]["failed"]:
            return 0, empty
        found = [lanes for _, lanes in self.by_cell("sample", "status", where=~rows.OK)]
        return sum(map(len, found)), pd.concat(found, ignore_index=True).head(most)

    def row(self, cell: int, sample: int) -> Any:
        """One lane's row, a pandas Series; None if it is not there."""
        from jaxnet.study import rows

        mine = [shard for shard in self.shards if shard.cell.number == cell and sample in shard.samples]
        for _, lanes in rows.scan(Folder(self.path), mine):
            return lanes[lanes["sample"] == sample].iloc[0]
        return None

    @cached_property
    def shards(self) -> "list[Shard]":
        """Shards whose rows are there."""
        from jaxnet.study import layout, rows

        there = {path.name for path in self.path.glob("lanes/*.parquet")}
        samples, size = self.manifest["samples"], self.manifest["shard_size"]
        shards = layout.shards_of(self.study.cells, samples, size)
        return [shard for shard in shards if PurePath(rows.name_of(shard.number)).name in there]

    @cached_property
    def cells(self) -> "pd.DataFrame":
        """One row per cell."""
        if not (self.manifest["finished"] and (self.path / "cells.csv").exists()):
            raise FolderError(f"{self.path} holds an unfinished run: the command that began it goes on")
        return read_table(self.path / "cells.csv")

    @cached_property
    def fits(self) -> "pd.DataFrame":
        """Fits of the ultimate error against ā."""
        return self.table("fit.csv")

    @cached_property
    def bounds(self) -> "pd.DataFrame":
        """Bounds on the ultimate error."""
        return self.table("bounds.csv")

    @cached_property
    def violations(self) -> "pd.DataFrame":
        """Lanes above a bound that claims to hold for them."""
        return self.table("violations.csv")

    def table(self, name: str) -> "pd.DataFrame":
        """One of the tables of `jaxnet fit`; raises FolderError if it is not there."""
        if not (self.path / name).exists():
            raise FolderError(f"{self.path} has no {name}: jaxnet fit {self.path} makes it")
        return read_table(self.path / name)

    def replay_command(self, cell: int, sample: int, engine: str | None = None) -> str:
        """What to type to see one lane again."""
        words = ["jaxnet", "replay", str(self.path), "--cell", str(cell), "--sample", str(sample)]
        return shlex.join(words + (["--engine", engine] if engine else []))

    @property
    def errors(self) -> "xr.Dataset":
        """`ẽ` and `ε̃` over time."""
        return self.arrays("errors.zarr", "save.errors=true")

    @property
    def trajectories(self) -> "xr.Dataset":
        """States, navigator, attack signals and kept weights over time."""
        return self.arrays("trajectories.zarr", "save.trajectories=all")

    def arrays(self, name: str, remedy: str) -> "xr.Dataset":
        """One of the stores; raises FolderError if the study did not save it."""
        import xarray as xr

        from jaxnet.study.arrays import store_at

        if not (self.path / name).exists():
            raise FolderError(f"{self.path} has no {name}: run it with {remedy}")
        return xr.open_zarr(store_at(self.path / name))


class Part(NamedTuple):
    """What a part of a run came to: its shards, those of them simulated now, and its failed lanes."""

    path: UPath
    shards: int
    simulated: int
    failed: int


def read_table(path: UPath) -> "pd.DataFrame":
    """A table of a results folder; blank is not-a-number, and labels like NA and None are text."""
    import pandas as pd

    with path.open("rb") as file:
        return pd.read_csv(file, keep_default_na=False, na_values=[""])


def load(
    source: str | Path | UPath | Mapping[str, Any], overrides: Mapping[str, Any] | Iterable[str] = ()
) -> Study:
    """Read a study from a YAML file, or from a mapping like one (its `name` is "study" if it has none).

    Overrides are a mapping by dotted key, or KEY=VALUE words. Raises ConfigError with everything that is
    wrong; of a mapping it names the places in its YAML.
    """
    if isinstance(source, Mapping):
        document = Document(yaml.safe_dump({"name": "study", **source}, sort_keys=False), "study")
    else:
        document = Document.read(source)
    if isinstance(overrides, Mapping):
        overrides = [f"{key}={as_yaml(value)}" for key, value in overrides.items()]
    for word in overrides:
        document.override(word)
    return Study(*sweep.read(document))


def as_yaml(value: Any) -> str:
    """A plain value as YAML (JSON is YAML)."""
    import json

    return json.dumps(value)


def run(
    study: Study,
    out: str | Path | UPath | None = None,
    fresh: bool = False,
    progress: Callable[[int, int, int], None] = lambda done, total, failed: None,
    devices: int | None = None,
    chunk: int | None = None,
    workers: int | None = None,
    cluster: str | None = None,
) -> Results:
    """Simulate what is not there yet into `out`, a path or URL (default results/NAME).

    `fresh` throws earlier results of that folder away; `progress` is told lanes done, all, failed.
    `devices` are the cores, or accelerators, used at most (default all); `chunk` is how many lanes advance
    side by side (default what suits the engine; another one changes rows by rounding). `workers` parts the
    cores among so many processes (a script that asks for them must guard its `__main__`), `cluster` is the
    address of a dask scheduler whose workers see the same folder.

    Raises FolderError or ClusterError.
    """
    from jaxnet.engine.cores import cores
    from jaxnet.study.cluster import crew

    folder = Folder(default_out(study, out))
    with folder.writing(), crew(folder.path, workers, cluster, devices or cores(), chunk) as others:
        from jaxnet.engine.batch import Machine  # takes as long as workers do, so they are called before
        from jaxnet.study.admission import admit
        from jaxnet.study.run import Run

        admit(folder, study.config, fresh)
        Run(study.config, study.cells, folder, progress, Machine(devices, chunk), others).whole()
    return Results(folder.path)


def run_part(
    study: Study,
    part: int,
    parts: int,
    out: str | Path | UPath | None = None,
    progress: Callable[[int, int, int], None] = lambda done, total, failed: None,
    devices: int | None = None,
    chunk: int | None = None,
) -> Part:
    """Simulate every `parts`-th shard from `part` on, counted from 0, into `lanes/` of `out`.

    Any number of these may run at the same time. `run` then simulates what is missing and makes tables and
    arrays. Raises FolderError.
    """
    from jaxnet.engine.batch import Machine
    from jaxnet.study.admission import admit
    from jaxnet.study.run import Run

    if not 0 <= part < parts:
        raise FolderError(f"there are parts 0 to {parts - 1} of {parts} (got {part})")
    folder, machine = Folder(default_out(study, out)), Machine(devices, chunk)
    with folder.writing(alone=False):
        admit(folder, study.config)
        run = Run(study.config, study.cells, folder, progress, machine)
        return Part(folder.path, *run.part(part, parts))


def default_out(study: Study, out: str | Path | UPath | None) -> str | Path | UPath:
    """Where results go."""
    return Path("results") / study.config.name if out is None else out


def open(path: str | Path) -> Results:
    """Results of a folder that a run has made; raises FolderError."""
    folder = Folder(path)
    rows_there = any(folder.path.glob("lanes/*.parquet"))
    if not folder.manifest and not rows_there:
        raise FolderError(f"{path} is not a results folder: it has no manifest.json")
    if not folder.manifest or not rows_there:
        raise FolderError(
            f"{path} holds an unfinished run: the command that began it, without --shard, goes on"
        )
    return Results(folder.path)
