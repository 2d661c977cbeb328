"""The results folder (docs/results-folder.md): its place, its files, and its writers.

The folder is on the local disk, or in an object store at any URL that fsspec knows
(`s3://bucket/study`, `gs://…`). A file is written under a temporary name and then renamed. An
object is put whole. A reader therefore sees a whole file or none. Before each write, a process
checks that it holds the folder (`lock`).
"""

import contextlib
import io
import json
import os
import shutil
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import yaml
from upath import UPath

from jaxnet.config.cells import to_plain
from jaxnet.config.document import Yaml12Dumper
from jaxnet.config.keys import Config
from jaxnet.store import gate, lock
from jaxnet.store.gate import FolderError
from jaxnet.store.manifest import MANIFEST, Manifest, wrong_entry

# Made of the rows when asked.
DERIVED = ("fit.csv", "bounds.csv", "violations.csv", "figures", "report.html")
TABLES = ("cells.csv", "sensitivity.csv", "rare.csv", "search.csv", "worst.csv")
STORES = ("errors.zarr", "vehicles.zarr", "trajectories.zarr")
OWN_FOLDERS = ("lanes", "replays", "search", "worst")
OURS = ("study.yaml", "manifest.json", *TABLES, *STORES, *OWN_FOLDERS, "worst.yaml", *DERIVED)
# In a folder beside the results: of which rows it holds what was made.
DERIVED_FROM = "made-of.json"
GATED = frozenset((*OURS, DERIVED_FROM, ".lock", "results.mat", "csv"))  # what is read and written
# [s] in which a store must answer at first; later it may take as many tries as it likes
ANSWER = 10


class UnwrittenError(OSError, FolderError):
    """A file that cannot be written: the system's error number, a message that names the file."""

    def __str__(self) -> str:
        return str(self.strerror)


class TakenError(FolderError):
    """A folder that another process has taken over from this one."""


def config_text(config: Config, name: str) -> str:
    """A config with every default, as a YAML file of this name: a run accepts it."""
    data = to_plain(config)
    ordered = {key: data[key] for key in ("name", "seed", "samples")} | data
    body = yaml.dump(
        ordered, Dumper=Yaml12Dumper, sort_keys=False, default_flow_style=None, width=100
    )
    return f"# jaxnet run {name}\n{body}"


def place(path: str | Path | UPath) -> UPath:
    """Path of a folder on the local disk or in an object store; raise FolderError.

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
    """Raise FolderError if no store answers, access is denied, or the bucket does not exist."""
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


class Folder:
    """A results folder, and the locks under which this process or its sender writes there."""

    def __init__(self, path: str | Path | UPath, holds: tuple[lock.Hold, ...] = ()):
        self.path, self.holds = place(path), holds
        self.before: dict[str, bytes] = {}  # files that are written before any other

    def look(self) -> None:
        """Raise TakenError unless this process still has all its locks."""
        for hold in self.holds:
            if why := hold.lost():
                told = "this process writes no more; what it has written stays"
                raise TakenError(f"{hold.file.parent} {why}: {told}")

    @property
    def manifest(self) -> Manifest:
        """Content of `manifest.json`; empty before a run."""
        file = self.path / "manifest.json"
        try:
            with gate.reading(file, "is not a manifest"):
                found = json.loads(gate.read_whole(file))
        except (FileNotFoundError, NotADirectoryError):
            return cast(Manifest, {})
        if wrong := wrong_entry(found):
            raise FolderError(f"{file}: not a manifest of ours: {wrong}")
        return found

    def refuse_strange(self) -> None:
        gate.refuse_strange(self.path, GATED)

    def write_manifest(self, **entries: object) -> None:
        text = json.dumps(self.manifest | entries, indent=2) + "\n"
        self.put("manifest.json", text.encode())

    def write_study(self, config: Config) -> None:
        self.put("study.yaml", config_text(config, "study.yaml").encode())

    def put(self, name: str, content: bytes | Callable[[Any], object]) -> UPath:
        """Write a file, which gets its name once it is whole and on the disk.

        `content` may be a function that writes into the open file. Raises TakenError if another
        process holds the folder by then, and UnwrittenError.
        """
        final = self.path / name

        def write(file: Any) -> None:
            content(file) if callable(content) else file.write(content)

        with self.naming(name):
            if isinstance(final, Path):
                self.put_on_disk(final, write)
            else:
                held = io.BytesIO()
                write(held)
                self.look()
                final.fs.pipe_file(final.path, held.getvalue())
        return final

    def put_on_disk(self, final: Path, write: Callable[[Any], None]) -> None:
        if not final.parent.resolve().is_relative_to(Path(str(self.path)).resolve()):
            told = f"is a link out of {self.path}, and nothing is written through it"
            raise FolderError(f"{final.parent} {told}")
        final.parent.mkdir(parents=True, exist_ok=True)
        temporary = final.with_name(f".{final.name}.{uuid.uuid4().hex[:8]}")
        try:
            with temporary.open("wb") as file:
                write(file)
                file.flush()
                os.fsync(file.fileno())
            self.look()
            temporary.rename(final)
        finally:
            with contextlib.suppress(OSError):  # where nothing can be written or removed
                temporary.unlink(missing_ok=True)

    @contextlib.contextmanager
    def naming(self, name: str) -> Iterator[None]:
        """Write a file or store: an OSError within becomes an UnwrittenError that names it.

        Raises TakenError if another process holds the folder before or after the error.
        """
        while self.before:
            self.put(*self.before.popitem())
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

        Each write within the context checks the lock. Raises FolderError if another process holds
        the folder, or the folder cannot be written.
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
            except FileNotFoundError:  # perhaps as the folder was removed
                self.look()
                raise
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

    def remove(self, *names: str) -> None:
        for name in names:
            target = self.path / name
            self.look()
            if target.is_dir():
                target.fs.rm(target.path, recursive=True)
            else:
                target.unlink(missing_ok=True)

    def need(self, wanted: int) -> None:
        """Raise FolderError if the disk has fewer bytes of room."""
        if not isinstance(self.path, Path):
            return
        free = shutil.disk_usage(self.path).free
        if wanted > free:
            sizes = (
                f"may need {wanted / 2**20:,.0f} MiB, and {free / 2**20:,.0f} MiB are free there"
            )
            advice = "save less, take fewer samples, or give another folder with --out"
            raise FolderError(f"{self.path} {sizes}: {advice}")


def find_results(root: str | Path | UPath) -> Iterator[tuple[UPath, Manifest]]:
    """Yield the results folders at or below a folder, sorted by name, and their manifests.

    The search does not enter a results folder, nor a folder twice, whatever links lead there. The
    manifest is empty unless jaxnet has written it, as where only parts of a run exist.
    """
    ahead, entered = [place(root)], set[Path]()
    while ahead:
        path, manifest = ahead.pop(), cast(Manifest, {})
        with contextlib.suppress(FolderError):
            found = Folder(path).manifest
            manifest = found if {*found} >= MANIFEST else manifest
        if manifest or any(path.glob("lanes/*.parquet")):
            yield path, manifest
        elif path.is_dir() and not (isinstance(path, Path) and path.resolve() in entered):
            entered |= {path.resolve()} if isinstance(path, Path) else set()
            inside = [each for each in path.iterdir() if each.is_dir() and each.name[0] != "."]
            ahead += sorted(inside, key=lambda each: each.name, reverse=True)
