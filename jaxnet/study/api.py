"""What a script calls: `load` a study, `run` it, `open` its results."""

import shlex
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from jaxnet.study import sweep
from jaxnet.study.config import Config
from jaxnet.study.document import Document
from jaxnet.study.folder import Folder, FolderError
from jaxnet.study.sweep import Cell

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


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

    path: Path

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
        """One row per lane."""
        from jaxnet.study.run import read_rows

        return read_rows(Folder(self.path))

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

        if not (self.path / name).exists():
            raise FolderError(f"{self.path} has no {name}: run it with {remedy}")
        return xr.open_zarr(self.path / name)


def read_table(path: Path) -> "pd.DataFrame":
    """A table of a results folder; blank is not-a-number, and labels like NA and None are text."""
    import pandas as pd

    return pd.read_csv(path, keep_default_na=False, na_values=[""])


def load(source: str | Path | Mapping[str, Any], overrides: Mapping[str, Any] | Iterable[str] = ()) -> Study:
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
    out: str | Path | None = None,
    fresh: bool = False,
    progress: Callable[[int, int, int], None] = lambda done, total, failed: None,
    devices: int | None = None,
    chunk: int | None = None,
) -> Results:
    """Simulate what is not there yet into `out` (default results/NAME); raises FolderError.

    `fresh` throws earlier results of that folder away; `progress` is told lanes done, all, failed.
    `devices` are the cores, or accelerators, used at most (default all); `chunk` is how many lanes advance
    side by side (default what suits the engine; another one changes rows by rounding).
    """
    from jaxnet.engine.batch import Machine
    from jaxnet.study.run import execute

    folder = Folder(out or Path("results") / study.config.name)
    with folder.writing():
        folder.admit(study.config, fresh)
        execute(study.config, study.cells, folder, progress, Machine(devices, chunk))
    return Results(folder.path)


def open(path: str | Path) -> Results:
    """Results of a folder that a run has made; raises FolderError."""
    if not Folder(path).manifest:
        raise FolderError(f"{path} is not a results folder: it has no manifest.json")
    if not list(Path(path).glob("lanes/*.parquet")):
        raise FolderError(f"{path} holds an unfinished run: the command that began it goes on")
    return Results(Path(path))
