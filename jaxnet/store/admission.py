"""Which folders a study may go into: an empty one, or one that holds the same study, by the same version."""

import json
import re
from textwrap import shorten
from typing import Any

import jaxnet
from jaxnet.config.cells import to_plain
from jaxnet.config.document import Document
from jaxnet.config.keys import Config
from jaxnet.store import rows
from jaxnet.store.folder import (
    OURS,
    Folder,
    FolderError,
    digest,
    made_from,
    said_of_kinds,
    unhashed,
    versions,
)

MANIFEST = {"versions", "hash", "save", "samples", "finished"}  # what every manifest has
REMEDY = "give another folder with --out, or replace its results with --fresh"
MADE_OF = "made-of.json"  # in a folder beside the results: of which rows it holds what was made
LANES = re.compile(r"\..*|\d{5,}\.(parquet|npz)")  # what may be in lanes/


def admit(folder: Folder, config: Config, fresh: bool = False) -> None:
    """Refuse a folder that holds another study, or one by another version, or something else.

    With `fresh`, earlier results are removed instead, and nothing but results. Raises FolderError.
    """
    written_by, holds = held(folder)
    if fresh:
        folder.clear()
    elif written_by not in (None, jaxnet.__version__):
        raise FolderError(
            f"{folder.path} was written by jaxnet {written_by}, this is {jaxnet.__version__}; {REMEDY}"
        )
    elif holds not in (None, digest(config)):
        raise FolderError(f"{folder.path} holds another study{difference(folder, config)}; {REMEDY}")


def claim(folder: Folder, config: Config) -> None:
    """Admit a study, and have a folder that holds nothing say that it is this one's, before any run."""
    admit(folder, config)
    if not folder.manifest:
        folder.write_study(config)
        folder.write_manifest(
            hash=digest(config),
            versions=versions(),
            kinds=said_of_kinds(config),
            modules={name: made._asdict() for name, made in made_from(config).items()},
            save=to_plain(config.save),
            samples=0,
            finished=False,
        )


def admit_made(folder: Folder, manifest: dict[str, Any]) -> None:
    """Have a folder say of which rows it holds what was made; a manifest tells of the rows.

    Raises FolderError if it holds what was made of other rows, or cannot be written to.
    """
    rows_of = {entry: manifest[entry] for entry in ("hash", "samples")} | {
        "jaxnet": manifest["versions"]["jaxnet"]
    }
    file = folder.path / MADE_OF
    if file.exists():
        try:
            same = json.loads(file.read_text()) == rows_of
        except ValueError:
            same = False
        if not same:
            raise FolderError(
                f"{folder.path} holds what was made of other rows: give another folder with --out"
            )
        return
    if taken := [name for name in OURS if (folder.path / name).exists()]:
        raise FolderError(f"{folder.path} holds {taken[0]} of something else: give another folder with --out")
    folder.put(MADE_OF, lambda file: file.write((json.dumps(rows_of) + "\n").encode()))


def held(folder: Folder) -> tuple[str | None, str | None]:
    """By which version and of which study the results are that a folder holds; None where there are none.

    Raises FolderError if something else is there.
    """
    if manifest := folder.manifest:
        if not set(manifest) >= MANIFEST:
            raise FolderError(f"{folder.path / 'manifest.json'} is not a manifest of ours")
        return manifest["versions"]["jaxnet"], manifest["hash"]
    names = sorted(path.name for path in folder.path.iterdir()) if folder.path.exists() else []
    strangers = [name for name in names if not name.startswith(".") and name not in ("study.yaml", "lanes")]
    if not strangers and "lanes" in names:
        inside = (path.name for path in (folder.path / "lanes").iterdir())
        strangers = [f"lanes/{name}" for name in inside if not LANES.fullmatch(name)]
    if strangers:
        raise FolderError(f"{folder.path} is not a results folder: it holds {strangers[0]}")
    stamp = rows.any_stamp(folder)
    return (stamp.jaxnet, stamp.study) if stamp else (None, None)


def difference(folder: Folder, config: Config) -> str:
    """Keys in which the folder's study differs from a config, where it is known."""
    if changed := changed_modules(folder, config):
        return f": {changed[0]} was changed since its rows were made"
    file = folder.path / "study.yaml"
    if not file.exists():
        return ""
    theirs, ours = flat(Document.read(file).data), flat(to_plain(config))
    keys = [
        key
        for key in dict.fromkeys([*theirs, *ours])
        if key.split(".")[0] not in unhashed(config) and theirs.get(key) != ours.get(key)
    ]
    if not keys:
        return ": its sweep has another order"
    apart = (f"{key} is {short(theirs.get(key))} there and {short(ours.get(key))} here" for key in keys[:3])
    return ": " + ", ".join(apart)


def short(value: Any) -> str:
    """A value that may be as long as a file's content."""
    return shorten(str(value), 100, placeholder=" …")


def changed_modules(folder: Folder, config: Config) -> list[str]:
    """Modules that a config's kinds come from and that are not what they were when the rows were made."""
    theirs, ours = folder.manifest.get("modules", {}), made_from(config)
    return [name for name in theirs if name in ours and ours[name].sha256 != theirs[name]["sha256"]]


def flat(value: Any, prefix: str = "") -> dict[str, Any]:
    """Nested mappings as one with dotted keys."""
    if not isinstance(value, dict) or not value:
        return {prefix: value}
    joined = {}
    for key, each in value.items():
        joined |= flat(each, f"{prefix}.{key}" if prefix else str(key))
    return joined
