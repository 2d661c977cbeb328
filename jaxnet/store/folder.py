"""The results folder (docs/results-folder.md): its place, its files, its manifest, and its writers.

The folder is on the local disk, or in an object store at any URL that fsspec knows
(`s3://bucket/study`, `gs://…`). A file is written under a temporary name and then renamed. An
object is put whole. A reader therefore sees a whole file or none. Before each write, a process
checks that it holds the folder (`lock`).
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
from typing import Annotated, BinaryIO, NotRequired, cast, get_type_hints

import yaml
from pydantic import Field, TypeAdapter, ValidationError
from typing_extensions import TypedDict
from upath import UPath

from jaxnet.config.cells import to_plain
from jaxnet.config.document import Yaml12Dumper
from jaxnet.config.keys import Config
from jaxnet.outside.provenance import Provenance, provenance
from jaxnet.store import gate, lock
from jaxnet.store.gate import FolderError
from jaxnet.store.looking import describe_outside
from jaxnet.version import __version__

# Keys that change no row, and those of them that tables, figures and pages show.
UNHASHED = ("name", "save", "samples", "recovery", "search", "labels")
EVALUATED = ("name", "recovery", "search", "labels")
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
PACKAGES = ("jax", "jaxlib", "diffrax", "numpy")
MOST_SHARD = 2**20  # samples of a shard


class LaneCounts(TypedDict):
    total: int
    ok: int
    failed: int


class ModuleEntry(TypedDict):
    file: str
    sha256: str
    version: NotRequired[str | None]


class Manifest(TypedDict):
    """Entries of `manifest.json` (docs/results-folder.md). Before a run there is none."""

    hash: str  # of the study
    seed: Annotated[int, Field(ge=0, le=2**64)]
    versions: dict[str, str]  # by package
    kinds: dict[str, dict[str, object]]  # descriptions of kinds from outside
    modules: dict[str, ModuleEntry]  # provenance of kinds from outside
    device: str
    chunk: Annotated[int, Field(gt=0, le=2**32)] | None  # lanes side by side; None suits the engine
    cells: Annotated[int, Field(ge=0, le=10**6)]
    samples: Annotated[int, Field(ge=0, le=2**32)]  # of each cell; where they differ, the greatest
    cell_samples: list[int] | None  # of each cell where these numbers differ
    shard_size: Annotated[int, Field(gt=0, le=MOST_SHARD)]  # samples of a whole shard
    save: dict[str, object]
    settings: dict[str, object]  # with which tables, figures and pages are made
    finished: bool
    lanes: LaneCounts
    wall_seconds: float


ENTRIES = {
    name: TypeAdapter[object](kind | None)  # pyright: ignore[reportArgumentType]
    for name, kind in get_type_hints(Manifest, include_extras=True).items()
}
MANIFEST = {"versions", "hash", "save", "samples", "finished"}  # what every manifest has
# What that of a finished run has.
OF_A_RUN = {*ENTRIES} - {"kinds", "modules", "chunk", "settings", "cell_samples"}


def wrong_entry(found: object) -> str:
    """What is wrong with a manifest that jaxnet has not written; "" if nothing is."""
    if not isinstance(found, dict):
        return "it is no mapping"
    for name, kind in ENTRIES.items():
        try:
            kind.validate_python(found.get(name), strict=True)
        except ValidationError as error:
            fault = error.errors(include_url=False)[0]
            inner = fault["loc"][: -1 if fault["type"] == "missing" else None]
            where = ".".join(map(str, (name, *inner)))
            return f"{where} is {json.dumps(fault['input'])[:60]}"
    if "jaxnet" not in (found.get("versions") or {"jaxnet": ""}):
        return f"versions is {json.dumps(found['versions'])[:60]}"
    if found.get("finished") and (lacking := OF_A_RUN - {*found}):
        return f"it has no {min(lacking)}"
    numbers, most = found.get("cell_samples"), found.get("samples") or 0
    if numbers is not None and (
        len(numbers) != found.get("cells") or not all(0 < each <= most for each in numbers)
    ):
        return f"cell_samples is {json.dumps(numbers)[:60]}"
    return ""


class UnwrittenError(OSError, FolderError):
    """A file that cannot be written: the system's error number, a message that names the file."""

    def __str__(self) -> str:
        return str(self.strerror)


