"""Output of `jaxnet list`: a line per results folder."""

import pandas as pd
from upath import UPath

from jaxnet.store.folder import Manifest, find_results, samples_of_cells
from jaxnet.store.results import Results
from jaxnet.view.text.width import table_text


def folders_text(root: str) -> str:
    """Return a table of all results folders below a root, or an empty string.

    The path stands last and in full, so that it can be copied.
    """
    found = list(find_results(root))
    if not found:
        return ""
    table = table_text(
        pd.DataFrame([folder_row(path, manifest) for path, manifest in found])
    ).splitlines()
    paths = ["results", *(str(path) for path, _ in found)]
    return "\n".join(f"{line}  {path}" for line, path in zip(table, paths, strict=True))


def folder_row(path: UPath, manifest: Manifest) -> dict[str, object]:
    """Return the table row of a folder; a dash marks an unknown number."""
    cells = manifest.get("cells")
    finished = manifest.get("finished", False)
    held = Results(path)
    analyses = "" if held.has_run else ", ".join(held.analyses)
    lanes = manifest["lanes"] if finished else {"ok": "-", "failed": "-"}
    return {
        "cells": cells or "-",
        "lanes": sum(samples_of_cells(manifest, cells)) if cells else "-",
        "ok": lanes["ok"],
        "failed": lanes["failed"],
        "": "finished" if finished else analyses or "unfinished",
        "written": last_written(path) if manifest else "-",
    }


def last_written(path: UPath) -> str:
    """Return the local time of the last write."""
    file = path / "manifest.json"
    return f"{file.fs.modified(file.path).astimezone():%Y-%m-%d %H:%M}"  # object stores tell it as a time
