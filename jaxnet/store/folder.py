"""The results folder (docs/results-folder.md): its place, its files, and its writers.

The folder is on the local disk, or in an object store at any URL that fsspec knows (`s3://bucket/study`,
`gs://…`). A file is written under a temporary name and then renamed. An object is put whole. A reader
therefore sees a whole file or none. Before each write, a process checks that it holds the folder (`lock`).
"""

import contextlib
import hashlib
import io
import json
import os
import platform
import shutil
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, BinaryIO, TypedDict, cast

import yaml
from upath import UPath

from jaxnet.config.cells import to_plain
from jaxnet.config.document import Yaml12Dumper
from jaxnet.config.keys import Config
from jaxnet.outside.provenance import Provenance, provenance
from jaxnet.store import gate, lock
from jaxnet.store.gate import FolderError
from jaxnet.store.looking import describe_outside
from jaxnet.version import __version__

UNHASHED = ("name", "save", "samples", "recovery", "search", "labels")  # keys that change no row
EVALUATED = (
    "name",
    "recovery",
    "search",
    "labels",
)  # those of them that tables, figures and pages show
DERIVED = (
    "fit.csv",
    "bounds.csv",
    "violations.csv",
    "figures",
    "report.html",
)  # from rows, made when asked
OURS = (
    "study.yaml",
    "manifest.json",
    "cells.csv",
    "sensitivity.csv",
    "lanes",
    "errors.zarr",
    "vehicles.zarr",
    "trajectories.zarr",
    "replays",
    "rare.csv",
    "search",
    "search.csv",
    "worst",
    "worst.csv",
    "worst.yaml",
    *DERIVED,
)
DERIVED_FROM = (
    "made-of.json"  # in a folder beside the results: of which rows it holds what was made
)
GATED = frozenset(
    (*OURS, DERIVED_FROM, ".lock", "results.mat", "csv")
)  # what jaxnet reads and writes
ANSWER = (
    10  # [s] in which a store must answer at first; later it may take as many tries as it likes
)
PACKAGES = ("jax", "jaxlib", "diffrax", "numpy")


class LaneCounts(TypedDict):
    """Numbers of lanes in a finished folder."""

    total: int
    ok: int
    failed: int


class Manifest(TypedDict):
    """Entries of `manifest.json` (docs/results-folder.md). A folder before its first run has none of them."""

    hash: str  # of the study
    seed: int
    versions: dict[str, str]  # by package
    kinds: dict[str, dict[str, object]]  # descriptions of kinds from outside
    modules: dict[str, dict[str, str]]  # provenance of kinds from outside
    device: str
    chunk: int | None  # lanes side by side; None suits the engine
    cells: int
    samples: int  # of each cell; where these numbers differ, the greatest
    cell_samples: list[int] | None  # of each cell where these numbers differ, else None
    shard_size: int  # samples of a whole shard
    save: dict[str, object]
    settings: dict[str, object]  # with which tables, figures and pages are made
    finished: bool
    lanes: LaneCounts
    wall_seconds: float


class UnwrittenError(OSError, FolderError):
    """A file that cannot be written, with the system's error number and a message that names the file."""

    def __str__(self) -> str:
        """Return the message without the error number."""
        return str(self.strerror)


class TakenError(FolderError):
    """A folder that another process has taken over from this one."""


def unhashed(config: Config) -> tuple[str, ...]:
    """Return the keys that change no row. The number of samples changes rows only if draws are not random."""
    return (
        UNHASHED if config.draws == "random" else tuple(key for key in UNHASHED if key != "samples")
    )


def digest(config: Config, modules: Mapping[str, tuple[str, str | None]] | None = None) -> str:
    """Return the hash of all that changes rows: the config, and the modules of kinds from outside.

    `modules` are the hash and the version of each module, by default of the modules as they are now.
    """
    data = to_plain(config)
    kept = {key: value for key, value in data.items() if key not in unhashed(config)}
    if modules is None:
        modules = {name: (each.sha256, each.version) for name, each in modules_of(config).items()}
    if modules:
        kept["modules"] = modules
    kept["sweep"] = list(kept["sweep"].items())  # its order numbers the cells
    return hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()


def settings_of(config: Config) -> dict[str, object]:
    """Return the keys that change no row, but tables, figures and pages, as JSON data."""
    data = to_plain(config)
    return json.loads(json.dumps({key: data[key] for key in EVALUATED}))


def modules_of(config: Config) -> dict[str, Provenance]:
    """Return the provenance of the kinds from outside that a config names, by module."""
    return provenance(config.scope.named_in(to_plain(config)))


def describe_kinds(config: Config) -> dict[str, dict[str, object]]:
    """Return the manifest's description of the kinds from outside that a config names."""
    return describe_outside(config.scope.known, config.scope.named_in(to_plain(config)))


def samples_of_cells(manifest: Manifest, cells: int) -> list[int]:
    """Return the number of samples of each of so many cells that a manifest describes; 0 before a run."""
    return manifest.get("cell_samples") or [manifest.get("samples", 0)] * cells


