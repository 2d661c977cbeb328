"""Which figures a results folder gives, and drawing them as PNG and PDF."""

from collections.abc import Iterator

import matplotlib as mpl
from matplotlib.figure import Figure
from upath import UPath

from jaxnet.statistics.curves import all_bands, curves, magnitude_is_swept, shares
from jaxnet.store.folder import Folder
from jaxnet.store.results import Results
from jaxnet.view.figures import bands, panels, style, tails, topology, ultimate, unrecovered


def draw(results: Results) -> Iterator[UPath]:
    """Draw every figure that the folder has data for; the files written, one after the other."""
    has = {name: (results.path / f"{name}.zarr").exists() for name in ("errors", "trajectories")}
    with mpl.rc_context(style.RC):
        yield from save(results, "topologies", topology.figure(results.study.cells))
        yield from save(results, "tails", tails.figure(results))
        if has["trajectories"] or has["errors"]:
            yield from save(results, "panels", panels.figure(results, **has))
        if has["errors"]:
            yield from save(results, "bands", bands.figure(results.study.cells, all_bands(results)))
        if len(shares(results)):
            yield from save(results, "unrecovered", unrecovered.figure(results, curves(results)))
    yield from draw_ultimate(results)


def draw_ultimate(results: Results) -> Iterator[UPath]:
    """Draw δ̂(ā) under its bounds, if ā is swept."""
    found = curves(results)
    with mpl.rc_context(style.RC):
        if magnitude_is_swept(found):
            yield from save(results, "ultimate", ultimate.figure(found, "tail_max"))
            yield from save(results, "ultimate_mean", ultimate.figure(found, "tail_mean"))


def save(results: Results, name: str, figure: Figure) -> Iterator[UPath]:
    """Write one figure in both formats."""
    folder, layout = Folder(results.path), figure.get_layout_engine()
    if layout is not None:  # once for both, for it takes longer than drawing
        layout.execute(figure)
        figure.set_layout_engine("none")
    for kind in ("png", "pdf"):
        yield folder.put(f"figures/{name}.{kind}", lambda file, kind=kind: figure.savefig(file, format=kind))
