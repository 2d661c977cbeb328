"""What `jaxnet list` prints: a line per results folder."""

from typing import Any

import pandas as pd
from upath import UPath

from jaxnet.store import search
from jaxnet.view.text.width import as_lines, narrow

LEAST_WANTED = (("cells",), ("written",), ("ok",), ("failed",), ("lanes",))


def listing(root: str) -> str:
    """All of them; empty if there is none."""
    rows = [row(path, manifest) for path, manifest in search.below(root)]
    if not rows:
        return ""
    shown, left_out, _ = narrow(pd.DataFrame(rows), [], LEAST_WANTED)
    return "\n".join([as_lines(shown), *([f"left out: {', '.join(left_out)}"] if left_out else [])])


def row(path: UPath, manifest: dict[str, Any]) -> dict[str, Any]:
    """One folder: of an unfinished run nobody has counted what failed, of parts alone nothing is known."""
    cells = manifest.get("cells")
    finished = manifest.get("finished", False)
    lanes = manifest["lanes"] if finished else {"ok": "-", "failed": "-"}
    return {
        "results": str(path),
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
