"""The results folder (DESIGN, section 5): what belongs to whom, who may write, and what is done already.

A file is written under a temporary name and then renamed, so a reader sees it whole or not at all, and a
shard is done when its file is there.
"""

import contextlib
import fcntl
import hashlib
import json
import os
import platform
import shutil
from collections.abc import Callable, Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import yaml

import jaxnet
from jaxnet.study.config import Config
from jaxnet.study.document import Document, Loader
from jaxnet.study.sweep import plain

UNHASHED = ("name", "save", "samples", "recovery")  # keys that change no row
DERIVED = ("fit.csv", "bounds.csv", "violations.csv", "figures", "report.html")  # from rows, made when asked
OURS = (
    "study.yaml",
    "manifest.json",
    "cells.csv",
    "lanes",
    "errors.zarr",
    "trajectories.zarr",
    "replays",
    *DERIVED,
)
FILLED = "jaxnet.filled"  # in a row file's metadata: the stores that its lanes are in
PACKAGES = ("jax", "jaxlib", "diffrax", "numpy")


class Dumper(yaml.SafeDumper):
    """Quotes text that YAML 1.2 would read as something else."""

    yaml_implicit_resolvers = Loader.yaml_implicit_resolvers


class FolderError(ValueError):
    """A results folder that cannot be used for what was asked."""


def digest(config: Config) -> str:
    """Hash of everything in a config that changes rows."""
    kept = {key: value for key, value in plain(config).items() if key not in UNHASHED}
    kept["sweep"] = list(kept["sweep"].items())  # its order numbers the cells
    return hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()


def versions() -> dict[str, str]:
    """Versions of what the rows may depend on."""
    packages = {package: metadata.version(package) for package in PACKAGES}
    return {"jaxnet": jaxnet.__version__, **packages, "python": platform.python_version()}


