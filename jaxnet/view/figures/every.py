"""All figures of a results folder, by name, written as PNG and PDF."""

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import matplotlib as mpl
import pandas as pd
from upath import UPath

from jaxnet.config.cells import Cell, is_leaderless, judged_metric
from jaxnet.config.naming import label_notes
from jaxnet.explore.courses import search_courses
from jaxnet.explore.sensitivity import SENSITIVITY_FILE
from jaxnet.statistics.axes import choose_axes
from jaxnet.statistics.bands import all_bands, variable_over_time, vehicle_table
from jaxnet.statistics.choice import Where, as_list, select_cells
from jaxnet.statistics.curves import MOST_PANELS, Curve, curves, no_magnitudes
from jaxnet.statistics.falling import falling_words
from jaxnet.statistics.fits import NO_ULTIMATE_ERROR
from jaxnet.statistics.groups import scenes
from jaxnet.statistics.quantities import asked_quantity, quantity_of
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.statistics.tiles import tile_table, tiling
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import MissingKindError
from jaxnet.store.results import Results
from jaxnet.view.drawings import analyses, spreads
from jaxnet.view.drawings.heat import heat_drawing
from jaxnet.view.drawings.swept import swept_drawing
from jaxnet.view.drawings.ultimate import ultimate_drawing
from jaxnet.view.figures import (
    COLUMN_WIDTHS,
    FIGURE_NAMES,
    multiples,
    panels,
    style,
    topology,
)
from jaxnet.view.figures.printed import printed
from jaxnet.view.figures.style import Figure
from jaxnet.view.text import worst

NO_SHARE = "share of unrecovered lanes", "an attack and 'recovery={tau: 0.01}'"
NO_ERROR = "attacked lane that ended", "an attack of a fixed magnitude"
TWO_KEYS = (
    "two swept keys with two values each among these cells",
    "a sweep of two values at least of two keys, such as defence and attack.frequency",
)
OVER_TIME = {"tracking": r"$\tilde{e}$ [m]", "spread": "spread [m]"}
OF_THE_TAIL = ("tails", "vehicles", "curve", "heat", "heat_worst", "ultimate", "ultimate_mean")
NO_AXES: Mapping[str, object] = {}
LONGEST_FILE_NAME = 100  # letters of a file's name


class LackingError(FolderError):
    """A results folder lacks the data of a figure; the message says how to produce the data."""


def lacking_error(results: Results, what: str, remedy: str) -> LackingError:
    return LackingError(f"{results.place} has no {what}: run the study with {remedy}")


def need_store(results: Results, name: str) -> None:
    if not has_store(results, name):
        raise lacking_error(results, f"{name}.zarr", f"save.{name}=true")


def has_store(results: Results, name: str) -> bool:
    return (results.path / f"{name}.zarr").exists()


def tiled_figure(
    results: Results, metric: str, cells: Sequence[Cell], width: float, axes: dict[str, Any]
) -> Figure:
    tiles = tiling(cells, choose_axes(cells, **axes, most_hues=len(cells)))
    if tiles is None:
        raise lacking_error(results, *TWO_KEYS)
    if tile_table(results).loc[[cell.number for cell in cells], metric].isna().all():
        raise lacking_error(results, *(NO_SHARE if metric == "unrecovered" else NO_ERROR))
    return printed(heat_drawing(results, tiles, metric), width)


def curves_of(results: Results, cells: Sequence[Cell]) -> list[Curve]:
    """Curves against ā; raises LackingError if there are none."""
    if is_leaderless(cells):
        raise LackingError(f"{results.place}: {NO_ULTIMATE_ERROR}")
    found = curves(results, cells)
    if reason := no_magnitudes(found):
        remedy = "an attack and 'sweep.attack.magnitude={geomspace: [0.1, 100, 12]}'"
        words = f"{reason.removesuffix('.')}: run the study with {remedy}"
        raise LackingError(f"{results.place}: {words}")
    return found


def need_search(results: Results, cells: Sequence[Cell]) -> None:
    """Raise LackingError if the folder holds no results of a search of any of these cells."""
    if results.study.config.search is None or not (results.path / "worst.csv").exists():
        raise LackingError(f"{results.place} has no worst.csv: jaxnet search CONFIG makes it")
    if not set(results.worst["cell"]) & {cell.number for cell in cells}:
        words = "no search of these cells has ended: jaxnet search goes on"
        raise LackingError(f"{results.place}: {words}")