def versions() -> dict[str, str]:
    """Return the versions of the packages on which rows may depend."""
    packages = {package: metadata.version(package) for package in PACKAGES}
    return {"jaxnet": __version__, **packages, "python": platform.python_version()}


def place(path: str | Path | UPath) -> UPath:
    """Return the path of a folder on the local disk or in an object store; raise FolderError.

    Listings are not cached, since other processes write there too.
    """
    try:
        found = UPath(path)
        if found.protocol in ("", "file", "local"):
            return found if isinstance(found, Path) else UPath(found.path)
        ours = found.storage_options.get("use_listings_cache") is False
        found = UPath(found, use_listings_cache=False)
        _ = found.fs
    except (ImportError, ValueError) as error:  # no such protocol, or its package is not installed
        raise FolderError(f"{path}: {error}") from error
    if not ours:
        reach(found)
    return found


def reach(path: UPath) -> None:
    """Raise FolderError if no store answers at a URL, access is denied, or the bucket does not exist."""
    root = path.parents[-1] if path.parents else path
    patience = {"timeout": ANSWER} if path.fs.async_impl else {}
    try:
        try:
            path.fs.info(path.path, **patience)
        except FileNotFoundError:
            with contextlib.suppress(PermissionError):  # of who may use but a part of a bucket
                path.fs.info(root.path, **patience)
    except FileNotFoundError as error:
        raise FolderError(f"{path}: there is no {root}") from error
    except TimeoutError as error:
        raise FolderError(f"{path}: no answer within {ANSWER} s") from error
    except Exception as error:  # each file system has its own
        raise FolderError(f"{path}: {error}") from error


