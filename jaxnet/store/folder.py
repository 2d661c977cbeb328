"""The results folder (docs/results-folder.md): where it is, what belongs to whom, and who may write.

It is on the local disk, or in an object store at any URL that fsspec knows (`s3://bucket/study`, `gs://…`).
A file is written under a temporary name and then renamed, an object is put whole, so a reader sees it whole
or not at all. Who holds the folder is read before each write (`lock`).
"""

import contextlib
import hashlib
import io
import json
import os
import platform
import shutil
import uuid
from collections.abc import Callable, Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, BinaryIO

import yaml
from upath import UPath

import jaxnet
from jaxnet.config.cells import to_plain
from jaxnet.config.keys import Config
from jaxnet.config.yaml12 import Yaml12Dumper
from jaxnet.kinds.provenance import Provenance, provenance
from jaxnet.store import lock
from jaxnet.store.looking import described

UNHASHED = ("name", "save", "samples", "recovery", "search")  # keys that change no row
DERIVED = ("fit.csv", "bounds.csv", "violations.csv", "figures", "report.html")  # from rows, made when asked
OURS = (
    "study.yaml",
    "manifest.json",
    "cells.csv",
    "sensitivity.csv",
    "lanes",
    "errors.zarr",
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
ANSWER = 10  # [s] in which a store must answer at first; later it may take as many tries as it likes
PACKAGES = ("jax", "jaxlib", "diffrax", "numpy")


class FolderError(ValueError):
    """A results folder that cannot be used for what was asked."""


class UnwrittenError(OSError, FolderError):
    """A file that cannot be written, with the system's error number and a message that names the file."""

    def __str__(self) -> str:
        """The message alone."""
        return str(self.strerror)


class TakenError(FolderError):
    """A folder that this process held, and may not write to any more."""


def unhashed(config: Config) -> tuple[str, ...]:
    """Keys that change no row: of Sobol's sequences the number of samples does."""
    return UNHASHED if config.draws == "random" else tuple(key for key in UNHASHED if key != "samples")


def digest(config: Config) -> str:
    """Hash of everything in a config that changes rows, and of what kinds from outside are made of."""
    data = to_plain(config)
    kept = {key: value for key, value in data.items() if key not in unhashed(config)}
    if made_of := made_from(config):
        kept["modules"] = {module: (each.sha256, each.version) for module, each in made_of.items()}
    kept["sweep"] = list(kept["sweep"].items())  # its order numbers the cells
    return hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()


def made_from(config: Config) -> dict[str, Provenance]:
    """What the kinds from outside that a config names are made of, by module."""
    return provenance(config.scope.named_in(to_plain(config)))


def said_of_kinds(config: Config) -> dict[str, Any]:
    """What the manifest says of the kinds from outside that a config names."""
    return described(config.scope.known, config.scope.named_in(to_plain(config)))


def versions() -> dict[str, str]:
    """Versions of what the rows may depend on."""
    packages = {package: metadata.version(package) for package in PACKAGES}
    return {"jaxnet": jaxnet.__version__, **packages, "python": platform.python_version()}


def place(path: str | Path | UPath) -> UPath:
    """Where a folder is: a path of the local disk, or an object store's URL; raises FolderError.

    What is listed there is looked up each time, for other processes write there too.
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
    """Raise FolderError if nothing answers at a URL, we may not look there, or there is no such bucket."""
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


def put_file(final: Path, write: Callable[[BinaryIO], Any], look: Callable[[], None]) -> None:
    """Have a file written under a temporary name, and rename it after a look."""
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
    "versions": dict,
    "kinds": dict,
    "modules": dict,
    "device": str,
    "cells": int,
    "samples": int,
    "shard_size": int,
    "save": dict,
    "finished": bool,
    "lanes": {"total": int, "ok": int, "failed": int},
    "wall_seconds": float,
}
MOST = {"samples": 2**32, "cells": 10**6, "shard_size": 2**32}


def wrong_entries(found: Any) -> Iterator[str]:
    """What is wrong with a manifest, if it was not written by us."""
    if not isinstance(found, dict):
        yield "it is no mapping"
        return
    for name, kind in ENTRIES.items():
        value: Any = found.get(name)
        number = value if name in MOST else 0
        if value is not None and not (is_of(value, kind) and 0 <= number <= MOST.get(name, 0)):
            yield f"{name} is {json.dumps(value)[:60]}"
    if found.get("shard_size") == 0:
        yield "shard_size is 0"
    for name, made in found.get("modules", {}).items():
        if not is_of(made, {"file": str, "sha256": str}):
            yield f"modules.{name} is {json.dumps(made)[:60]}"


def is_of(value: Any, kind: Any) -> bool:
    """Whether a value is of a type, or is a mapping with values of these types."""
    if isinstance(kind, dict):
        return isinstance(value, dict) and all(is_of(value.get(key), each) for key, each in kind.items())
    return type(value) is kind or (kind is float and type(value) is int)


class Folder:
    """One results folder, and the locks under which this process, or who sent it here, writes to it."""

    def __init__(self, path: str | Path | UPath, holds: tuple[lock.Hold, ...] = ()):
        self.path, self.holds = place(path), holds

    def absolute(self) -> "Folder":
        """The same folder, under the same locks, for a process that runs elsewhere."""
        return Folder(self.path.absolute(), self.holds)

    def inside(self, name: str) -> "Folder":
        """A folder in this one, under the same locks."""
        return Folder(self.path / name, self.holds)

    def look(self) -> None:
        """Raise TakenError unless all locks are still there under which this process writes."""
        for hold in self.holds:
            if why := hold.lost():
                raise TakenError(
                    f"{hold.file.parent} {why}: this process writes no more; what it has written stays"
                )

    @property
    def manifest(self) -> dict[str, Any]:
        """What `manifest.json` says; empty before a run."""
        file = self.path / "manifest.json"
        try:
            found = json.loads(file.fs.cat_file(file.path))  # at once: it may be rewritten meanwhile
        except (FileNotFoundError, NotADirectoryError):
            return {}
        except (ValueError, RecursionError) as error:
            raise FolderError(f"{file}: not a manifest: {error}") from error
        if wrong := next(wrong_entries(found), ""):
            raise FolderError(f"{file}: not a manifest of ours: {wrong}")
        return found

    def write_manifest(self, **entries: Any) -> None:
        """Change entries of the manifest."""
        text = json.dumps(self.manifest | entries, indent=2) + "\n"
        self.put("manifest.json", lambda file: file.write(text.encode()))

    def put(self, name: str, write: Callable[[BinaryIO], Any]) -> UPath:
        """Have `write` make a file that has its name once it is whole and on the disk; its path.

        Raises TakenError if another process holds the folder by then, and UnwrittenError.
        """
        final = self.path / name
        self.look()
        try:
            if isinstance(final, Path):
                put_file(final, write, self.look)
            else:
                content = io.BytesIO()
                write(content)
                self.look()
                final.fs.pipe_file(final.path, content.getvalue())
        except OSError as error:
            self.look()
            reason = f"cannot write {final}: {error.strerror or error}"
            raise UnwrittenError(error.errno, reason) from error
        return final

    @contextlib.contextmanager
    def writing(self, alone: bool = True) -> Iterator[None]:
        """Hold the folder, as its one writer or as one of those that write some shards each.

        Meanwhile each write looks whether it still does. Raises FolderError if another process holds it, or
        nothing can be written there.
        """
        before = self.holds
        with contextlib.ExitStack() as stack:
            try:
                hold = stack.enter_context(lock.held(self.path, alone))
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
        """Remove what a writer that was killed had not yet given its name; objects have theirs at once."""
        if not isinstance(self.path, Path):
            return
        files = (name for name in OURS if "." in name and not name.endswith(".zarr"))
        self.look()
        for name in (*(f".{name}.*" for name in files), "lanes/.*.*.*"):
            for torn in self.path.glob(name):
                torn.unlink(missing_ok=True)

    def clear(self, names: Sequence[str] = OURS) -> None:
        """Remove results, and nothing else."""
        for name in names:
            self.remove(name)

    def remove(self, name: str) -> None:
        """Remove a file, or a folder with all that is in it, if it is there."""
        target = self.path / name
        self.look()
        if target.is_dir():
            target.fs.rm(target.path, recursive=True)
        else:
            target.unlink(missing_ok=True)

    def write_study(self, config: Config) -> None:
        """`study.yaml`, the study with every default written out, runnable as it is."""
        data = to_plain(config)
        ordered = {key: data[key] for key in ("name", "seed", "samples")} | data
        body = yaml.dump(ordered, Dumper=Yaml12Dumper, sort_keys=False, default_flow_style=None, width=100)
        text = f"# jaxnet run study.yaml\n{body}"
        self.put("study.yaml", lambda file: file.write(text.encode()))

    def need(self, wanted: int) -> None:
        """Refuse to begin what the disk has no room for; where it is no disk, nothing is known of room."""
        if not isinstance(self.path, Path):
            return
        free = shutil.disk_usage(self.path).free
        if wanted > free:
            raise FolderError(
                f"{self.path} may need {wanted / 2**20:,.0f} MiB, and {free / 2**20:,.0f} MiB are free there:"
                " save less, take fewer samples, or give another folder with --out"
            )
