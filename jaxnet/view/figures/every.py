"""The figures that a results folder gives, by name, and drawing them as PNG and PDF."""

from collections.abc import Iterator, Sequence

import matplotlib as mpl
from upath import UPath

from jaxnet.statistics.curves import all_bands, curves, magnitude_is_swept, shares
from jaxnet.statistics.steps import Steps, untold
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.results import Results
from jaxnet.view.figures import NAMES, bands, panels, style, tails, topology, ultimate, unrecovered
from jaxnet.view.figures.style import Figure

in_style = mpl.rc_context(style.RC)


class LackingError(FolderError):
    """A folder that has no data for a figure; says what would give them."""


class Plots:
    """The figures of a results folder; one that it has no data for raises FolderError."""

    def __init__(self, results: Results):
        self.results = results

    @in_style
    def topologies(self) -> Figure:
        """Each graph, with its weights and its attacked links."""
        return topology.figure(self.results.study.cells)

    @in_style
    def tails(self) -> Figure:
        """The mean error over the tail, a dot per lane and a row per cell."""
        return tails.figure(self.results)

    @in_style
    def panels(self) -> Figure:
        """The paper's figure: trajectories of each topology, and the errors over time."""
        there = {name: has(self.results, name) for name in ("trajectories", "errors")}
        if not any(there.values()):
            raise lacking(
                self.results, "errors.zarr or trajectories.zarr", "save.errors=true or save.trajectories=all"
            )
        return panels.figure(self.results, **there)

    @in_style
    def bands(self) -> Figure:
        """The tracking error over time: median, 5 to 95 % and maximum over the lanes."""
        if not has(self.results, "errors"):
            raise lacking(self.results, "errors.zarr", "save.errors=true")
        return bands.figure(self.results.study.cells, all_bands(self.results))

    @in_style
    def unrecovered(self) -> Figure:
        """The share of lanes that do not recover, with its interval."""
        if not len(shares(self.results)):
            raise lacking(self.results, "share of unrecovered lanes", "an attack and 'recovery={tau: 0.01}'")
        return unrecovered.figure(self.results, curves(self.results))

    @in_style
    def ultimate(self) -> Figure:
        """The greatest tail error against ā, under its bounds and fits once there are some."""
        return against_magnitude(self.results, "tail_max")

    @in_style
    def ultimate_mean(self) -> Figure:
        """The mean tail error against ā, under its bounds and fits once there are some."""
        return against_magnitude(self.results, "tail_mean")


def against_magnitude(results: Results, metric: str) -> Figure:
    """A metric of the tail against ā."""
    found = curves(results)
    if not magnitude_is_swept(found):
        remedy = "an attack and 'sweep.attack.magnitude={geomspace: [0.1, 100, 12]}'"
        raise lacking(results, "sweep of attack.magnitude", remedy)
    return ultimate.figure(found, metric)


def has(results: Results, name: str) -> bool:
    """Whether the folder has this store."""
    return (results.path / f"{name}.zarr").exists()


def lacking(results: Results, what: str, remedy: str) -> LackingError:
    """The error that says what is not there, and how to get it."""
    return LackingError(f"{results.path} has no {what}: run the study with {remedy}")


def draw(results: Results, names: Sequence[str] = NAMES, told: Steps = untold) -> Iterator[UPath]:
    """Draw those of these figures that the folder has data for; the files written, one after the other."""
    for done, name in enumerate(names):
        told("figures drawn", done, len(names))
        try:
            drawn = getattr(Plots(results), name)()
        except LackingError:
            continue
        yield from save(results, name, drawn)


def save(results: Results, name: str, figure: Figure) -> Iterator[UPath]:
    """Write one figure in both formats."""
    folder, layout = Folder(results.path), figure.get_layout_engine()
    if layout is not None:  # once for both, for it takes longer than drawing
        with mpl.rc_context(style.RC):
            layout.execute(figure)
        figure.set_layout_engine("none")
    for kind in ("png", "pdf"):
        yield folder.put(f"figures/{name}.{kind}", lambda file, kind=kind: figure.savefig(file, format=kind))