class Folder:
    """One results folder."""

    def __init__(self, path: str | Path):
        self.path = Path(path)

    @property
    def manifest(self) -> dict[str, Any]:
        """What `manifest.json` says; empty before a run."""
        file = self.path / "manifest.json"
        try:
            return json.loads(file.read_text())
        except (FileNotFoundError, NotADirectoryError):
            return {}
        except ValueError as error:
            raise FolderError(f"{file}: not a manifest: {error}") from error

    def write_manifest(self, **entries: Any) -> None:
        """Change entries of the manifest."""
        text = json.dumps(self.manifest | entries, indent=2) + "\n"
        self.put("manifest.json", lambda file: file.write_text(text))

    def put(self, name: str, write: Callable[[Path], Any]) -> None:
        """Have `write` make a file, and give it its name once it is whole and on the disk."""
        final = self.path / name
        final.parent.mkdir(parents=True, exist_ok=True)
        temporary = final.with_name(f".{final.name}.{os.getpid()}")
        try:
            write(temporary)
            with temporary.open("rb") as file:
                os.fsync(file.fileno())
            temporary.replace(final)
        finally:
            temporary.unlink(missing_ok=True)

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Hold the folder as its one writer."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            lock = (self.path / ".lock").open("a+")
        except OSError as error:
            raise FolderError(f"{self.path} cannot be a results folder: {error.strerror}") from error
        with lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                lock.seek(0)
                owner = lock.read().strip() or "another process"
                raise FolderError(f"{self.path} is being written by {owner}") from error
            lock.truncate(0)
            lock.write(f"process {os.getpid()} on {platform.node()}")
            lock.flush()
            yield

    def remove_torn(self) -> None:
        """Remove what a writer that was killed had not yet given its name."""
        files = (name for name in OURS if "." in name and not name.endswith(".zarr"))
        for name in (*(f".{name}.*" for name in files), "lanes/.*.parquet.*"):
            for torn in self.path.glob(name):
                torn.unlink()

    def clear(self, names: Sequence[str] = OURS) -> None:
        """Remove results, and nothing else."""
        for name in names:
            target = self.path / name
            if target.is_dir():
                shutil.rmtree(target)
            else:
                target.unlink(missing_ok=True)

    def admit(self, config: Config, fresh: bool = False) -> None:
        """Refuse a folder that holds another study, or one by another version, or something else.

        With `fresh`, earlier results are removed instead, and nothing but results.
        """
        manifest = self.manifest
        if not manifest:
            names = sorted(p.name for p in self.path.iterdir()) if self.path.exists() else []
            strangers = [name for name in names if not name.startswith(".") and name != "study.yaml"]
            if strangers:
                raise FolderError(f"{self.path} is not a results folder: it holds {strangers[0]}")
            return
        if fresh:
            self.clear()
            return
        if not {"versions", "hash", "save", "samples", "finished"} <= set(manifest):
            raise FolderError(f"{self.path / 'manifest.json'} is not a manifest of ours")
        remedy = "give another folder with --out, or replace its results with --fresh"
        written_by = manifest["versions"]["jaxnet"]
        if written_by != jaxnet.__version__:
            raise FolderError(
                f"{self.path} was written by jaxnet {written_by}, this is {jaxnet.__version__}; {remedy}"
            )
        if manifest["hash"] != digest(config):
            raise FolderError(f"{self.path} holds another study: {self.difference(config)}; {remedy}")

    def difference(self, config: Config) -> str:
        """Keys in which the folder's study differs from a config."""
        theirs = flat(Document.read(self.path / "study.yaml").data)
        ours = flat(plain(config))
        keys = [
            key
            for key in dict.fromkeys([*theirs, *ours])
            if key.split(".")[0] not in UNHASHED and theirs.get(key) != ours.get(key)
        ]
        if not keys:
            return "its sweep has another order"
        return ", ".join(f"{key} is {theirs.get(key)} there and {ours.get(key)} here" for key in keys[:3])

    def write_study(self, config: Config) -> None:
        """`study.yaml`, the study with every default written out, runnable as it is."""
        data = plain(config)
        ordered = {key: data[key] for key in ("name", "seed", "samples")} | data
        body = yaml.dump(ordered, Dumper=Dumper, sort_keys=False, default_flow_style=None, width=100)
        text = f"# jaxnet run study.yaml\n{body}"
        self.put("study.yaml", lambda file: file.write_text(text))

    def need(self, wanted: int) -> None:
        """Refuse to begin what the disk has no room for."""
        free = shutil.disk_usage(self.path).free
        if wanted > free:
            raise FolderError(
                f"{self.path} may need {wanted / 2**20:,.0f} MiB, and {free / 2**20:,.0f} MiB are free there:"
                " save less, take fewer samples, or give another folder with --out"
            )

    def shard(self, number: int) -> Path:
        """The row file of a shard."""
        return self.path / "lanes" / f"{number:05d}.parquet"

    def write_shard(self, number: int, rows: pa.Table, filled: dict[str, str]) -> None:
        """Write a shard's rows, and the identities of the stores that it has filled; it is done then."""
        name = str(self.shard(number).relative_to(self.path))
        rows = rows.replace_schema_metadata({FILLED: json.dumps(filled)})
        self.put(name, lambda file: pq.write_table(rows, file, compression="zstd"))

    def done(self, number: int, lanes: int, filled: dict[str, str]) -> bool:
        """Whether a shard's file is there with that many lanes, and has filled these stores."""
        file = self.shard(number)
        if not file.exists():
            return False
        about = pq.read_metadata(file)
        theirs = json.loads((about.metadata or {}).get(FILLED.encode(), b"{}"))
        return about.num_rows >= lanes and filled.items() <= theirs.items()


def flat(value: Any, prefix: str = "") -> dict[str, Any]:
    """Nested mappings as one with dotted keys."""
    if not isinstance(value, dict) or not value:
        return {prefix: value}
    joined = {}
    for key, each in value.items():
        joined |= flat(each, f"{prefix}.{key}" if prefix else str(key))
    return joined
