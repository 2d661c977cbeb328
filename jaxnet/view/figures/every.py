"""All figures of a results folder, by name, written as PNG and PDF."""

import functools
import hashlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

import matplotlib as mpl
import pandas as pd
from upath import UPath

from jaxnet.config.cells import Cell, is_leaderless, judged_metric
from jaxnet.explore.courses import search_courses
from jaxnet.explore.sensitivity import SENSITIVITY_FILE
from jaxnet.statistics.axes import choose_axes
from jaxnet.statistics.bands import all_bands
from jaxnet.statistics.choice import Where, as_list, select_cells
from jaxnet.statistics.curves import curves, no_magnitudes
from jaxnet.statistics.fits import NO_ULTIMATE_ERROR
from jaxnet.statistics.quantities import asked_quantity, quantity_of
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.statistics.tiles import tile_table, tiling
from jaxnet.statistics.vehicles import vehicle_table
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import MissingKindError
from jaxnet.store.results import Results
from jaxnet.view.figures import (
    COLUMN_WIDTHS,
    FIGURE_NAMES,
    bands,
    heat,
    lines,
    multiples,
    panels,
    search,
    sensitivity,
    style,
    tails,
    topology,
    ultimate,
    vehicles,
)
from jaxnet.view.figures.style import Figure
from jaxnet.view.text import worst

NO_SHARE = "share of unrecovered lanes", "an attack and 'recovery={tau: 0.01}'"
NO_ERROR = "attacked lane that ended", "an attack of a fixed magnitude"
NO_AXES: Mapping[str, object] = {}
LONGEST_FILE_NAME = 100  # letters of a file's name

Drawing = TypeVar("Drawing", bound=Callable[..., Figure])


def styled(draw: Drawing) -> Drawing:
    """Draw, and later save, a figure in the style of its `Plots`; without `note` its notes go."""

    @functools.wraps(draw)
    def drawn(self: "Plots", *given: object, note: bool = True, **named: object) -> Figure:
        with mpl.rc_context(self.style):
            made = draw(self, *given, **named)
        if not note:
            multiples.drop_note(made)
        multiples.show_unparsed(made)
        made.style = self.style
        return made

    return drawn  # pyright: ignore[reportReturnType]


class LackingError(FolderError):
    """A results folder lacks the data of a figure; the message says how to produce the data."""


