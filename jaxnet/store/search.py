"""Search for the results folders below a folder."""

from collections.abc import Iterator
from pathlib import Path
from typing import cast

from upath import UPath

from jaxnet.store.folder import MANIFEST
from jaxnet.store.folder import Folder, FolderError, Manifest


def find_results(root: str | Path | UPath) -> Iterator[tuple[UPath, Manifest]]:
    """Yield the results folders at or below a folder, sorted by name, and their manifests.

    The search does not enter a results folder. The manifest is empty where only parts of a run exist.
    """
    path = Folder(root).path
    manifest = manifest_of(path)
    if manifest or any(path.glob("lanes/*.parquet")):
        yield path, manifest
    elif path.is_dir():
        inside = (each for each in path.iterdir() if each.is_dir() and not each.name.startswith("."))
        for each in sorted(inside, key=lambda each: each.name):
            yield from find_results(each)


def manifest_of(path: UPath) -> Manifest:
    """Return a folder's manifest; empty unless jaxnet has written it."""
    empty = cast(Manifest, {})
    try:
        found = Folder(path).manifest
    except FolderError:
        return empty
    return found if set(found) >= MANIFEST else empty
