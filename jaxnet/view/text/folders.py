"""What `jaxnet list` prints: a line per results folder."""

from typing import Any

import pandas as pd
from upath import UPath

from jaxnet.store import search
from jaxnet.store.folder import Manifest
from jaxnet.view.text.width import as_lines


def listing(root: str) -> str:
    """All of them; empty if there is none. The path is last, whole, for it is there to be copied."""
    found = list(search.find_results(root))
    if not found:
        return ""
    table = as_lines(pd.DataFrame([row(path, manifest) for path, manifest in found])).splitlines()
    paths = ["results", *(str(path) for path, _ in found)]
    return "\n".join(f"{line}  {path}" for line, path in zip(table, paths, strict=True))


def row(path: UPath, manifest: Manifest) -> dict[str, Any]:
    """One folder: of an unfinished run nobody has counted what failed, of parts alone nothing is known."""
    cells = manifest.get("cells")
    finished = manifest.get("finished", False)
    lanes = manifest["lanes"] if finished else {"ok": "-", "failed": "-"}
    return {
        "cells": cells or "-",
        "lanes": cells * manifest["samples"] if cells else "-",
        "ok": lanes["ok"],
        "failed": lanes["failed"],
        "": "finished" if finished else "unfinished",
        "written": last_written(path) if manifest else "-",
    }


def last_written(path: UPath) -> str:
    """When a run wrote there last, in local time."""
    file = path / "manifest.json"
    return f"{file.fs.modified(file.path).astimezone():%Y-%m-%d %H:%M}"  # object stores tell it as a time
