"""Output of `jaxnet list`: a line per results folder."""

from upath import UPath

from jaxnet.store.folder import find_results
from jaxnet.store.manifest import Manifest, samples_of_cells
from jaxnet.store.results import Results
from jaxnet.view.text.printer import table_text


def folders_text(root: str) -> str:
    """Return a table of results folders below a root, or ""; the path stands last, to copy."""
    found = list(find_results(root))
    if not found:
        return ""
    rows = [folder_row(path, manifest) for path, manifest in found]
    lines = table_text({name: [row[name] for row in rows] for name in rows[0]}).splitlines()
    paths = ["results", *(str(path) for path, _ in found)]
    width = max(map(len, lines))
    return "\n".join(f"{line:{width}}  {path}" for line, path in zip(lines, paths, strict=True))


def folder_row(path: UPath, manifest: Manifest) -> dict[str, object]:
    """The table row of a folder; a dash marks an unknown number."""
    cells, finished = manifest.get("cells"), manifest.get("finished", False)
    held = Results(path)
    analyses = "" if held.has_run else ", ".join(held.analyses)
    lanes = manifest["lanes"] if finished else {"ok": "-", "failed": "-"}
    written = "-"
    if manifest:
        file = path / "manifest.json"
        written = f"{file.fs.modified(file.path).astimezone():%Y-%m-%d %H:%M}"
    return {
        "cells": cells or "-",
        "lanes": sum(samples_of_cells(manifest, cells)) if cells else "-",
        "ok": lanes["ok"],
        "failed": lanes["failed"],
        "": "finished" if finished else analyses or "unfinished",
        "written": written,
    }
