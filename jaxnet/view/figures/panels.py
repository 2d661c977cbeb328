"""The paper's figure: a row per attack; trajectories of each topology, and all errors over time."""

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.gridspec import GridSpec, SubplotSpec
from matplotlib.lines import Line2D

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.naming import NO_BREAK, value_name
from jaxnet.model.graph import Digraph, Links
from jaxnet.statistics.bands import variable_over_time
from jaxnet.statistics.curves import LOG_FLOOR, magnitude_words
from jaxnet.statistics.groups import Label
from jaxnet.statistics.quantities import SPREAD_WORDS
from jaxnet.store.results import Results
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

MOST_APART = 100  # vehicles whose paths can be told from each other; those of more are a density
MOST_A_SIDE = 4  # rows, and columns of trajectories, that a page takes
ROW_HEIGHT = 1.95  # [in]
PANELS_LEGEND_HEIGHT = 0.35  # [in]
ROW_LETTERS = 25  # that a line along a row's height takes
TITLE_LETTERS = 110  # that a line across the page takes
SYMBOLS = {
    "tracking": r"$\tilde{e}$ [m]",
    "spread": "spread [m]",
    "disagreement": r"$\tilde{\epsilon}$ [m]",
}


def panels_figure(
    results: Results,
    cells: Sequence[Cell],
    width: float = style.FIGURE_WIDTH,
    *,
    trajectories: bool,
    errors: bool,
) -> Figure:
    """Draw a row for each choice of swept keys other than topology; errors stand last in a row.

    Only the first MOST_A_SIDE rows and topologies are drawn. Narrow figures wrap their rows.
    """
    whole, narrow = rows_of_cells(cells), width < style.FIGURE_WIDTH
    planes = min(MOST_A_SIDE, max(map(len, whole))) if trajectories else 0
    places, widths = places_of_row(planes, errors, narrow)
    lines = 1 + places[-1][0]
    fitting = int((style.GREATEST_HEIGHT - PANELS_LEGEND_HEIGHT) / (ROW_HEIGHT * lines))
    rows = [row[:MOST_A_SIDE] for row in whole[: min(MOST_A_SIDE, max(1, fitting))]]
    drawn = Figure(figsize=(width, ROW_HEIGHT * lines * len(rows) + PANELS_LEGEND_HEIGHT))
    grid = GridSpec(lines * len(rows), len(widths), figure=drawn, width_ratios=widths)
    letters = iter(map(chr, range(ord("a"), ord("z"))))
    paths = results.trajectories if trajectories else None
    lanes = {} if paths is None else {c.number: first_lane(paths, c) for row in rows for c in row}
    reach = farthest_coordinate(lane for lane in lanes.values() if lane is not None)
    for number, row in enumerate(rows):
        spots = [grid[lines * number + line, column] for line, column in places]
        if trajectories:
            titles = [f"({next(letters)})" for _ in range(planes)]
            draw_trajectories(drawn, spots, titles, row, lanes, reach)
        if errors:
            words = "spread" if is_leaderless(cells) else "errors"
            if not trajectories:
                words = textwrap.fill(row_caption(row[0]), TITLE_LETTERS)
            title, key = f"({next(letters)}) {words}", number == 0 and not narrow
            draw_errors(drawn, spots[-1], row, results.errors, title, key=key)
    if trajectories:
        handles = panels_legend(rows) + (error_keys(rows[0]) if errors and narrow else [])
        multiples.write_legend(drawn, handles, 6, handlelength=2.2)
    if errors and is_leaderless(cells):
        multiples.write_note(drawn, SPREAD_WORDS)
    stores = {"trajectories.zarr": trajectories, "errors.zarr": errors}
    where = " and ".join(store for store, there in stores.items() if there)
    most = max(map(len, rows)), max(map(len, whole)), "topologies"
    multiples.write_left_out(drawn, (len(rows), len(whole), "rows"), most, where=where)
    return drawn


def places_of_row(
    planes: int, errors: bool, narrow: bool
) -> tuple[list[tuple[int, int | slice]], list[float]]:
    """Line and column of each panel of a row, the errors last, and the column widths."""
    places: list[tuple[int, int | slice]]
    if not narrow:
        places = [(0, column) for column in range(planes + errors)]
        return places, [1.0] * planes + [1.35] * errors
    places = [divmod(place, 2) for place in range(planes + errors)]
    if errors and planes % 2 == 0:
        places[-1] = places[-1][0], slice(None)
    return places, [1.0, 1.0]


def first_lane(data: xr.Dataset, cell: Cell) -> xr.Dataset | None:
    """The first stored lane of a cell that has a valid start, or None."""
    paths = data[["states", "navigator", "attack"]]
    if "lane" in data.dims:
        mine, along = paths.isel(lane=data["cell"] == cell.number), "lane"
    else:
        mine, along = paths.isel(cell=cell.number), "sample"
    lanes = (mine.isel({along: number}).load() for number in range(mine.sizes[along]))
    return next((lane for lane in lanes if not lane["states"].isel(time=0).isnull().any()), None)