class Plots:
    """Figures of a results folder.

    Parameters
    ----------
    results
        Results of a finished run.

    Notes
    -----
    Each method takes `where`, the wanted value or values of swept keys, and `column`, "one" or "two", the
    figure's width in columns of a journal. `note=False` leaves out the small line at the top, for a paper
    whose caption says it. Each method returns a matplotlib figure.

    Raises
    ------
    FolderError
        The folder lacks the figure's data, or an argument is unknown.
    """

    def __init__(self, results: Results, style: style.Style = style.PRINT_STYLE):
        self.results, self.style = results, style

    @property
    def plain(self) -> "Plots":
        """The same figures in the style that matplotlib has: of `matplotlibrc`, or `plt.style.use`."""
        return Plots(self.results, style.LAYOUT)

    @styled
    def topologies(
        self, where: Where | None = None, column: str = "two", *, note: bool = True
    ) -> Figure:
        """Draw each graph with its weights and attacked links."""
        return topology.topology_figure(*cells_and_width(self.results, where, column))

    @styled
    def tails(
        self, where: Where | None = None, column: str = "two", *, note: bool = True
    ) -> Figure:
        """Draw the mean error, or the spread, over the tail: a dot per lane, a row per cell."""
        return tails.tails_figure(self.results, *cells_and_width(self.results, where, column))

    @styled
    def panels(
        self, where: Where | None = None, column: str = "two", *, note: bool = True
    ) -> Figure:
        """Draw the paper's figure: trajectories of each topology, and the errors over time."""
        there = {name: has_store(self.results, name) for name in ("trajectories", "errors")}
        if not any(there.values()):
            raise lacking_error(
                self.results,
                "errors.zarr or trajectories.zarr",
                "save.errors=true or save.trajectories=all",
            )
        return panels.panels_figure(
            self.results, *cells_and_width(self.results, where, column), **there
        )

    @styled
    def bands(
        self, where: Where | None = None, column: str = "two", *, note: bool = True
    ) -> Figure:
        """Draw the error, or the spread, over time: median, 5 to 95 % and maximum over the lanes."""
        if not has_store(self.results, "errors"):
            raise lacking_error(self.results, "errors.zarr", "save.errors=true")
        cells, width = cells_and_width(self.results, where, column)
        return bands.bands_figure(cells, all_bands(self.results, cells), width)

    @styled
    def vehicles(
        self, where: Where | None = None, column: str = "two", *, note: bool = True
    ) -> Figure:
        """Draw the mean error of each vehicle over the tail: median, 5 to 95 % and maximum over the lanes."""
        if not has_store(self.results, "vehicles"):
            raise lacking_error(self.results, "vehicles.zarr", "save.vehicles=true")
        cells, width = cells_and_width(self.results, where, column)
        found = vehicle_table(self.results, cells)
        if found.empty:
            raise LackingError(f"{self.results.place}: no lane of these cells came to its end")
        return vehicles.vehicles_figure(found, cells, self.results.study.config.recovery, width)

    @styled
    def curve(
        self,
        where: Where | None = None,
        column: str = "two",
        x: str | None = None,
        y: str | None = None,
        hue: str | None = None,
        panel: str | Sequence[str] | None = None,
        *,
        note: bool = True,
    ) -> Figure:
        """Draw a quantity of lanes with its interval against a swept key.

        Parameters
        ----------
        where
            The wanted value or values of swept keys.
        column
            "one" or "two", the figure's width in columns of a journal.
        x, hue
            Swept keys: across, and told apart by colour. None chooses: numbers across, kinds in colours.
        panel
            The swept key or keys with a panel for each value; None takes all keys that are left.
        y
            `unrecovered`, `failed`, `in_hull`, a metric (its median over lanes), or METRIC_STATISTIC with a
            statistic of mean, median, q05, q95 and max. None takes what the study asks for.
        note
            Whether the small line at the top stands there: definition, lanes a point, intervals.

        Raises
        ------
        FolderError
            A key is not swept, two cells would have one place, or `y` is unknown.

        Examples
        --------
        >>> figure = results.plot.curve(x="attack.magnitude", y="tail_max", hue="topology")
        """
        cells, width = cells_and_width(self.results, where, column)
        axes = choose_axes(cells, x, hue, panel)
        found = quantity_of(self.results, cells, y or asked_quantity(self.results.study.config))
        if not found.known.size:
            raise lacking_error(
                self.results, *(NO_SHARE if found.name == "unrecovered" else NO_ERROR)
            )
        return lines.curve_figure(found, axes, cells, width)

    @styled
    def heat(
        self, where: Where | None = None, column: str = "two", *, note: bool = True, **axes: Any
    ) -> Figure:
        """Draw a heat map of the share of lanes that do not recover: `x` across, `hue` down, `panel`."""
        cells, width = cells_and_width(self.results, where, column)
        return over_two_keys(self.results, "unrecovered", cells, width, **axes)

    @styled
    def heat_worst(
        self, where: Where | None = None, column: str = "two", *, note: bool = True, **axes: Any
    ) -> Figure:
        """Draw a heat map of the greatest tail error of any vehicle in any lane, per ā, as `heat` does.

        Without a navigator it is the greatest spread [m].
        """
        cells, width = cells_and_width(self.results, where, column)
        return over_two_keys(self.results, "worst", cells, width, **axes)

    @styled
    def ultimate(
        self, where: Where | None = None, column: str = "two", *, note: bool = True
    ) -> Figure:
        """Draw the greatest tail error against ā, with stored bounds and fits."""
        return against_magnitude(
            self.results, "tail_max", *cells_and_width(self.results, where, column)
        )

    @styled
    def ultimate_mean(
        self, where: Where | None = None, column: str = "two", *, note: bool = True
    ) -> Figure:
        """Draw the mean tail error against ā, with stored bounds and fits."""
        return against_magnitude(
            self.results, "tail_mean", *cells_and_width(self.results, where, column)
        )

    @styled
    def search(
        self, where: Where | None = None, column: str = "two", *, note: bool = True
    ) -> Figure:
        """Draw the best value against the number of lanes, for a search and for random lanes."""
        cells, width = cells_and_width(self.results, where, column)
        refuse_unsearched(self.results, cells)
        words = worst.metric_with_unit(self.results)
        shown = cells[: multiples.panels_fitting([cell.labels for cell in cells], width)]
        return search.course_figure(
            list(search_courses(self.results, shown)), len(cells), words, width
        )

    @styled
    def search_worst(
        self, where: Where | None = None, column: str = "two", *, note: bool = True
    ) -> Figure:
        """Draw a row per cell: the worst choice found, the worst of random lanes, and the bound."""
        cells, width = cells_and_width(self.results, where, column)
        refuse_unsearched(self.results, cells)
        words = f"worst {worst.maximised_text(self.results)}"
        return search.bounds_figure(worst.worst_rows(self.results), cells, words, width)

    @styled
    def sensitivity(
        self, where: Where | None = None, column: str = "two", *, note: bool = True
    ) -> Figure:
        """Draw Sobol's indices of the mean tail error, or of the spread, a panel per cell."""
        metric = judged_metric(self.results.study.cells)
        return parts_of_variance(
            self.results, metric, *cells_and_width(self.results, where, column)
        )

    @styled
    def sensitivity_unrecovered(
        self, where: Where | None = None, column: str = "two", *, note: bool = True
    ) -> Figure:
        """Draw Sobol's indices of the event that a lane does not recover."""
        return parts_of_variance(
            self.results, "unrecovered", *cells_and_width(self.results, where, column)
        )


