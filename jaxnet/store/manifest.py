"""`manifest.json` (docs/results-folder.md): what a folder's rows are of, and what made them."""

import hashlib
import json
import platform
from collections.abc import Mapping
from importlib import metadata
from typing import Annotated, NotRequired

from pydantic import Field, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from jaxnet.config.cells import to_plain
from jaxnet.config.keys import Config
from jaxnet.outside.provenance import Provenance, provenance
from jaxnet.store.looking import describe_outside
from jaxnet.version import __version__

# Keys that change no row, and those of them that tables, figures and pages show.
UNHASHED = ("name", "save", "samples", "recovery", "search", "labels")
EVALUATED = ("name", "recovery", "search", "labels")
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
    """Entries of `manifest.json`. Before a run there is none."""

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


ENTRIES = TypeAdapter(Manifest)
MANIFEST = {"versions", "hash", "save", "samples", "finished"}  # what every manifest has
# What that of a finished run has.
OF_A_RUN = {*Manifest.__annotations__} - {"kinds", "modules", "chunk", "settings", "cell_samples"}


def wrong_entry(found: object) -> str:
    """What is wrong with a manifest that jaxnet has not written; "" if nothing is."""
    if not isinstance(found, dict):
        return "it is no mapping"
    try:
        ENTRIES.validate_python(found, strict=True)
    except ValidationError as error:
        for fault in error.errors(include_url=False):
            place = fault["loc"][: -1 if fault["type"] == "missing" else None]
            if place:  # an entry may be missing, but none of its own entries
                return f"{'.'.join(map(str, place))} is {json.dumps(fault['input'])[:60]}"
    if "jaxnet" not in found.get("versions", {"jaxnet": ""}):
        return f"versions is {json.dumps(found['versions'])[:60]}"
    if found.get("finished") and (lacking := OF_A_RUN - {*found}):
        return f"it has no {min(lacking)}"
    numbers, most = found.get("cell_samples"), found.get("samples", 0)
    if numbers is not None and (
        len(numbers) != found.get("cells") or not all(0 < each <= most for each in numbers)
    ):
        return f"cell_samples is {json.dumps(numbers)[:60]}"
    return ""


def samples_of_cells(manifest: Manifest, cells: int) -> list[int]:
    """Number of samples of each of so many cells that a manifest describes; 0 before a run."""
    return manifest.get("cell_samples") or [manifest.get("samples", 0)] * cells


def manifest_entries(config: Config) -> dict[str, object]:
    named = config.scope.named_in(to_plain(config))
    return {
        "hash": digest(config),
        "versions": versions(),
        "kinds": describe_outside(config.scope.known, named, config.metrics),
        "modules": {name: made._asdict() for name, made in modules_of(config).items()},
        "save": to_plain(config.save),
        "settings": settings_of(config),
    }


def versions() -> dict[str, str]:
    packages = {package: metadata.version(package) for package in PACKAGES}
    return {"jaxnet": __version__, **packages, "python": platform.python_version()}


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


def modules_of(config: Config) -> dict[str, Provenance]:
    return provenance(config.scope.named_in(to_plain(config)))


def changed_modules(manifest: Manifest, config: Config) -> list[str]:
    theirs, ours = manifest.get("modules", {}), modules_of(config)
    return [name for name in theirs if name in ours and ours[name].sha256 != theirs[name]["sha256"]]


def settings_of(config: Config) -> dict[str, object]:
    data = to_plain(config)
    return json.loads(json.dumps({key: data[key] for key in EVALUATED}))


def changed_settings(manifest: Manifest, config: Config) -> list[str]:
    """Keys with which the tables of a folder were not made, as far as its manifest tells them."""
    made, now = manifest.get("settings"), settings_of(config)
    return [] if made is None else [key for key in EVALUATED if made.get(key) != now[key]]
