"""The figures that a results folder gives, by name, and drawing them as PNG and PDF."""

import hashlib
import re
from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib as mpl
import pandas as pd
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.explore.courses import search_courses
from jaxnet.explore.sensitivity import SENSITIVITY_FILE
from jaxnet.statistics.bands import all_bands
from jaxnet.statistics.choice import Where, as_list, select_cells
from jaxnet.statistics.curves import curves, no_magnitudes, unrecovered_shares
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.statistics.tiles import tile_table, tiling
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import MissingKindError
from jaxnet.store.results import Results, read_table
from jaxnet.view.figures import (
    COLUMNS,
    NAMES,
    bands,
    heat,
    multiples,
    panels,
    search,
    sensitivity,
    style,
    tails,
    topology,
    ultimate,
    unrecovered,
)
from jaxnet.view.figures.style import Figure
from jaxnet.view.text import worst

NO_SHARE = "share of unrecovered lanes", "an attack and 'recovery={tau: 0.01}'"
NO_ERROR = "attacked lane that ended", "an attack of a fixed magnitude"
LONGEST = 100  # letters of a file's name

in_style = mpl.rc_context(style.RC)


class LackingError(FolderError):
    """A folder that has no data for a figure; says what would give them."""


class Plots:
    """The figures of a results folder; one that it has no data for raises FolderError.

    Each takes `where`, swept keys with the value or the values that are wanted, and `column`, "one" or "two":
    those of a journal that it is as wide as.
    """

    def __init__(self, results: Results):
        self.results = results

    @in_style
    def topologies(self, where: Where | None = None, column: str = "two") -> Figure:
        """Each graph, with its weights and its attacked links."""
        return topology.figure(*selection(self.results, where, column))

    @in_style
    def tails(self, where: Where | None = None, column: str = "two") -> Figure:
        """The mean error over the tail, a dot per lane and a row per cell."""
        return tails.figure(self.results, *selection(self.results, where, column))

    @in_style
    def panels(self, where: Where | None = None, column: str = "two") -> Figure:
        """The paper's figure: trajectories of each topology, and the errors over time."""
        there = {name: has(self.results, name) for name in ("trajectories", "errors")}
        if not any(there.values()):
            raise lacking(
                self.results, "errors.zarr or trajectories.zarr", "save.errors=true or save.trajectories=all"
            )
        return panels.figure(self.results, *selection(self.results, where, column), **there)

    @in_style
    def bands(self, where: Where | None = None, column: str = "two") -> Figure:
        """The tracking error over time: median, 5 to 95 % and maximum over the lanes."""
        if not has(self.results, "errors"):
            raise lacking(self.results, "errors.zarr", "save.errors=true")
        cells, width = selection(self.results, where, column)
        return bands.figure(cells, all_bands(self.results, cells), width)

    @in_style
    def unrecovered(self, where: Where | None = None, column: str = "two") -> Figure:
        """The share of lanes that do not recover, with its interval."""
        cells, width = selection(self.results, where, column)
        if not len(unrecovered_shares(self.results, cells)):
            raise lacking(self.results, *NO_SHARE)
        return unrecovered.figure(self.results, cells, curves(self.results, cells), width)

    @in_style
    def heat(self, where: Where | None = None, column: str = "two") -> Figure:
        """The share of lanes that do not recover over two swept keys, in colours, with its interval."""
        return over_two_keys(self.results, "unrecovered", *selection(self.results, where, column))

    @in_style
    def heat_worst(self, where: Where | None = None, column: str = "two") -> Figure:
        """The greatest tail error of any vehicle in any lane, per ā, over two swept keys, in colours."""
        return over_two_keys(self.results, "worst", *selection(self.results, where, column))

    @in_style
    def ultimate(self, where: Where | None = None, column: str = "two") -> Figure:
        """The greatest tail error against ā, under its bounds and fits once there are some."""
        return against_magnitude(self.results, "tail_max", *selection(self.results, where, column))

    @in_style
    def ultimate_mean(self, where: Where | None = None, column: str = "two") -> Figure:
        """The mean tail error against ā, under its bounds and fits once there are some."""
        return against_magnitude(self.results, "tail_mean", *selection(self.results, where, column))

    @in_style
    def search(self, where: Where | None = None, column: str = "two") -> Figure:
        """The best choice until then, by lanes, of a search and of as many random lanes."""
        cells, width = selection(self.results, where, column)
        refuse_unsearched(self.results)
        words = worst.with_unit(self.results)
        shown = cells[: multiples.room([cell.labels for cell in cells], width)]
        return search.course(list(search_courses(self.results, shown)), len(cells), words, width)

    @in_style
    def search_worst(self, where: Where | None = None, column: str = "two") -> Figure:
        """The worst that a search found, the best of as many random lanes, and the bound: a row a cell."""
        cells, width = selection(self.results, where, column)
        refuse_unsearched(self.results)
        words = f"worst {worst.maximised(self.results)}"
        return search.beside_bounds(worst.rows_of(self.results), cells, words, width)

    @in_style
    def sensitivity(self, where: Where | None = None, column: str = "two") -> Figure:
        """Which part of the mean tail error's variance comes from which quantity drawn, a panel per cell."""
        return parts_of_variance(self.results, "tail_mean", *selection(self.results, where, column))

    @in_style
    def sensitivity_unrecovered(self, where: Where | None = None, column: str = "two") -> Figure:
        """The same of whether a lane recovers."""
        return parts_of_variance(self.results, "unrecovered", *selection(self.results, where, column))