def indices_figure(results: Results, metric: str, cells: Sequence[Cell], width: float) -> Figure:
    there = results.file(SENSITIVITY_FILE).exists()
    table: Any = results.sensitivity if there else pd.DataFrame({"metric": [], "cell": []})
    wanted = (table["metric"] == metric) & table["cell"].isin([cell.number for cell in cells])
    if not wanted.any():
        words = f"{SENSITIVITY_FILE} of {metric} in these cells: jaxnet sensitivity makes it"
        raise LackingError(f"{results.place} has no {words}")
    return printed(analyses.sensitivity_drawing(table[wanted], cells), width)


def plot(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Method of `Plots` that selects cells and draws them in its style, without `note` no notes."""

    def drawn(
        self: "Plots",
        where: Where | None = None,
        column: str = "two",
        *,
        note: bool = True,
        **axes: Any,
    ) -> Figure:
        if column not in COLUMN_WIDTHS:
            raise FolderError(f"column: {' or '.join(COLUMN_WIDTHS)} (got {column})")
        cells = select_cells(self.results.study.cells, where or {})
        with mpl.rc_context(self.style):
            made = draw(self, cells, COLUMN_WIDTHS[column], **axes)
            sweep = self.results.study.config.sweep
            notes = label_notes(sweep, [cell.labels for cell in cells])
            if draw.__name__ in OF_THE_TAIL:
                notes += filter(None, [falling_words(self.results, cells)])
            multiples.write_note(made, multiples.escape_dollars("; ".join(notes)))
        if not note:
            made.suptitle("").set_in_layout(False)
        multiples.show_unparsed(made)
        made.style = self.style
        return made

    drawn.__doc__ = draw.__doc__
    return drawn


class Plots:
    """Figures of a results folder.

    Parameters
    ----------
    results
        Results of a finished run.

    Notes
    -----
    Each method takes `where`, the wanted value or values of swept keys, and `column`, "one" or
    "two", the figure's width in columns of a journal. `note=False` leaves out the small line at the
    top, for a paper whose caption says it. `curve` and the heat maps take `x`, `hue` and `panel`,
    swept keys; `curve` takes `y` too. Each method returns a matplotlib figure.

    Raises
    ------
    FolderError
        The folder lacks the figure's data, or an argument is unknown.
    """

    def __init__(self, results: Results, style: style.Style = style.PRINT_STYLE):
        self.results, self.style = results, style

    @property
    def plain(self) -> "Plots":
        """The same figures in matplotlib's own style: of `matplotlibrc`, or `plt.style.use`."""
        return Plots(self.results, style.LAYOUT)

    @plot
    def topologies(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw each graph with its weights and attacked links."""
        return topology.topology_figure(cells, width)

    @plot
    def tails(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw the mean error, or the spread: a dot per lane, a row per cell."""
        return printed(spreads.tails_drawing(self.results, cells), width)

    @plot
    def panels(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw the paper's figure: trajectories of each topology, and the errors over time."""
        there = {name: has_store(self.results, name) for name in ("trajectories", "errors")}
        if not any(there.values()):
            remedy = "save.errors=true or save.trajectories=all"
            raise lacking_error(self.results, "errors.zarr or trajectories.zarr", remedy)
        return panels.panels_figure(self.results, cells, width, **there)

    @plot
    def bands(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw the error, or the spread, over time: median, 5 to 95 % and maximum over lanes."""
        need_store(self.results, "errors")
        words, found = OVER_TIME[variable_over_time(cells)], all_bands(self.results, cells)
        return printed(spreads.bands_drawing(scenes(cells), found, words), width)

    @plot
    def vehicles(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw the mean error of each vehicle over the tail: median, 5 to 95 % and maximum."""
        need_store(self.results, "vehicles")
        found = vehicle_table(self.results, cells)
        if found.empty:
            raise LackingError(f"{self.results.place}: no lane of these cells came to its end")
        recovery = self.results.study.config.recovery
        return printed(spreads.vehicles_drawing(found, cells, recovery), width)

    @plot
    def curve(
        self, cells: Sequence[Cell], width: float, y: str | None = None, **axes: Any
    ) -> Figure:
        """Draw a quantity of lanes with its interval against a swept key.

        `x` and `hue` are swept keys: across, and told apart by colour. None chooses: numbers
        across, kinds in colours. `panel` is the swept key or keys with a panel for each value; None
        takes all keys that are left. `y` is `unrecovered`, `failed`, `in_hull`, a metric (its
        median over lanes), or METRIC_STATISTIC with a statistic of mean, median, q05, q95 and max;
        None takes what the study asks for. As in
        `results.plot.curve(x="attack.magnitude", y="tail_max", hue="topology")`.
        """
        chosen = choose_axes(cells, **axes)
        found = quantity_of(self.results, cells, y or asked_quantity(self.results.study.config))
        if not found.known.size:
            lacking = NO_SHARE if found.name == "unrecovered" else NO_ERROR
            raise lacking_error(self.results, *lacking)
        return printed(swept_drawing(found, chosen, cells), width)

    @plot
    def heat(self, cells: Sequence[Cell], width: float, **axes: Any) -> Figure:
        """Draw a heat map of the share of lanes that do not recover."""
        return tiled_figure(self.results, "unrecovered", cells, width, axes)

    @plot
    def heat_worst(self, cells: Sequence[Cell], width: float, **axes: Any) -> Figure:
        """Draw a heat map of the greatest tail error per ā; without a navigator, of the spread."""
        return tiled_figure(self.results, "worst", cells, width, axes)

    @plot
    def ultimate(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw the greatest tail error against ā, with stored bounds and fits."""
        return printed(ultimate_drawing(curves_of(self.results, cells), "tail_max"), width)

    @plot
    def ultimate_mean(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw the mean tail error against ā, with stored bounds and fits."""
        return printed(ultimate_drawing(curves_of(self.results, cells), "tail_mean"), width)

    @plot
    def search(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw the best value against the number of lanes, for a search and for random lanes."""
        need_search(self.results, cells)
        found = list(search_courses(self.results, cells[:MOST_PANELS]))
        words = worst.metric_with_unit(self.results)
        return printed(analyses.course_drawing(found, len(cells), words), width)

    @plot
    def search_worst(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw a row per cell: the worst choice found, the worst of random lanes, the bound."""
        need_search(self.results, cells)
        words = f"worst {worst.maximised_text(self.results)}"
        return printed(analyses.worst_drawing(worst.worst_rows(self.results), cells, words), width)

    @plot
    def sensitivity(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw Sobol's indices of the mean tail error, or of the spread."""
        return indices_figure(self.results, judged_metric(self.results.study.cells), cells, width)

    @plot
    def sensitivity_unrecovered(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw Sobol's indices of the event that a lane does not recover."""
        return indices_figure(self.results, "unrecovered", cells, width)


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
    """File name of a figure, without extension; what was chosen is part of it."""
    words = [
        f"{key}={value}"
        for key, values in (*axes.items(), *where.items())
        for value in as_list(values)
    ]
    words += ["one-column"] * (column == "one") + ["plain"] * plain + ["no-note"] * (not note)
    told = "-".join([name, *words])
    safe = re.sub(r"[^\w.=-]+", "_", told)
    if safe == told and len(told) <= LONGEST_FILE_NAME:
        return told
    digest = hashlib.sha256(told.encode()).hexdigest()[:6]  # other names may be cut to the same
    return f"{safe[:LONGEST_FILE_NAME]}-{digest}"


def save_figure(results: Results, name: str, figure: Figure) -> Iterator[UPath]:
    """Write one figure as PNG and as PDF; yield both paths."""
    layout = figure.get_layout_engine()
    if layout is not None:  # once for both, for it takes longer than drawing
        with mpl.rc_context(figure.style):
            layout.execute(figure)
    for kind in ("png", "pdf"):
        figure.set_layout_engine(None)  # each file would be drawn twice; saving sets one again
        yield results.folder.put(
            f"figures/{name}.{kind}", lambda file, kind=kind: figure.savefig(file, format=kind)
        )