def farthest_coordinate(lanes: Iterable[xr.Dataset]) -> float:
    """The greatest coordinate of any vehicle or navigator, rounded up [m]."""
    paths = (lane[name].values[..., :2] for lane in lanes for name in ("states", "navigator"))
    return float(np.ceil(1.04 * max((np.nanmax(np.abs(path)) for path in paths), default=1.0)))


def rows_of_cells(cells: Sequence[Cell]) -> list[list[Cell]]:
    """Cells in rows; cells of a row differ only in their topology."""
    rows: dict[tuple[Label, ...], list[Cell]] = {}
    for cell in cells:
        others = tuple(value for key, value in cell.labels.items() if key != "topology")
        rows.setdefault(others, []).append(cell)
    return list(rows.values())


def topology_name(cell: Cell) -> str:
    return str(
        cell.labels.get("topology", cell.scenario.topology.label or cell.scenario.topology.kind)
    )


def figure_name(cell: Cell) -> str:
    return multiples.escape_dollars(topology_name(cell))


def row_caption(cell: Cell) -> str:
    """A short description of a row: attack, magnitude and other swept values."""
    attack = cell.scenario.attack
    words = [magnitude_words(cell).replace(" ", NO_BREAK)]
    if attack.amplitude() != 0:
        words = [f"{cell.labels.get('attack', attack.label or attack.kind)} attack", *words]
    told = ("topology", "attack", "attack.magnitude")
    words += [value_name(key, value) for key, value in cell.labels.items() if key not in told]
    return multiples.escape_dollars(", ".join(words))


def draw_trajectories(
    drawn: Figure,
    spots: Sequence[SubplotSpec],
    titles: Sequence[str],
    cells: Sequence[Cell],
    lanes: Mapping[int, xr.Dataset | None],
    reach: float,
) -> None:
    """Draw paths in the plane, a panel per topology, from -reach to reach [m]."""
    for number, (cell, spot) in enumerate(zip(cells, spots, strict=False)):
        panel = drawn.add_subplot(spot)
        draw_plane(panel, cell, lanes[cell.number])
        panel.set_title(f"{titles[number]} {figure_name(cell)}", pad=3)
        panel.set_xlabel("x [m]")
        if number == 0:
            panel.set_ylabel(f"{textwrap.fill(row_caption(cell), ROW_LETTERS)}\ny [m]")
        elif spot.colspan.start == 0:
            panel.set_ylabel("y [m]")
        else:
            panel.tick_params(labelleft=False)
        panel.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
        panel.locator_params(nbins=5)


def draw_plane(panel: Axes, cell: Cell, lane: xr.Dataset | None) -> None:
    """Draw the paths of one lane; many vehicles are drawn as a density."""
    if lane is None:
        panel.text(0.5, 0.5, "no lane stored", transform=panel.transAxes, ha="center")
        return
    if cell.scenario.navigator.present:
        panel.plot(*lane["navigator"].values.T[:2], **NAVIGATOR_PATH, zorder=3)
    positions = lane["states"].values[:, :, :2]
    attacked = attacked_vehicles(cell, lane)
    apart = list(range(positions.shape[1]))
    if len(apart) > MOST_APART:
        apart = [vehicle - 1 for vehicle in attacked]
        crowd = np.delete(positions, apart, axis=1).swapaxes(0, 1)
        alpha = np.clip(CROWD_INK / len(crowd), *CROWD_OPACITY)
        panel.add_collection(
            LineCollection(list(crowd), alpha=alpha, **CROWDED_PATHS), autolim=False
        )
    for vehicle in apart:
        lies = vehicle + 1 in attacked
        look = ATTACKED_PATH if lies else HONEST_PATH
        x, y = positions[:, vehicle].T
        panel.plot(x, y, **look, zorder=2 if lies else 1)
        panel.plot(
            x[0], y[0], "o", color=look["color"], markersize=3, markerfacecolor="white", zorder=4
        )
        panel.plot(x[-1], y[-1], "s", color=look["color"], markersize=3, zorder=4)


NAVIGATOR_PATH: dict[str, Any] = {"color": style.BLACK, "linewidth": 1.8, "linestyle": (0, (2, 1))}
HONEST_PATH: dict[str, Any] = {"color": style.SKY, "linewidth": 0.7, "linestyle": "-"}
CROWDED_PATHS: dict[str, Any] = {"color": "0.2", "linewidth": 0.25, "rasterized": True, "zorder": 1}
CROWD_INK, CROWD_OPACITY = 150, (0.03, 0.15)  # of all paths of a crowd together, and of one of them
ATTACKED_PATH: dict[str, Any] = {"color": style.RED, "linewidth": 0.9, "linestyle": (0, (4, 1))}


