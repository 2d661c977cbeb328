"""Which figures a results folder gives, and drawing them as PNG and PDF."""

from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from jaxnet.study.api import Results
from jaxnet.view import panels, style, tails, topology


def draw(results: Results) -> Iterator[Path]:
    """Draw every figure that the folder has data for; the files written, one after the other."""
    has = {name: (results.path / f"{name}.zarr").exists() for name in ("errors", "trajectories")}
    with mpl.rc_context(style.RC):
        yield from save(results, "topologies", topology.figure(results.study.cells))
        yield from save(results, "tails", tails.figure(results))
        if has["trajectories"] or has["errors"]:
            yield from save(results, "panels", panels.figure(results, **has))


def save(results: Results, name: str, figure: Figure) -> Iterator[Path]:
    """Write one figure in both formats."""
    folder = results.path / "figures"
    folder.mkdir(exist_ok=True)
    for suffix in ("png", "pdf"):
        path = folder / f"{name}.{suffix}"
        figure.savefig(path)
        yield path
