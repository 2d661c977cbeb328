"""The paper's figure: a row per attack; trajectories of each topology, and all errors over time."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.gridspec import GridSpec, SubplotSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.keys import WorstLanes
from jaxnet.config.naming import NO_BREAK, value_name
from jaxnet.runs.replay import pictured
from jaxnet.statistics.bands import error_bands, variable_over_time
from jaxnet.statistics.curves import LOG_FLOOR, magnitude_words
from jaxnet.statistics.groups import Label, evenly, evenly_over
from jaxnet.statistics.quantities import SPREAD_WORDS
from jaxnet.store.results import Results
from jaxnet.view.drawings.drawing import LOOKS, Scale
from jaxnet.view.drawings.scene import LaneScene, scene_of
from jaxnet.view.drawings.spreads import band_series
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.printed import draw_series, line_style, mark_ends
from jaxnet.view.figures.style import Figure
from jaxnet.view.figures.topology import topology_name

MOST_APART = 100  # vehicles whose paths can be told from each other; those of more are a density
MOST_A_SIDE = 4  # rows, and columns of trajectories, that a page takes
ROW_HEIGHT = 1.95  # [in]
LEGEND_AND_NOTES = 0.75  # [in], above and below all panels
ERRORS_WIDTH = 1.35  # of a panel of errors, in panels of trajectories
PLANE_ROOM = 0.4  # [in] beside a plane that is as high as its row
ROW_LETTERS = 25  # that a line along a row's height takes
TITLE_LETTERS = 15.5  # of a line across the page, per inch
ERROR_SYMBOLS = {
    "tracking": r"$\tilde{e}$ [m]",
    "spread": "spread [m]",
    "disagreement": r"$\tilde{\epsilon}$ [m]",
}
SYMBOLS_TOLD = "ẽ: mean error of the fleet"
DISAGREEMENT_TOLD = "ε̃: mean disagreement with the sources heard"
BANDS_TOLD = "lines: median of the lanes, bands: 5 to 95 % of lanes"
ERROR_SCALE = Scale("", log=True)
NAVIGATOR_PATH: dict[str, Any] = {"color": style.BLACK, "linewidth": 1.8, "linestyle": (0, (2, 1))}
HONEST_PATH: dict[str, Any] = {"color": style.SKY, "linewidth": 0.7, "linestyle": "-"}
CROWDED_PATHS: dict[str, Any] = {"color": "0.2", "linewidth": 0.25, "rasterized": True, "zorder": 1}
CROWD_INK, CROWD_OPACITY = 150, (0.03, 0.15)  # of all paths of a crowd together, and of one of them
ATTACKED_PATH: dict[str, Any] = {"color": style.RED, "linewidth": 0.9, "linestyle": (0, (4, 1))}
TOLD_PATH: dict[str, Any] = {"color": style.RED, "linewidth": 0.8, "linestyle": (0, (1, 1.5))}
TOLD_PATH |= {"marker": "x", "markersize": 4}  # at its end, for it may stand still
LIMITED_PATH: dict[str, Any] = {"color": style.LIMITED, "linewidth": 2.0, "zorder": 0.5}
TOUCHING_PATH = LIMITED_PATH | {"color": style.PURPLE, "zorder": 0.4, "linewidth": 3.5}
END_SIZE = 5
END: dict[str, Any] = {"color": "0.3", "linestyle": "", "markersize": 3}


def panels_figure(
    results: Results,
    cells: Sequence[Cell],
    width: float = style.FIGURE_WIDTH,
    *,
    trajectories: bool,
    errors: bool,
) -> Figure:
    """Draw a row for each choice of swept keys other than topology; errors stand last in a row.

    At most MOST_A_SIDE rows and topologies are drawn, evenly. Narrow figures wrap their rows.
    """
    judged = "spread" if is_leaderless(cells) else "error"
    whole, narrow = rows_of_cells(cells), width < style.FIGURE_WIDTH
    planes = min(MOST_A_SIDE, max(map(len, whole))) if trajectories else 0
    panels = planes + errors
    columns = 2 if narrow else panels
    lines = -(-panels // columns)
    fitting = int((style.GREATEST_HEIGHT - LEGEND_AND_NOTES) / (ROW_HEIGHT * lines))
    labels = [labels_of_row(row) for row in whole]
    places = evenly_over(labels, min(MOST_A_SIDE, max(1, fitting)))
    rows = [evenly(whole[place], MOST_A_SIDE) for place in places]
    drawn = Figure(figsize=(width, ROW_HEIGHT * lines * len(rows) + LEGEND_AND_NOTES))
    drawn.cells = [cell.number for row in rows for cell in row]
    scenes, samples = stored_scenes(results, rows) if trajectories else ({}, {})
    box, shown = box_of([*scenes.values()]), dict[int, list[str]]()
    along, up = (last - first for first, last in box)
    plane = min(width / (planes + ERRORS_WIDTH), PLANE_ROOM + ROW_HEIGHT * along / up)
    widths = [plane] * planes + [width - plane * planes] * errors
    if narrow or not errors:
        widths = [1.0] * columns
    grid = GridSpec(lines * len(rows), columns, figure=drawn, width_ratios=widths)
    letters, above = iter(map(chr, range(ord("a"), ord("z")))), dict[int, str]()
    for number, row in enumerate(rows):
        spots = [grid[lines * number + n // columns, n % columns] for n in range(panels)]
        if narrow and panels % 2:
            spots[-1] = grid[lines * number + lines - 1, :]  # alone in its line
        titles = [f"({next(letters)})" for _ in range(panels)]
        for place, (cell, spot) in enumerate(zip(row, spots[:planes], strict=False)):
            panel, name = drawn.add_subplot(spot), topology_name(cell)
            new = multiples.escape_dollars(name) if above.get(place) != name else ""
            panel.set_title(f"{titles[place]} {new}".rstrip(), pad=3)
            above[place] = name
            draw_plane(panel, cell, scenes.get(cell.number), box)
            if cell.number in samples:
                shown.setdefault(samples[cell.number], []).append(titles[place])
            if cell is row[0]:
                panel.set_ylabel(f"{multiples.filled_lines(row_caption(cell), ROW_LETTERS)}\ny [m]")
            elif spot.colspan.start == 0:
                panel.set_ylabel("y [m]")
            else:
                panel.tick_params(labelleft=False)
        if errors:
            caption = multiples.filled_lines(row_caption(row[0]), TITLE_LETTERS * width)
            words = caption
            if trajectories:
                words = "" if number else judged + "s" * (judged == "error")
            title = f"{titles[-1]} {words}".rstrip()
            draw_errors(drawn, spots[-1], row, results.errors, title, last=row is rows[-1])
    handles, longest = list[Line2D](), max(rows, key=len)
    if trajectories:
        handles += panels_legend(rows, [*scenes.values()])
    if errors and len(longest) > 1:
        handles += error_keys(longest, f"{judged}, ")
    if handles:
        higher = multiples.write_legend(drawn, handles, handlelength=2.2)
        drawn.set_figheight(min(style.GREATEST_HEIGHT, drawn.get_figheight() + higher))
    if shown:
        whose = lanes_told(results.study.config.save.trajectories, shown)
        multiples.write_note(drawn, f"paths: {whose}; all on one scale")
    if errors:
        words = SPREAD_WORDS if is_leaderless(cells) else SYMBOLS_TOLD
        multiples.write_note(drawn, "; ".join([BANDS_TOLD, words, DISAGREEMENT_TOLD]))
    stores = {"trajectories.zarr": trajectories, "errors.zarr": errors}
    where = " and ".join(store for store, there in stores.items() if there)
    some, every = (
        [{"topology": topology_name(cell)} for cell in max(each, key=len)] for each in (rows, whole)
    )
    parts = ([labels[place] for place in places], labels, "rows"), (some, every, "topologies")
    multiples.write_left_out(drawn, *parts, where=where)
    return drawn


def stored_scenes(
    results: Results, rows: Sequence[Sequence[Cell]]
) -> tuple[dict[int, LaneScene], dict[int, int]]:
    """The scene and the sample of the first stored lane of cells that have one, by number."""
    scenes, samples, paths = dict[int, LaneScene](), dict[int, int](), results.trajectories
    for cell in itertools.chain(*rows):
        if (lane := first_lane(paths, cell)) is not None:
            samples[cell.number] = int(lane["sample"])
            lane, graph = pictured(results, cell.number, samples[cell.number], lane)
            scenes[cell.number] = scene_of(lane, cell, graph)
    return scenes, samples


def first_lane(data: xr.Dataset, cell: Cell) -> xr.Dataset | None:
    """The first stored lane of a cell that has a valid start, or None."""
    paths = data[["states", "inputs", "navigator", "attack"]]
    if "lane" in data.dims:
        mine, along = paths.isel(lane=data["cell"] == cell.number), "lane"
    else:
        mine, along = paths.isel(cell=cell.number), "sample"
    lanes = (mine.isel({along: number}).load() for number in range(mine.sizes[along]))
    return next((lane for lane in lanes if not lane["states"].isel(time=0).isnull().any()), None)


def lanes_told(saved: object, shown: Mapping[int, Sequence[str]]) -> str:
    """Which lanes are drawn: why these, and their samples with the panels that have them."""
    why = "the first stored lane of each cell"
    if isinstance(saved, WorstLanes):
        some = "the worst lane" if saved.worst == 1 else f"one of the {saved.worst} worst lanes"
        why = f"{some} of each cell"
    if len(shown) == 1:
        return f"{why}, sample {next(iter(shown))}"
    each = (f"{sample} in {', '.join(panels)}" for sample, panels in shown.items())
    return f"{why}, sample {', '.join(each)}"


def rows_of_cells(cells: Sequence[Cell]) -> list[list[Cell]]:
    """Cells in rows; cells of a row differ only in their topology."""
    rows: dict[tuple[Label, ...], list[Cell]] = {}
    for cell in cells:
        rows.setdefault(tuple(labels_of_row([cell]).values()), []).append(cell)
    return list(rows.values())


def labels_of_row(cells: Sequence[Cell]) -> dict[str, Label]:
    return {key: value for key, value in cells[0].labels.items() if key != "topology"}


def row_caption(cell: Cell) -> str:
    """A short description of a row: attack, magnitude and other swept values."""
    attack = cell.scenario.attack
    words = [magnitude_words(cell).replace(" ", NO_BREAK)]
    if attack.amplitude() != 0:
        kind = str(cell.labels.get("attack", attack.label or attack.kind))
        words = [f"attack: {value_name('attack', kind)}", *words]
    told = ("topology", "attack", "attack.magnitude")
    words += [value_name(key, value) for key, value in cell.labels.items() if key not in told]
    return multiples.escape_dollars(", ".join(words))


def box_of(lanes: Sequence[LaneScene]) -> list[tuple[float, float]]:
    """Ends of x and y [m] around all paths and arenas; no side is under half the other."""
    points = [lane.places.reshape(-1, 2) for lane in lanes]
    corners = (lane.arena for lane in lanes if lane.arena)
    points += [np.array([corner, np.negative(corner)]) for corner in corners]
    every = np.concatenate([*points, np.zeros((1, 2))] if points else [[[-1.0] * 2, [1.0] * 2]])
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    most = float((high - low).max()) or 1.0
    half = (0.54 * np.fmax(high - low, most / 2)).tolist()
    middle = ((low + high) / 2).tolist()
    return [(at - side, at + side) for at, side in zip(middle, half, strict=True)]


def draw_plane(
    panel: Axes, cell: Cell, lane: LaneScene | None, box: Sequence[tuple[float, float]]
) -> None:
    """Draw the paths of one lane within a box [m]; many vehicles are drawn as a density."""
    panel.set(xlim=box[0], ylim=box[1], aspect="equal", xlabel="x [m]")
    panel.locator_params(nbins=4)
    if lane is None:
        panel.text(0.5, 0.5, "no lane stored", transform=panel.transAxes, ha="center")
        return
    if cell.scenario.navigator.present:
        panel.plot(*lane.places[:, 0].T, **NAVIGATOR_PATH, zorder=3)
    positions, heading, attacked = lane.places[:, 1:], lane.heading, lane.attacked
    if lane.arena:
        x, y = lane.arena
        panel.add_patch(Rectangle((-x, -y), 2 * x, 2 * y, fill=False, edgecolor="0.6"))
    for path in lane.told.swapaxes(0, 1):
        panel.plot(*path.T, **TOLD_PATH, markevery=[-1], zorder=1.5)
    apart = list(range(positions.shape[1]))
    if len(apart) > MOST_APART:
        apart = [vehicle - 1 for vehicle in attacked]
        crowd = np.delete(positions, apart, axis=1).swapaxes(0, 1)
        alpha = np.clip(CROWD_INK / len(crowd), *CROWD_OPACITY)
        paths = LineCollection(list(crowd), alpha=alpha, **CROWDED_PATHS)
        panel.add_collection(paths, autolim=False)
    for vehicle in apart:
        lies = vehicle + 1 in attacked
        look = ATTACKED_PATH if lies else HONEST_PATH
        path = positions[:, vehicle].T
        panel.plot(*path, **look, zorder=2 if lies else 1)
        end = {"color": look["color"], "markersize": 3, "zorder": 4}
        panel.plot(*path[:, 0], "o", markerfacecolor="white", **end)
        for marked, drawn_as in ((lane.saturated, LIMITED_PATH), (lane.colliding, TOUCHING_PATH)):
            if marked[:, vehicle].any():
                panel.plot(*np.where(marked[:, vehicle], path, np.nan), **drawn_as)
        pointed = "s" if heading is None else style.pointer(heading[-1, vehicle])
        panel.plot(*path[:, -1], **end | {"marker": pointed, "markersize": END_SIZE})


def panels_legend(rows: Sequence[Sequence[Cell]], lanes: Sequence[LaneScene]) -> list[Line2D]:
    scenarios = [cell.scenario for row in rows for cell in row]
    fleets = [scenario.vehicles for scenario in scenarios]
    attacks = [scenario.attack for scenario in scenarios]
    lies = any(attack.number() and attack.amplitude() != 0 for attack in attacks)
    pointed = any(lane.heading is not None for lane in lanes)
    pointer: Any = style.pointer(0.0) if pointed else "s"
    entries = {
        "navigator": (NAVIGATOR_PATH, any(each.navigator.present for each in scenarios)),
        "vehicle": (HONEST_PATH, min(fleets) <= MOST_APART),
        "vehicles": ({"color": "0.6", "linewidth": 2.0}, max(fleets) > MOST_APART),
        "attacked vehicle": (ATTACKED_PATH, lies),
        "false place in messages": (TOLD_PATH, lies),
        "start": (END | {"marker": "o", "markerfacecolor": "white"}, True),
        "end": (END | {"marker": pointer, "markersize": END_SIZE}, True),
        "input saturated": (LIMITED_PATH, any(lane.saturated.any() for lane in lanes)),
        "touches another": (TOUCHING_PATH, any(lane.colliding.any() for lane in lanes)),
    }
    return [Line2D([], [], **look, label=name) for name, (look, shown) in entries.items() if shown]


def error_keys(cells: Sequence[Cell], before: str) -> list[Line2D]:
    """Legend entries for the errors or spreads of each topology."""
    return [
        Line2D([], [], label=before + multiples.escape_dollars(topology_name(cell)),
               **line_style(look, "line"))
        for cell, look in zip(cells, LOOKS, strict=False)
    ]  # fmt: skip


def draw_errors(
    drawn: Figure,
    place: SubplotSpec,
    cells: Sequence[Cell],
    data: xr.Dataset,
    title: str,
    last: bool,
) -> None:
    """Draw ẽ, or the spread, above ε̃ on log axes: a median over lanes, a band from 5 to 95 %."""
    inner = place.subgridspec(2, 1, hspace=0.0)
    upper = drawn.add_subplot(inner[0])
    lower = drawn.add_subplot(inner[1], sharex=upper)
    for panel, variable in ((upper, variable_over_time(cells)), (lower, "disagreement")):
        bands = error_bands(data[variable], cells)
        for cell, look in zip(cells, LOOKS, strict=False):
            if band := bands.get(cell.number):
                for series in band_series(band, "", look):
                    draw_series(panel, series, ERROR_SCALE)
        multiples.log_axis(panel, "y", room=ROW_HEIGHT / 2)
        floored = any(band.low.min() <= LOG_FLOOR for band in bands.values())
        mark_ends([panel], ERROR_SCALE, (floored, False), ROW_HEIGHT / 2)
        panel.set_ylabel(ERROR_SYMBOLS[variable])
        panel.grid(True, axis="y", color="0.9", linewidth=0.5)
    upper.tick_params(labelbottom=False)
    upper.set_title(title, pad=3)
    if last:
        lower.set_xlabel("t [s]")
    lower.locator_params(axis="x", nbins=4)
