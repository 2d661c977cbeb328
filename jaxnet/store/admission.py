"""Which folders accept a study: an empty one, or one that holds this study, of this version."""

import contextlib
import json
import re
from textwrap import shorten
from typing import Any

import pandas as pd

from jaxnet.config.cells import to_plain
from jaxnet.config.document import Document
from jaxnet.config.keys import Config
from jaxnet.store import gate, rows
from jaxnet.store.folder import DERIVED, DERIVED_FROM, OURS, Folder, FolderError
from jaxnet.store.manifest import (
    MANIFEST,
    Manifest,
    changed_modules,
    changed_settings,
    digest,
    manifest_entries,
    settings_of,
    unhashed,
)
from jaxnet.version import __version__

ANOTHER_FOLDER = "give another folder with --out"
LANES = re.compile(r"\..*|\d{5,}\.(parquet|npz)")  # what may be in lanes/


def admit(folder: Folder, config: Config, fresh: bool | None = None) -> None:
    """Raise FolderError for a folder with another study, one by another version, or foreign files.

    With `fresh`, remove earlier results instead, and nothing but results. None: it is no option.
    """
    written_by, holds = version_and_hash(folder)
    if fresh:
        folder.remove(*OURS)
        return
    why = ""
    if written_by not in (None, __version__):
        why = f"was written by jaxnet {written_by}, this is {__version__}"
    elif holds not in (None, digest(config)):
        why = f"holds another study{difference(folder, config)}"
    if why:
        told = ANOTHER_FOLDER + ", or replace its results with --fresh" * (fresh is not None)
        raise FolderError(f"{folder.path} {why}; {told}")


def claim(folder: Folder, config: Config) -> None:
    """Admit a study; mark an empty folder as this study's before any run."""
    admit(folder, config)
    manifest = folder.manifest
    if not manifest or (not manifest["samples"] and changed_settings(manifest, config)):
        folder.remove(*DERIVED)
        folder.write_study(config)
        folder.write_manifest(**manifest_entries(config), samples=0, finished=False)


def admit_made(folder: Folder, manifest: Manifest, config: Config) -> None:
    """Have a folder's first file mark it as made of these rows and settings; refuse one of others.

    So a command that is refused writes nothing.
    """
    folder.refuse_strange()
    entries = ("hash", "samples", "cell_samples")
    rows_of = {each: manifest[each] for each in entries if manifest.get(each) is not None}
    rows_of["jaxnet"] = manifest["versions"]["jaxnet"]
    file, now, elsewhere = folder.path / DERIVED_FROM, settings_of(config), ""
    if file.exists():
        with gate.reading(file, "does not tell of which rows it was made"):
            made = dict(json.loads(gate.read_whole(file)))
        settings = made.pop("settings", now)
        if made != rows_of or settings != now:
            elsewhere = f"what was made of other {'rows' if made != rows_of else 'settings'}"
    elif taken := [name for name in OURS if (folder.path / name).exists()]:
        elsewhere = f"{taken[0]} of something else"
    else:
        text = json.dumps({**rows_of, "settings": now}) + "\n"
        folder.before[DERIVED_FROM] = text.encode()
    if elsewhere:
        raise FolderError(f"{folder.path} holds {elsewhere}: give another folder with --out")


def version_and_hash(folder: Folder) -> tuple[str | None, str | None]:
    """Version and study hash of the results in a folder, or (None, None); refuse foreign files."""
    if manifest := folder.manifest:
        if not {*manifest} >= MANIFEST:
            raise FolderError(f"{folder.path / 'manifest.json'} is not a manifest of ours")
        return manifest["versions"]["jaxnet"], manifest["hash"]
    names = sorted(path.name for path in folder.path.iterdir()) if folder.path.exists() else []
    strangers = [name for name in names if name[0] != "." and name not in ("study.yaml", "lanes")]
    if not strangers and "lanes" in names:
        inside = (path.name for path in (folder.path / "lanes").iterdir())
        strangers = [f"lanes/{name}" for name in inside if not LANES.fullmatch(name)]
    if strangers:
        raise FolderError(f"{folder.path} is not a results folder: it holds {strangers[0]}")
    for path in sorted(folder.path.glob("lanes/[0-9]*.parquet")):
        with contextlib.suppress(rows.TornError):
            stamp = rows.read_rows(path)[1]
            return stamp.jaxnet, stamp.study
    return None, None


def difference(folder: Folder, config: Config) -> str:
    """The first key in which the folder's study differs from a config; "" if none is known."""
    if changed := changed_modules(folder.manifest, config):
        return f": {changed[0]} was changed since its rows were made"
    file = folder.path / "study.yaml"
    if not file.exists():
        return ""
    hidden, read = unhashed(config), (Document.read(file).data, to_plain(config))
    theirs, ours = ({k: v for k, v in each.items() if k not in hidden} for each in read)
    return f": {'its sweep has another order' if theirs == ours else first_apart(theirs, ours)}"


def first_apart(there: Any, here: Any, key: str = "") -> str:
    """The first dotted key in which two values differ; entries of lists count from 0."""
    pair = there, here
    if all(isinstance(each, dict) for each in pair) or all(isinstance(each, list) for each in pair):
        both = [dict(each if isinstance(each, dict) else enumerate(each)) for each in pair]
        values = (
            (name, *(each.get(name, "absent") for each in both)) for name in both[0] | both[1]
        )
        name, there, here = next(each for each in values if each[1] != each[2])
        return first_apart(there, here, f"{key}.{name}" if key else str(name))
    there, here = (shorten(str(each), 100, placeholder=" …") for each in pair)
    return f"{key} is {there} there and {here} here"


def flatten_keys(data: dict[str, Any]) -> dict[str, Any]:
    """Values by their dotted keys."""
    return {str(key): each for key, each in pd.json_normalize([data]).iloc[0].items()}


def refuse_edited(folder: Folder, config: Config) -> None:
    """Raise FolderError where `study.yaml` is no longer the study whose rows the folder holds.

    Modules are compared apart, by `changed_modules`. Another version may hash a study otherwise.
    """
    written_by, holds = version_and_hash(folder)
    made_of = folder.manifest.get("modules", {}).items()
    modules = {name: (each["sha256"], each.get("version")) for name, each in made_of}
    if written_by == __version__ and holds not in (None, digest(config, modules)):
        told = "is not the study whose rows the folder holds: it was edited since"
        raise FolderError(f"{folder.path}/study.yaml {told}")