class TakenError(FolderError):
    """A folder that another process has taken over from this one."""


def unhashed(config: Config) -> tuple[str, ...]:
    """Keys that change no row. The number of samples changes rows only if draws are not random."""
    return tuple(key for key in UNHASHED if key != "samples" or config.draws == "random")


def digest(config: Config, modules: Mapping[str, tuple[str, str | None]] | None = None) -> str:
    """Hash of all that changes rows: the config, and the modules of kinds from outside.

    `modules` are the hash and version of each module, by default of the modules as now.
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
    data = to_plain(config)
    return json.loads(json.dumps({key: data[key] for key in EVALUATED}))


def modules_of(config: Config) -> dict[str, Provenance]:
    return provenance(config.scope.named_in(to_plain(config)))


def manifest_entries(config: Config) -> dict[str, object]:
    """Entries of a manifest that a config and the installed packages determine."""
    return {
        "hash": digest(config),
        "versions": versions(),
        "kinds": describe_outside(config.scope.known, config.scope.named_in(to_plain(config))),
        "modules": {name: made._asdict() for name, made in modules_of(config).items()},
        "save": to_plain(config.save),
        "settings": settings_of(config),
    }


def versions() -> dict[str, str]:
    packages = {package: metadata.version(package) for package in PACKAGES}
    return {"jaxnet": __version__, **packages, "python": platform.python_version()}


def samples_of_cells(manifest: Manifest, cells: int) -> list[int]:
    """Number of samples of each of so many cells that a manifest describes; 0 before a run."""
    return manifest.get("cell_samples") or [manifest.get("samples", 0)] * cells


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


def put_file(
    root: Path, final: Path, write: Callable[[BinaryIO], object], look: Callable[[], None]
) -> None:
    if not final.parent.resolve().is_relative_to(root.resolve()):
        told = f"is a link out of {root}, and nothing is written through it"
        raise FolderError(f"{final.parent} {told}")
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


class Folder:
    """A results folder, and the locks under which this process or its sender writes there."""

    def __init__(self, path: str | Path | UPath, holds: tuple[lock.Hold, ...] = ()):
        self.path, self.holds = place(path), holds

    def absolute(self) -> "Folder":
        """The folder with an absolute path and these locks, for another process."""
        return Folder(self.path.absolute(), self.holds)

    def inside(self, name: str) -> "Folder":
        return Folder(self.path / name, self.holds)

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
        self.put("manifest.json", lambda file: file.write(text.encode()))

    def put(self, name: str, write: Callable[[BinaryIO], object]) -> UPath:
        """Have `write` write a file, which gets its name once it is whole and on the disk.

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
        text = config_text(config, "study.yaml")
        self.put("study.yaml", lambda file: file.write(text.encode()))

    def need(self, wanted: int) -> None:
        if not isinstance(self.path, Path):
            return
        free = shutil.disk_usage(self.path).free
        if wanted > free:
            sizes = (
                f"may need {wanted / 2**20:,.0f} MiB, and {free / 2**20:,.0f} MiB are free there"
            )
            advice = "save less, take fewer samples, or give another folder with --out"
            raise FolderError(f"{self.path} {sizes}: {advice}")


def find_results(
    root: str | Path | UPath, entered: set[Path] | None = None
) -> Iterator[tuple[UPath, Manifest]]:
    """Yield the results folders at or below a folder, sorted by name, and their manifests.

    The search does not enter a results folder, nor a folder twice, whatever links lead there. The
    manifest is empty unless jaxnet has written it, as where only parts of a run exist.
    """
    folder, entered = Folder(root), set() if entered is None else entered
    path, manifest = folder.path, cast(Manifest, {})
    with contextlib.suppress(FolderError):
        manifest = folder.manifest if {*folder.manifest} >= MANIFEST else manifest
    if manifest or any(path.glob("lanes/*.parquet")):
        yield path, manifest
    elif path.is_dir():
        if isinstance(path, Path):
            if (here := path.resolve()) in entered:
                return
            entered.add(here)
        inside = (each for each in path.iterdir() if each.is_dir() and each.name[0] != ".")
        for each in sorted(inside, key=lambda each: each.name):
            yield from find_results(each, entered)
