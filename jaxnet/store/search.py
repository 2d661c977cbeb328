"""Which results folders there are below a folder."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from upath import UPath

from jaxnet.store.admission import MANIFEST
from jaxnet.store.folder import Folder, FolderError


def below(root: str | Path | UPath) -> Iterator[tuple[UPath, dict[str, Any]]]:
    """Results folders at or below a folder, by name, and their manifests; none is looked for inside another.

    The manifest is empty where parts of a run (`--shard`) are all there is.
    """
    path = Folder(root).path
    manifest = manifest_of(path)
    if manifest or any(path.glob("lanes/*.parquet")):
        yield path, manifest
    elif path.is_dir():
        inside = (each for each in path.iterdir() if each.is_dir() and not each.name.startswith("."))
        for each in sorted(inside, key=lambda each: each.name):
            yield from below(each)


def manifest_of(path: UPath) -> dict[str, Any]:
    """A folder's manifest; empty where there is none of ours."""
    try:
        found = Folder(path).manifest
    except FolderError:
        return {}
    return found if set(found) >= MANIFEST else {}