def attacked_vehicles(cell: Cell, lane: xr.Dataset | None = None) -> list[int]:
    """The attacked vehicles, from 1, or none if the magnitude is 0.

    A vehicle drawn at random counts as attacked if `lane` holds a nonzero attack signal for it.
    """
    attack = cell.scenario.attack
    if lane is None or attack.targets() or attack.amplitude() == 0:
        return [] if attack.amplitude() == 0 else attack.targets()
    return (np.flatnonzero(np.nan_to_num(lane["attack"].values).any(axis=(0, 2))) + 1).tolist()


def fleet_centre(
    places: Float[np.ndarray, "times m 2"], attacked: Sequence[int]
) -> Float[np.ndarray, "times 2"]:
    """Mean place [m] of vehicles not attacked, or of all if none; `attacked` counts from 1."""
    honest = np.delete(places, np.array(attacked, int) - 1, axis=1)
    return (honest if honest.shape[1] else places).mean(axis=1)


def falsified_links(cell: Cell, graph: Digraph, attacked: Sequence[int]) -> Links:
    """The links on which these vehicles are attacked: own transmissions or the navigator's."""
    sources, listeners = graph.sources, np.arange(1, graph.vehicles + 1)[:, None]
    links = cell.scenario.attack.attacked_links(graph)
    return links & np.isin(np.where(sources, sources, listeners), attacked)


def panels_legend(rows: Sequence[Sequence[Cell]]) -> list[Line2D]:
    scenarios = [cell.scenario for row in rows for cell in row]
    fleets = [scenario.vehicles for scenario in scenarios]
    attacks = [scenario.attack for scenario in scenarios]
    end: dict[str, Any] = {"color": "0.3", "linestyle": "", "markersize": 3}
    entries = {
        "navigator": (NAVIGATOR_PATH, any(each.navigator.present for each in scenarios)),
        "vehicle": (HONEST_PATH, min(fleets) <= MOST_APART),
        "vehicles": ({"color": "0.6", "linewidth": 2.0}, max(fleets) > MOST_APART),
        "attacked vehicle": (
            ATTACKED_PATH,
            any(a.number() and a.amplitude() != 0 for a in attacks),
        ),
        "start": (end | {"marker": "o", "markerfacecolor": "white"}, True),
        "end": (end | {"marker": "s"}, True),
    }
    return [Line2D([], [], **look, label=name) for name, (look, shown) in entries.items() if shown]


def error_keys(cells: Sequence[Cell]) -> list[Line2D]:
    """Legend entries for the errors or spreads, for panels too small for a legend."""
    pairs = zip(cells, style.SERIES_STYLES, strict=False)
    word = "spread" if is_leaderless(cells) else "error"
    return [Line2D([], [], **look, label=f"{word}, {figure_name(cell)}") for cell, look in pairs]


def draw_errors(
    drawn: Figure,
    place: SubplotSpec,
    cells: Sequence[Cell],
    data: xr.Dataset,
    title: str,
    key: bool,
) -> None:
    """Draw ẽ, or the spread, above ε̃ on log axes: a median over lanes, a band from 5 to 95 %."""
    inner = place.subgridspec(2, 1, hspace=0.0)
    upper: Axes | None = None
    for number, variable in enumerate((variable_over_time(cells), "disagreement")):
        panel = drawn.add_subplot(inner[number], sharex=upper)
        for cell, look in zip(cells, style.SERIES_STYLES, strict=False):
            values = data[variable].isel(cell=cell.number).values
            draw_quantiles(panel, data["time"].values, values, look, figure_name(cell))
        panel.set_yscale("log")
        panel.autoscale_view()
        multiples.log_ticks(panel.yaxis)
        panel.set_ylabel(SYMBOLS[variable])
        panel.grid(True, axis="y", color="0.9", linewidth=0.5)
        if number == 0:
            upper = panel
            panel.tick_params(labelbottom=False)
            panel.set_title(title, pad=3)
            if key:
                panel.legend(loc="best", handlelength=2.2, labelspacing=0.2, borderpad=0.1)
        else:
            panel.set_xlabel("t [s]")
            panel.locator_params(axis="x", nbins=4)


def draw_quantiles(
    panel: Axes, time: np.ndarray, values: np.ndarray, look: style.LineStyle, label: str
) -> None:
    """Draw the median over samples (rows) and the band from 5 to 95 %; omit failed lanes."""
    values = values[~np.isnan(values).any(axis=1)]
    if not len(values):
        return
    low, median, high = np.maximum(LOG_FLOOR, np.quantile(values, [0.05, 0.5, 0.95], axis=0))
    panel.plot(time, median, label=label, **look)
    if len(values) > 1:
        panel.fill_between(time, low, high, color=look["color"], alpha=0.2, linewidth=0)