def put_file(
    root: Path, final: Path, write: Callable[[BinaryIO], object], look: Callable[[], None]
) -> None:
    """Write a file under a temporary name, look, and rename it."""
    if not final.parent.resolve().is_relative_to(root.resolve()):
        raise FolderError(
            f"{final.parent} is a link out of {root}, and nothing is written through it"
        )
    final.parent.mkdir(parents=True, exist_ok=True)
    temporary = final.with_name(f".{final.name}.{uuid.uuid4().hex[:8]}")
    try:
        with temporary.open("wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        look()
        temporary.rename(final)
    finally:
        with contextlib.suppress(OSError):  # where nothing can be written, nothing can be removed
            temporary.unlink(missing_ok=True)


ENTRIES: dict[str, Any] = {  # of a manifest, and their types
    "hash": str,
    "seed": int,
    "versions": {"jaxnet": str},
    "kinds": dict,
    "modules": dict,
    "device": str,
    "chunk": int,
    "cells": int,
    "samples": int,
    "shard_size": int,
    "save": dict,
    "settings": dict,
    "finished": bool,
    "lanes": {"total": int, "ok": int, "failed": int},
    "wall_seconds": float,
}
MOST = {"seed": 2**64, "chunk": 2**32, "samples": 2**32, "cells": 10**6, "shard_size": 2**20}
MANIFEST = {"versions", "hash", "save", "samples", "finished"}  # what every manifest has
OF_A_RUN = {*ENTRIES} - {"kinds", "modules", "chunk", "settings"}  # what that of a finished run has


def wrong_entries(found: object) -> Iterator[str]:
    """Yield what is wrong with a manifest that jaxnet has not written."""
    if not isinstance(found, dict):
        yield "it is no mapping"
        return
    for name, kind in ENTRIES.items():
        value: Any = found.get(name)
        number = value if name in MOST else 0
        if value is not None and not (has_type(value, kind) and 0 <= number <= MOST.get(name, 0)):
            yield f"{name} is {json.dumps(value)[:60]}"
    for name in ("shard_size", "chunk"):
        if found.get(name) == 0:
            yield f"{name} is 0"
    if found.get("finished") and (lacking := OF_A_RUN - {*found}):
        yield f"it has no {min(lacking)}"
    if not are_samples(found.get("cell_samples"), found):
        yield f"cell_samples is {json.dumps(found['cell_samples'])[:60]}"
    for name, made in found.get("modules", {}).items():
        if not has_type(made, {"file": str, "sha256": str}):
            yield f"modules.{name} is {json.dumps(made)[:60]}"


def are_samples(numbers: object, manifest: dict[str, Any]) -> bool:
    """Return whether an entry is None, or the number of samples of each cell, at most `samples`."""
    if numbers is None:
        return True
    if not isinstance(numbers, list) or len(numbers) != manifest.get("cells"):
        return False
    return all(type(each) is int and 0 < each <= manifest.get("samples", 0) for each in numbers)


def has_type(value: object, kind: type | dict[str, type]) -> bool:
    """Return whether a value has a type, or is a mapping whose values have these types."""
    if isinstance(kind, dict):
        return isinstance(value, dict) and all(
            has_type(value.get(key), each) for key, each in kind.items()
        )
    return type(value) is kind or (kind is float and type(value) is int)


class Folder:
    """A results folder, and the locks under which this process or its sender writes there."""

    def __init__(self, path: str | Path | UPath, holds: tuple[lock.Hold, ...] = ()):
        self.path, self.holds = place(path), holds

    def absolute(self) -> "Folder":
        """Return the folder with an absolute path and these locks, for another process."""
        return Folder(self.path.absolute(), self.holds)

    def inside(self, name: str) -> "Folder":
        """Return a folder inside this one, under equal locks."""
        return Folder(self.path / name, self.holds)

    def look(self) -> None:
        """Raise TakenError unless this process still has all its locks."""
        for hold in self.holds:
            if why := hold.lost():
                raise TakenError(
                    f"{hold.file.parent} {why}: this process writes no more; what it has written stays"
                )

    @property
    def manifest(self) -> Manifest:
        """Content of `manifest.json`; empty before a run."""
        file = self.path / "manifest.json"
        try:
            with gate.reading(file, "is not a manifest"):
                found = json.loads(gate.read_whole(file))
        except (FileNotFoundError, NotADirectoryError):
            return cast(Manifest, {})
        if wrong := next(wrong_entries(found), ""):
            raise FolderError(f"{file}: not a manifest of ours: {wrong}")
        return found

    def refuse_strange(self) -> None:
        """Raise FolderError if a link, a pipe or a device has the place of a file or folder of ours."""
        gate.refuse_strange(self.path, GATED)

    def write_manifest(self, **entries: object) -> None:
        """Change entries of the manifest."""
        text = json.dumps(self.manifest | entries, indent=2) + "\n"
        self.put("manifest.json", lambda file: file.write(text.encode()))

    def put(self, name: str, write: Callable[[BinaryIO], object]) -> UPath:
        """Have `write` write a file, which gets its name once it is whole and on the disk; return its path.

        Raises TakenError if another process holds the folder by then, and UnwrittenError.
        """
        final = self.path / name
        with self.naming(name):
            if isinstance(final, Path):
                put_file(Path(str(self.path)), final, write, self.look)
            else:
                content = io.BytesIO()
                write(content)
                self.look()
                final.fs.pipe_file(final.path, content.getvalue())
        return final

    @contextlib.contextmanager
    def naming(self, name: str) -> Iterator[None]:
        """Write a file or store: an OSError within becomes an UnwrittenError that names it.

        Raises TakenError if another process holds the folder before or after the error.
        """
        self.look()
        try:
            yield
        except OSError as error:
            self.look()
            reason = f"cannot write {self.path / name}: {error.strerror or error}"
            raise UnwrittenError(error.errno, reason) from error

    @contextlib.contextmanager
    def writing(self, alone: bool = True) -> Iterator[None]:
        """Hold the folder, as its only writer or as one of several writers of shards.

        Each write within the context checks the lock. Raises FolderError if another process holds the folder,
        or the folder cannot be written.
        """
        before = self.holds
        self.refuse_strange()
        with contextlib.ExitStack() as stack:
            try:
                hold = stack.enter_context(lock.hold_folder(self.path, alone))
            except lock.HeldError as error:
                raise FolderError(f"{self.path} is being written by {error}") from error
            except (OSError, NotImplementedError) as error:
                reason = getattr(error, "strerror", None) or error
                raise FolderError(
                    f"{self.path} cannot be written to: {reason}; give another folder with --out"
                ) from error
            self.holds = (*before, hold)
            try:
                yield
            finally:
                self.holds = before

    def remove_torn(self) -> None:
        """Remove the temporary files of a killed writer; an object store has none."""
        if not isinstance(self.path, Path):
            return
        files = (name for name in OURS if "." in name and not name.endswith(".zarr"))
        self.look()
        for name in (*(f".{name}.*" for name in files), "lanes/.*.*.*"):
            for torn in self.path.glob(name):
                torn.unlink(missing_ok=True)

    def clear(self, names: Sequence[str] = OURS) -> None:
        """Remove these results and nothing else."""
        for name in names:
            self.remove(name)

    def remove(self, name: str) -> None:
        """Remove a file, or a folder with its content; do nothing if it does not exist."""
        target = self.path / name
        self.look()
        if target.is_dir():
            target.fs.rm(target.path, recursive=True)
        else:
            target.unlink(missing_ok=True)

    def write_study(self, config: Config) -> None:
        """Write `study.yaml`: the study with every default, which a run accepts as a config."""
        data = to_plain(config)
        ordered = {key: data[key] for key in ("name", "seed", "samples")} | data
        body = yaml.dump(
            ordered, Dumper=Yaml12Dumper, sort_keys=False, default_flow_style=None, width=100
        )
        text = f"# jaxnet run study.yaml\n{body}"
        self.put("study.yaml", lambda file: file.write(text.encode()))

    def need(self, wanted: int) -> None:
        """Raise FolderError if the disk has fewer free bytes than `wanted`; object stores have no limit."""
        if not isinstance(self.path, Path):
            return
        free = shutil.disk_usage(self.path).free
        if wanted > free:
            raise FolderError(
                f"{self.path} may need {wanted / 2**20:,.0f} MiB, and {free / 2**20:,.0f} MiB are free there:"
                " save less, take fewer samples, or give another folder with --out"
            )