def refuse_unsearched(results: Results, cells: Sequence[Cell]) -> None:
    """Raise LackingError if the folder holds no results of a search of any of these cells."""
    if results.study.config.search is None or not (results.path / "worst.csv").exists():
        raise LackingError(f"{results.place} has no worst.csv: jaxnet search CONFIG makes it")
    if not set(results.worst["cell"]) & {cell.number for cell in cells}:
        raise LackingError(
            f"{results.place}: no search of these cells has ended: jaxnet search goes on"
        )


def cells_and_width(results: Results, where: Where | None, column: str) -> tuple[list[Cell], float]:
    """Return the selected cells and the figure's width [in]; raise FolderError for an unknown column."""
    if column not in COLUMN_WIDTHS:
        raise FolderError(f"column: {' or '.join(COLUMN_WIDTHS)} (got {column})")
    return select_cells(results.study.cells, where or {}), COLUMN_WIDTHS[column]


def against_magnitude(results: Results, metric: str, cells: Sequence[Cell], width: float) -> Figure:
    """Draw a tail metric against the attack magnitude ā."""
    if is_leaderless(cells):
        raise LackingError(f"{results.place}: {NO_ULTIMATE_ERROR}")
    found = curves(results, cells)
    if reason := no_magnitudes(found):
        remedy = (
            "run the study with an attack and 'sweep.attack.magnitude={geomspace: [0.1, 100, 12]}'"
        )
        raise LackingError(f"{results.place}: {reason.removesuffix('.')}: {remedy}")
    return ultimate.ultimate_figure(found, metric, width)


def over_two_keys(
    results: Results, metric: str, cells: Sequence[Cell], width: float, **axes: Any
) -> Figure:
    """Draw a heat map of a metric over two swept keys."""
    tiles = tiling(cells, choose_axes(cells, **axes, most_hues=len(cells)))
    if tiles is None:
        remedy = "a sweep of two values at least of two keys, such as defence and attack.frequency"
        raise lacking_error(
            results, "two swept keys with two values each among these cells", remedy
        )
    if tile_table(results).loc[[cell.number for cell in cells], metric].isna().all():
        raise lacking_error(results, *(NO_SHARE if metric == "unrecovered" else NO_ERROR))
    return heat.heat_figure(results, tiles, metric, width)


def parts_of_variance(results: Results, metric: str, cells: Sequence[Cell], width: float) -> Figure:
    """Draw Sobol's indices of a metric."""
    there = results.file(SENSITIVITY_FILE).exists()
    table: Any = results.sensitivity if there else pd.DataFrame({"metric": [], "cell": []})
    wanted = (table["metric"] == metric) & table["cell"].isin([cell.number for cell in cells])
    if not wanted.any():
        raise LackingError(
            f"{results.place} has no {SENSITIVITY_FILE} of {metric} in these cells:"
            " jaxnet sensitivity makes it"
        )
    return sensitivity.sensitivity_figure(table[wanted], cells, width)


def has_store(results: Results, name: str) -> bool:
    """Return whether the folder holds a Zarr store of this name."""
    return (results.path / f"{name}.zarr").exists()


def lacking_error(results: Results, what: str, remedy: str) -> LackingError:
    """Return the error that names the lacking data and the remedy."""
    return LackingError(f"{results.place} has no {what}: run the study with {remedy}")


def draw_figures(
    results: Results, names: Sequence[str] = FIGURE_NAMES, told: Steps = no_progress
) -> Iterator[UPath]:
    """Draw the named figures for which the folder has data; yield the files as they are written."""
    for done, name in enumerate(names):
        told("figures drawn", done, len(names))
        try:
            drawn = getattr(Plots(results), name)()
        except (LackingError, MissingKindError):
            continue
        yield from save_figure(results, name, drawn)


def file_name(
    name: str,
    where: Where,
    column: str,
    axes: Mapping[str, object] = NO_AXES,
    plain: bool = False,
    note: bool = True,
) -> str:
    """Return the file name of a figure, without extension; what was chosen is part of it."""
    chosen = [*axes.items(), *where.items()]
    words = [f"{key}={value}" for key, values in chosen for value in as_list(values)]
    told = "-".join(
        [
            name,
            *words,
            *["one-column"] * (column == "one"),
            *["plain"] * plain,
            *["no-note"] * (not note),
        ]
    )
    safe = re.sub(r"[^\w.=-]+", "_", told)
    if safe == told and len(told) <= LONGEST_FILE_NAME:
        return told
    digest = hashlib.sha256(told.encode()).hexdigest()[
        :6
    ]  # other names may be cut to the same letters
    return f"{safe[:LONGEST_FILE_NAME]}-{digest}"


def save_figure(results: Results, name: str, figure: Figure) -> Iterator[UPath]:
    """Write one figure as PNG and as PDF; yield both paths."""
    layout = figure.get_layout_engine()
    if layout is not None:  # once for both, for it takes longer than drawing
        with mpl.rc_context(figure.style):
            layout.execute(figure)
        figure.set_layout_engine("none")
    for kind in ("png", "pdf"):
        yield results.folder.put(
            f"figures/{name}.{kind}", lambda file, kind=kind: figure.savefig(file, format=kind)
        )
