"""Search for the results folders below a folder."""

from collections.abc import Iterator
from pathlib import Path
from typing import cast

from upath import UPath

from jaxnet.store.folder import MANIFEST, Folder, FolderError, Manifest


def find_results(
    root: str | Path | UPath, entered: set[Path] | None = None
) -> Iterator[tuple[UPath, Manifest]]:
    """Yield the results folders at or below a folder, sorted by name, and their manifests.

    The search does not enter a results folder, nor a folder twice, whatever links lead there. The manifest is
    empty where only parts of a run exist.
    """
    path, entered = Folder(root).path, set() if entered is None else entered
    manifest = manifest_of(path)
    if manifest or any(path.glob("lanes/*.parquet")):
        yield path, manifest
    elif path.is_dir():
        if isinstance(path, Path):
            if (here := path.resolve()) in entered:
                return
            entered.add(here)
        inside = (
            each for each in path.iterdir() if each.is_dir() and not each.name.startswith(".")
        )
        for each in sorted(inside, key=lambda each: each.name):
            yield from find_results(each, entered)


def manifest_of(path: UPath) -> Manifest:
    """Return a folder's manifest; empty unless jaxnet has written it."""
    empty = cast(Manifest, {})
    try:
        found = Folder(path).manifest
    except FolderError:
        return empty
    return found if set(found) >= MANIFEST else empty