def refuse_unsearched(results: Results) -> None:
    """Raise FolderError if a folder has had no search."""
    if results.study.config.search is None or not (results.path / "worst.csv").exists():
        raise LackingError(f"{results.path} has no worst.csv: jaxnet search CONFIG makes it")


def selection(results: Results, where: Where | None, column: str) -> tuple[list[Cell], float]:
    """The cells that a figure is to show, and its width [in]; raises FolderError."""
    if column not in COLUMNS:
        raise FolderError(f"column: {' or '.join(COLUMNS)} (got {column})")
    return select_cells(results.study.cells, where or {}), COLUMNS[column]


def against_magnitude(results: Results, metric: str, cells: Sequence[Cell], width: float) -> Figure:
    """A metric of the tail against ā."""
    found = curves(results, cells)
    if reason := no_magnitudes(found):
        remedy = "run the study with an attack and 'sweep.attack.magnitude={geomspace: [0.1, 100, 12]}'"
        raise LackingError(f"{results.path}: {reason.removesuffix('.')}: {remedy}")
    return ultimate.figure(found, metric, width)


def over_two_keys(results: Results, metric: str, cells: Sequence[Cell], width: float) -> Figure:
    """A metric in colours."""
    tiles = tiling(cells)
    if tiles is None:
        remedy = "a sweep of two values at least of two keys, such as defence and attack.frequency"
        raise lacking(results, "two swept keys with two values each among these cells", remedy)
    if tile_table(results).loc[[cell.number for cell in cells], metric].isna().all():
        raise lacking(results, *(NO_SHARE if metric == "unrecovered" else NO_ERROR))
    return heat.figure(results, tiles, metric, width)


def parts_of_variance(results: Results, metric: str, cells: Sequence[Cell], width: float) -> Figure:
    """Sobol's indices of a metric."""
    file = results.path / SENSITIVITY_FILE
    table: Any = read_table(file) if file.exists() else pd.DataFrame({"metric": [], "cell": []})
    wanted = (table["metric"] == metric) & table["cell"].isin([cell.number for cell in cells])
    if not wanted.any():
        raise LackingError(
            f"{results.path} has no {SENSITIVITY_FILE} of {metric} in these cells:"
            " jaxnet sensitivity makes it"
        )
    return sensitivity.figure(table[wanted], cells, width)


def has(results: Results, name: str) -> bool:
    """Whether the folder has this store."""
    return (results.path / f"{name}.zarr").exists()


def lacking(results: Results, what: str, remedy: str) -> LackingError:
    """The error that says what is not there, and how to get it."""
    return LackingError(f"{results.path} has no {what}: run the study with {remedy}")


def draw(results: Results, names: Sequence[str] = NAMES, told: Steps = no_progress) -> Iterator[UPath]:
    """Draw those of these figures that the folder has data for; the files written, one after the other."""
    for done, name in enumerate(names):
        told("figures drawn", done, len(names))
        try:
            drawn = getattr(Plots(results), name)()
        except (LackingError, MissingKindError):
            continue
        yield from save(results, name, drawn)


def file_name(name: str, where: Where, column: str) -> str:
    """What a figure's files are called: the plain one by its name, others by what they show too."""
    words = [f"{key}={value}" for key, values in where.items() for value in as_list(values)]
    told = "-".join([name, *words, *(["one-column"] if column == "one" else [])])
    plain = re.sub(r"[^\w.=-]+", "_", told)
    if plain == told and len(told) <= LONGEST:
        return told
    return f"{plain[:LONGEST]}-{hashlib.sha256(told.encode()).hexdigest()[:6]}"  # as others may be cut to it


def save(results: Results, name: str, figure: Figure) -> Iterator[UPath]:
    """Write one figure in both formats."""
    layout = figure.get_layout_engine()
    if layout is not None:  # once for both, for it takes longer than drawing
        with mpl.rc_context(style.RC):
            layout.execute(figure)
        figure.set_layout_engine("none")
    for kind in ("png", "pdf"):
        yield results.folder.put(
            f"figures/{name}.{kind}", lambda file, kind=kind: figure.savefig(file, format=kind)
        )
