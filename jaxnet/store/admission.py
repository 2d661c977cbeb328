"""Which folders accept a study: an empty folder, or one that holds this study, written by this version."""

import json
import re
from textwrap import shorten

from jaxnet.config.cells import to_plain
from jaxnet.config.document import Document
from jaxnet.config.keys import Config
from jaxnet.store import gate, rows
from jaxnet.store.folder import (
    DERIVED,
    DERIVED_FROM,
    EVALUATED,
    MANIFEST,
    OURS,
    Folder,
    FolderError,
    Manifest,
    describe_kinds,
    digest,
    modules_of,
    settings_of,
    unhashed,
    versions,
)
from jaxnet.version import __version__

ANOTHER_FOLDER = "give another folder with --out, or replace its results with --fresh"
LANES = re.compile(r"\..*|\d{5,}\.(parquet|npz)")  # what may be in lanes/


def admit(folder: Folder, config: Config, fresh: bool = False) -> None:
    """Raise FolderError for a folder that holds another study, a study by another version, or foreign files.

    With `fresh`, remove earlier results instead, and nothing but results.
    """
    written_by, holds = version_and_hash(folder)
    if fresh:
        folder.clear()
    elif written_by not in (None, __version__):
        raise FolderError(
            f"{folder.path} was written by jaxnet {written_by}, this is {__version__}; {ANOTHER_FOLDER}"
        )
    elif holds not in (None, digest(config)):
        raise FolderError(
            f"{folder.path} holds another study{difference(folder, config)}; {ANOTHER_FOLDER}"
        )


def claim(folder: Folder, config: Config) -> None:
    """Admit a study; mark an empty folder as this study's before any run."""
    admit(folder, config)
    manifest = folder.manifest
    if not manifest or (not manifest["samples"] and changed_settings(manifest, config)):
        folder.clear(DERIVED)
        folder.write_study(config)
        folder.write_manifest(
            hash=digest(config),
            versions=versions(),
            kinds=describe_kinds(config),
            modules={name: made._asdict() for name, made in modules_of(config).items()},
            save=to_plain(config.save),
            settings=settings_of(config),
            samples=0,
            finished=False,
        )


def admit_made(folder: Folder, manifest: Manifest, config: Config) -> None:
    """Mark a folder as holding files made of the rows that a manifest describes, with a config's settings.

    Raises FolderError if the folder holds files made of other rows or settings, or cannot be written.
    """
    folder.refuse_strange()
    entries = ("hash", "samples", "cell_samples")
    rows_of: dict[str, object] = {
        each: manifest[each] for each in entries if manifest.get(each) is not None
    }
    rows_of["jaxnet"] = manifest["versions"]["jaxnet"]
    file = folder.path / DERIVED_FROM
    if file.exists():
        with gate.reading(file, "does not tell of which rows it was made"):
            made = dict(json.loads(gate.read_whole(file)))
        settings = made.pop("settings", settings_of(config))
        if made != rows_of or settings != settings_of(config):
            what = "rows" if made != rows_of else "settings"
            raise FolderError(
                f"{folder.path} holds what was made of other {what}: give another folder with --out"
            )
        return
    if taken := [name for name in OURS if (folder.path / name).exists()]:
        raise FolderError(
            f"{folder.path} holds {taken[0]} of something else: give another folder with --out"
        )
    rows_of["settings"] = settings_of(config)
    folder.put(DERIVED_FROM, lambda file: file.write((json.dumps(rows_of) + "\n").encode()))


def version_and_hash(folder: Folder) -> tuple[str | None, str | None]:
    """Return the version and the study hash of the results in a folder, or (None, None).

    Raises FolderError if the folder holds foreign files.
    """
    if manifest := folder.manifest:
        if not set(manifest) >= MANIFEST:
            raise FolderError(f"{folder.path / 'manifest.json'} is not a manifest of ours")
        return manifest["versions"]["jaxnet"], manifest["hash"]
    names = sorted(path.name for path in folder.path.iterdir()) if folder.path.exists() else []
    strangers = [
        name for name in names if not name.startswith(".") and name not in ("study.yaml", "lanes")
    ]
    if not strangers and "lanes" in names:
        inside = (path.name for path in (folder.path / "lanes").iterdir())
        strangers = [f"lanes/{name}" for name in inside if not LANES.fullmatch(name)]
    if strangers:
        raise FolderError(f"{folder.path} is not a results folder: it holds {strangers[0]}")
    stamp = rows.any_stamp(folder)
    return (stamp.jaxnet, stamp.study) if stamp else (None, None)


def difference(folder: Folder, config: Config) -> str:
    """Describe the keys in which the folder's study differs from a config; "" if its study is unknown."""
    if changed := changed_modules(folder, config):
        return f": {changed[0]} was changed since its rows were made"
    file = folder.path / "study.yaml"
    if not file.exists():
        return ""
    theirs, ours = flatten_keys(Document.read(file).data), flatten_keys(to_plain(config))
    keys = [
        key
        for key in dict.fromkeys([*theirs, *ours])
        if key.split(".")[0] not in unhashed(config) and theirs.get(key) != ours.get(key)
    ]
    if not keys:
        return ": its sweep has another order"
    apart = (
        f"{key} is {shorten_setting(theirs.get(key))} there and {shorten_setting(ours.get(key))} here"
        for key in keys[:3]
    )
    return ": " + ", ".join(apart)


def shorten_setting(value: object) -> str:
    """Return a value as text of at most 100 characters."""
    return shorten(str(value), 100, placeholder=" …")


def refuse_edited(folder: Folder, config: Config) -> None:
    """Raise FolderError where `study.yaml` is no longer the study whose rows the folder holds.

    Modules are compared apart, by `changed_modules`. Another version may hash a study otherwise.
    """
    written_by, holds = version_and_hash(folder)
    made_of = folder.manifest.get("modules", {}).items()
    modules = {name: (each["sha256"], each.get("version")) for name, each in made_of}
    if written_by == __version__ and holds not in (None, digest(config, modules)):
        raise FolderError(
            f"{folder.path}/study.yaml is not the study whose rows the folder holds: it was edited since"
        )


def changed_modules(folder: Folder, config: Config) -> list[str]:
    """Return the names of the kinds' modules that have changed since the rows were made."""
    theirs, ours = folder.manifest.get("modules", {}), modules_of(config)
    return [name for name in theirs if name in ours and ours[name].sha256 != theirs[name]["sha256"]]


def changed_settings(manifest: Manifest, config: Config) -> list[str]:
    """Return the keys with which the tables of a folder were not made, as far as its manifest tells them."""
    made, now = manifest.get("settings"), settings_of(config)
    return [] if made is None else [key for key in EVALUATED if made.get(key) != now[key]]


def flatten_keys(value: object, prefix: str = "") -> dict[str, object]:
    """Return nested mappings as one mapping with dotted keys."""
    if not isinstance(value, dict) or not value:
        return {prefix: value}
    joined = {}
    for key, each in value.items():
        joined |= flatten_keys(each, f"{prefix}.{key}" if prefix else str(key))
    return joined
