"""All figures of a results folder, by name, written as PNG and PDF."""

import hashlib
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import matplotlib as mpl
import pandas as pd
from upath import UPath

from jaxnet.config.cells import Cell, is_leaderless, judged_metric
from jaxnet.config.keys import Config
from jaxnet.config.naming import NO_BREAK, label_notes
from jaxnet.explore.courses import search_courses
from jaxnet.explore.sensitivity import SENSITIVITY_FILE
from jaxnet.kinds.metrics import AGREEMENT, CONTRACT
from jaxnet.kinds.refusals import suggestion
from jaxnet.statistics.axes import choose_axes
from jaxnet.statistics.bands import band_groups, error_bands, variable_over_time, vehicle_table
from jaxnet.statistics.choice import Where, as_list, select_cells
from jaxnet.statistics.curves import MOST_PANELS, Curve, curves, no_magnitudes
from jaxnet.statistics.falling import falling_words
from jaxnet.statistics.fits import NO_ULTIMATE_ERROR
from jaxnet.statistics.groups import evenly, evenly_over
from jaxnet.statistics.horizon import lost_words
from jaxnet.statistics.quantities import (
    FORMATION_NOTE,
    asked_quantity,
    metric_and_statistic,
    quantity_of,
    unended_words,
    values_told,
)
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.statistics.summary import lane_shares
from jaxnet.statistics.tiles import tile_table, tiling
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import MissingKindError
from jaxnet.store.results import Results
from jaxnet.view.drawings import analyses, spreads
from jaxnet.view.drawings.heat import heat_drawing
from jaxnet.view.drawings.swept import answers, swept_drawing
from jaxnet.view.drawings.ultimate import ultimate_drawing
from jaxnet.view.figures import (
    AXES_OF,
    COLUMN_WIDTHS,
    FIGURE_NAMES,
    SEARCH,
    SENSITIVITY,
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
NOT_OF_ERRORS = (*SEARCH, *SENSITIVITY, "topologies")
OVER_TIME = ("panels", "bands")
OF_ENDED_LANES = ("vehicles", "ultimate", "ultimate_mean", *OVER_TIME)
NO_CHOICE: Mapping[str, object] = {}
FILE_KINDS = "png", "pdf"
RETIRED = ("curve_median",)  # figures of earlier versions, which may stand in a folder
LEAST_PANEL = 0.7  # of a panel's height, where a figure has a height of its own
LEAST_HEIGHT = 0.8  # of the height that a figure would take
LONGEST_FILE_NAME = 100  # letters of a file's name


class LackingError(FolderError):
    """A results folder lacks the data of a figure; the message says how to produce the data."""


def lacking_error(results: Results, what: str, remedy: str) -> LackingError:
    return LackingError(f"{results.place} has no {what}: run the study with {remedy}")


def need_store(results: Results, name: str) -> None:
    if not has_store(results, name):
        raise lacking_error(results, f"{name}.zarr", f"save.{name}=true")


def need_lanes(results: Results, cells: Sequence[Cell]) -> None:
    """Raise LackingError if no lane of these cells ended."""
    if not results.cells["ok"].iloc[[cell.number for cell in cells]].any():
        raise LackingError(f"{results.place}: no lane of these cells came to its end")


def has_store(results: Results, name: str) -> bool:
    return (results.path / f"{name}.zarr").exists()


def tiled_figure(
    results: Results, metric: str, cells: Sequence[Cell], width: float, axes: dict[str, Any]
) -> Figure:
    tiles = tiling(cells, choose_axes(cells, **axes, most_hues=len(cells)))
    if tiles is None:
        raise lacking_error(results, *TWO_KEYS)
    need_lanes(results, cells)
    if tile_table(results).loc[[cell.number for cell in cells], metric].isna().all():
        raise lacking_error(results, *(NO_SHARE if metric == "unrecovered" else NO_ERROR))
    return printed(heat_drawing(results, tiles, metric), width)


def curves_of(results: Results, cells: Sequence[Cell]) -> list[Curve]:
    """Curves against ā; raises LackingError if there are none."""
    if is_leaderless(cells):
        raise LackingError(f"{results.place}: {NO_ULTIMATE_ERROR}")
    need_lanes(results, cells)
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
        words = "no search of these cells has ended: jaxnet search resumes it"
        raise LackingError(f"{results.place}: {words}")


def indices_figure(results: Results, metric: str, cells: Sequence[Cell], width: float) -> Figure:
    there = results.file(SENSITIVITY_FILE).exists()
    table: Any = results.sensitivity if there else pd.DataFrame({"metric": [], "cell": []})
    wanted = (table["metric"] == metric) & table["cell"].isin([cell.number for cell in cells])
    if not wanted.any():
        words = f"{SENSITIVITY_FILE} of {metric} in these cells: jaxnet sensitivity makes it"
        raise LackingError(f"{results.place} has no {words}")
    return printed(analyses.sensitivity_drawing(table[wanted], cells), width)


def tail_words(cells: Sequence[Cell]) -> str:
    """What the tail is, if all cells have the same."""
    spans = {(cell.scenario.tail, cell.scenario.horizon) for cell in cells}
    return (
        f"tail: the last {{:g}} of {{:g}}{NO_BREAK}s".format(*spans.pop())
        if len(spans) == 1
        else ""
    )


def about_curve(study: Config, y: str | None) -> tuple[bool, bool]:
    """Whether a curve's quantity is one of the tail, and of errors."""
    name = y or asked_quantity(study)
    if name == "failed" or name in lane_shares(study):
        return name == "unrecovered", name != "failed"
    metric, _ = metric_and_statistic(study, name)
    return metric.over == "tail", metric.name in {*AGREEMENT, *(each.name for each in CONTRACT)}


def plot(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Make a method of `Plots` that selects cells and draws them; `note` adds the small line."""

    def drawn(
        self: "Plots",
        where: Where | None = None,
        column: str = "two",
        *,
        note: bool = True,
        size: style.FigureSize | None = None,
        font_size: float | None = None,
        font: str | None = None,
        **axes: Any,
    ) -> Figure:
        if column not in COLUMN_WIDTHS:
            raise FolderError(f"column: {' or '.join(COLUMN_WIDTHS)} (got {column})")
        cells = select_cells(self.results.study.cells, where or {})
        asked, look = style.inches(size), style.with_font(self.style, font_size, font)
        if asked:
            look["figure.figsize"] = asked[0], asked[1] / LEAST_PANEL
        with mpl.rc_context(look):
            made = draw(self, cells, asked[0] if asked else COLUMN_WIDTHS[column], **axes)
            of_errors = draw.__name__ not in NOT_OF_ERRORS
            over_tail = of_errors and draw.__name__ not in OVER_TIME
            if draw.__name__ == "curve":
                over_tail, of_errors = about_curve(self.results.study.config, axes.get("y"))
            graphs = draw.__name__ == "topologies"
            every = self.results.study.cells

            def named(numbers: Sequence[int]) -> str:
                return values_told([every[number] for number in numbers], cells)

            labels = [topology.graph_labels(cell) if graphs else cell.labels for cell in cells]
            notes = label_notes(self.results.study.config.sweep, labels)
            if over_tail:
                notes.append(tail_words(cells))
            if (over_tail or of_errors) and draw.__name__ not in OVER_TIME:
                notes += [told(self.results, cells, named) for told in (lost_words, falling_words)]
            if draw.__name__ in OF_ENDED_LANES:
                notes.append(unended_words(self.results, [every[each] for each in made.cells]))
            formation = any(cell.scenario.formation.present for cell in cells)
            notes += [FORMATION_NOTE] * (of_errors and formation)
            multiples.write_note(made, multiples.escape_dollars("; ".join(filter(None, notes))))
            multiples.make_room(made)
            made.height = made.get_figheight()
            if asked:
                made.set_size_inches(asked)
        if not note:
            made.supxlabel("").set_in_layout(False)
        multiples.show_unparsed(made)
        made.style = look
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
    "two", the figure's width in columns of a journal. `size`, a pair in inches or text like
    "86x64mm", sets width and height; `font_size` [pt] and `font` set the type. `note=False` leaves
    out the small lines below, for a paper whose caption says it. Curves and the heat maps take
    `x`, `hue` and `panel`, swept keys; `curve` takes `y` too, and `bands` takes `y` and `hue`. Each
    method returns a matplotlib figure.

    Raises
    ------
    FolderError
        The folder lacks the figure's data, or an argument is unknown.
    """

    def __init__(self, results: Results, style: style.Style = style.PRINT_STYLE):
        self.results, self.style = results, style

    @property
    def plain(self) -> "Plots":
        """Figures in matplotlib's own style (`matplotlibrc` or `plt.style.use`)."""
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
    def bands(
        self, cells: Sequence[Cell], width: float, y: str | None = None, hue: str | None = None
    ) -> Figure:
        """Draw the error, or the spread, over time: median, 5 to 95 % and maximum over lanes.

        `y` is another stored series, such as `disagreement`, and `hue` the swept key told apart by
        colour; other keys have panels. None takes the error, and three magnitudes of the attack.
        """
        need_store(self.results, "errors")
        need_lanes(self.results, cells)
        stored, name = self.results.errors, y or variable_over_time(cells)
        if name not in stored:
            known = [*map(str, stored)]
            near = suggestion(name, known, fallback=False)
            raise FolderError(f"y: must be one of {', '.join(known)} (got {name}){near}")
        there = band_groups(cells, hue)
        places = evenly_over([group.labels for group in there], MOST_PANELS)
        groups = [there[place] for place in places]
        found = error_bands(stored[name], [cell for group in groups for cell in group.cells])
        return printed(spreads.bands_drawing(groups, found, name, hue, there), width)

    @plot
    def vehicles(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw the mean error of each vehicle over the tail: median, 5 to 95 % and maximum."""
        need_store(self.results, "vehicles")
        need_lanes(self.results, cells)
        found, recovery = vehicle_table(self.results, cells), self.results.study.config.recovery
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
        if y != "failed":
            need_lanes(self.results, cells)
        found = quantity_of(self.results, cells, y or asked_quantity(self.results.study.config))
        if not found.known.size:
            lacking = NO_SHARE if found.name == "unrecovered" else NO_ERROR
            raise lacking_error(self.results, *lacking)
        return printed(swept_drawing(found, chosen, cells), width)

    @plot
    def answer(self, cells: Sequence[Cell], width: float, **axes: Any) -> Figure:
        """Draw what is first on the page: the median error, or the share of lanes in the hull."""
        first = next(iter(answers(self.results, cells)), None)
        if first is None or first.name == asked_quantity(self.results.study.config):
            raise LackingError(f"{self.results.place}: curve draws what is first on the page")
        return printed(swept_drawing(first, choose_axes(cells, **axes), cells), width)

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
        """Draw the greatest tail error per ā against ā, with stored bounds and fits."""
        return printed(ultimate_drawing(curves_of(self.results, cells), "tail_max"), width)

    @plot
    def ultimate_mean(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw the mean tail error per ā against ā, with stored bounds and fits."""
        return printed(ultimate_drawing(curves_of(self.results, cells), "tail_mean"), width)

    @plot
    def search(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw the best value against the number of lanes, for a search and for random lanes."""
        need_search(self.results, cells)
        found = list(search_courses(self.results, evenly(cells, MOST_PANELS)))
        words = worst.metric_with_unit(self.results)
        return printed(analyses.course_drawing(found, cells, words), width)

    @plot
    def search_worst(self, cells: Sequence[Cell], width: float) -> Figure:
        """Draw a row per cell: the worst choice found, the worst of random lanes, the bound."""
        need_search(self.results, cells)
        words = worst.maximised_text(self.results).replace(", per ā", " / ā")
        drawing = analyses.worst_drawing(worst.worst_rows(self.results), cells, words)
        told = filter(None, [*drawing.notes, worst.bounds_told(self.results)])
        return printed(drawing._replace(notes=[*told]), width)

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
    """Draw the named figures that the folder has data for; yield each file once it is written.

    Files of the others go: they are of other data.
    """
    stale = [*RETIRED]
    for done, name in enumerate(names):
        told("figures drawn", done, len(names))
        if name == "curve" and len(results.study.cells) == 1:
            continue  # one point
        try:
            drawn = getattr(Plots(results), name)()
        except LackingError:
            stale.append(name)
        except MissingKindError:
            continue
        else:
            yield from save_figure(results, name, drawn)
    results.folder.remove(*(f"figures/{name}.{kind}" for name in stale for kind in FILE_KINDS))


def draw_figure(
    results: Results, name: str, where: Where | None = None, plain: bool = False, **chosen: Any
) -> Figure:
    """Draw the figure of this name; `chosen` are arguments of its method, None if not given."""
    if name not in FIGURE_NAMES:
        near = suggestion(name, [*FIGURE_NAMES], fallback=False)
        raise FolderError(f"name: one of {', '.join(FIGURE_NAMES)} (got {name}){near}")
    if name not in SENSITIVITY:
        _ = results.cells  # refuses an unfinished run
    given = {key: value for key, value in chosen.items() if value is not None}
    for key in ("x", "y", "hue", "panel"):
        if key in given and key not in AXES_OF.get(name, ()):
            raise FolderError(f"{name} takes no {key}")
    plots = Plots(results)
    return getattr(plots.plain if plain else plots, name)(where, **given)


def room_words(
    drawn: Figure, size: style.FigureSize | None, draw: Callable[[style.FigureSize], Figure]
) -> str:
    """What a figure leaves out, or that it is too low, and a size that has room; else ""."""
    asked, metric = style.inches(size), str(size).endswith("mm")
    is_low = asked is not None and asked[1] < LEAST_HEIGHT * drawn.height
    told = drawn.left_out or ("too low for its panels" if is_low else "")
    for width in (drawn.get_figwidth(), style.FIGURE_WIDTH) if told else ():
        whole = draw((width, style.GREATEST_HEIGHT))
        if not whole.left_out:
            high = whole.height
            room = f"{width:.4g}x{math.ceil(10 * high) / 10:g}"
            if metric:
                room = f"{25.4 * width:.0f}x{math.ceil(25.4 * high)}mm"
            return f"{told}; --size {room} has room"
    return f"{told}; --where KEY=VALUE chooses" * bool(told)


def file_name(
    name: str,
    where: Where,
    column: str,
    chosen: Mapping[str, object] = NO_CHOICE,
    plain: bool = False,
    note: bool = True,
    cells: Sequence[Cell] = (),
) -> str:
    """File name without extension: the chosen options, in plain letters if cells stay apart."""
    words = [
        f"{key}={value}"
        for key, values in (*chosen.items(), *where.items())
        for value in as_list(values)
    ]
    words += ["one-column"] * (column == "one") + ["plain"] * plain + ["no-note"] * (not note)
    told = "-".join([name, *words])
    safe = file_words(told)
    labels = ({cell.labels[key] for cell in cells if key in cell.labels} for key in where)
    apart = bool(cells) and all(len({*map(file_words, each)}) == len(each) for each in labels)
    apart &= all(file_words(each) == str(each) for each in chosen.values())
    if (safe == told or apart) and len(told) <= LONGEST_FILE_NAME:
        return safe
    digest = hashlib.sha256(told.encode()).hexdigest()[:6]  # other names may be cut to the same
    return f"{safe[:LONGEST_FILE_NAME]}-{digest}"


def file_words(label: object) -> str:
    return re.sub(r"(?:[^\w.=-]|\.(?!\w))+", "_", str(label))


def save_figure(results: Results, name: str, figure: Figure) -> Iterator[UPath]:
    """Write one figure as PNG and as PDF; yield both paths."""
    layout = figure.get_layout_engine()
    if layout is not None:  # once for both, for it takes longer than drawing
        with mpl.rc_context(figure.style):
            layout.execute(figure)
    for kind in FILE_KINDS:
        figure.set_layout_engine(None)  # each file would be drawn twice; saving sets one again
        yield results.folder.put(
            f"figures/{name}.{kind}", lambda file, kind=kind: figure.savefig(file, format=kind)
        )
