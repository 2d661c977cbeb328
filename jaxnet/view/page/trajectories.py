"""Lanes in motion: trajectories, packed for lanes.js."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.naming import labels_title
from jaxnet.config.scenario import situation_of
from jaxnet.model import hearing
from jaxnet.model.graph import Digraph
from jaxnet.runs.watched import MOST_VEHICLES, Watched, watched
from jaxnet.statistics.curves import LOG_FLOOR, cell_magnitudes, decades
from jaxnet.store.results import Results
from jaxnet.view.figures.panels import attacked_vehicles, falsified_links, fleet_centre
from jaxnet.view.page.drawings import TIME_AXIS, curve, decades_axis
from jaxnet.view.page.elements import (
    Panel,
    about,
    error_text,
    key_html,
    packed,
    panel_html,
    plain,
    script_json,
    swatch,
)

MOST_PAGE_BYTES = 1_200_000  # bytes of the page that lanes take, at most
MOST_PAGE_LANES = 30
MOST_SEARCHED = 6
MOST_FRAMES, FEWEST_FRAMES = 601, 51
MOST_CURVED = 150  # frames between which paths are curves
CHARACTERS_PER_BYTE = 4 / 3
CURSOR_LINE = {"color": "--text", "width": 1, "dash": "dot"}
CURSOR = {"type": "line", "y0": 0, "y1": 1, "yref": "paper", "line": CURSOR_LINE}
FATES = ("dropped", "dropped, attacked", "retained", "retained, attacked")
FATE_COLOURS = ("--line", "--green", "--sky", "--red")
FALSE = "%{text}: %{customdata:.3~g} m from the truth"
TOLD, LIAR = "place that is told", "attacked vehicle"


def filled_trace(
    fill: str, name: str, color: str, shown: bool = True, **look: Any
) -> dict[str, Any]:
    """A trace of the plane, which lanes.js fills."""
    drawn = curve(name, [], [], color, **look) | {"meta": fill, "showlegend": shown}
    if "marker" in drawn:
        rim = 2 if "open" in drawn["marker"]["symbol"] else 0
        drawn["marker"] |= {"size": 10, "line": {"width": rim}}
    return drawn


def head(fill: str, name: str, color: str, standoff: int) -> dict[str, Any]:
    """Narrow diamonds, of which the front half looks out of a vehicle as a triangle."""
    drawn = filled_trace(fill, name, color, False, symbol="diamond-tall")
    drawn["marker"] |= {"size": 11, "standoff": standoff}
    return drawn


PLANE = [
    filled_trace("dropped", "dropped link", "--muted", width=1, dash="1px,4px"),
    filled_trace("retained", "retained link", "--muted", width=0.8),
    filled_trace("course", "navigator", "--black", False, width=1.5, dash="2px,3px"),
    filled_trace("trails", "vehicle", "--sky", False, width=1.2),
    filled_trace("attackedTrails", LIAR, "--red", False, width=1.4, dash="6px,2px"),
    filled_trace("lies", TOLD, "--purple", False, width=2),
    filled_trace("told", TOLD, "--purple", symbol="diamond-open", hover=FALSE),
    filled_trace("honest", "vehicle", "--blue", symbol="circle", hover="%{text}"),
    head("honest", "vehicle", "--blue", 6),
    filled_trace("attacked", LIAR, "--red", symbol="diamond", hover="%{text}"),
    head("attacked", LIAR, "--red", 7),
    filled_trace("navigator", "navigator", "--black", symbol="square-open", hover="%{text}"),
]


def lanes_html(lanes: Sequence[dict[str, Any]]) -> str:
    """The stage: choices, controls, the plane, errors and whom vehicles retain."""
    alone, lies = all(lane["leaderless"] for lane in lanes), any(lane["attacked"] for lane in lanes)
    there = {"navigator": not alone, LIAR: lies, TOLD: lies}
    there["dropped link"] = any(lane["raster"] for lane in lanes)
    mean = "Distance of each vehicle from the mean of those not attacked"
    margin = {"l": 62, "r": 12, "t": 6, "b": 48}
    across, up = {"constrain": "domain"}, {"constrain": "domain", "scaleanchor": "x"}
    plane = Panel("Positions", None, PLANE, {"xaxis": across, "yaxis": up, "margin": margin})
    errors = Panel(mean if alone else "Error of each vehicle", None, [], {})
    raster = Panel("Whom vehicles retain", None, [], {})
    areas = zip(FATES, FATE_COLOURS, strict=True)
    fates = "".join(f"<li>{swatch({'fillcolor': colour})}{name}</li>" for name, colour in areas)
    menu = "".join(
        f'<option value="lane-{place}"{about(lane["cells"])}>{escape(lane["label"])}</option>'
        for place, lane in enumerate(lanes)
    )
    packs = (script_json(lane, f' id="lane-{place}"') for place, lane in enumerate(lanes))
    return Template((Path(__file__).parent / "lanes.html").read_text(encoding="utf-8")).substitute(
        lanes=menu,
        key=key_html(trace for trace in PLANE if there.get(trace["name"], True)),
        plane=panel_html(plane, "plane"),
        errors=panel_html(errors, "errors"),
        raster=panel_html(raster, "raster"),
        fates=fates,
        packs="".join(packs),
    )


def lanes_data(results: Results) -> tuple[list[dict[str, Any]], int]:
    """As many lanes as MOST_PAGE_BYTES permits, and the number of stored trajectories.

    Lanes of more than MOST_VEHICLES vehicles are left out.
    """
    there = [*searched_lanes(results), *((results, each) for each in watched(results))]
    found = [
        (of, each)
        for of, each in there
        if of.study.cells[each.cell].scenario.vehicles <= MOST_VEHICLES
    ]
    sizes = [frame_bytes(of.study.cells[each.cell]) for of, each in found[:MOST_PAGE_LANES]]
    room = MOST_PAGE_BYTES / max(sizes, default=1.0)
    many = min(len(found), int(np.clip(room / FEWEST_FRAMES, 1, MOST_PAGE_LANES)))
    frames = int(np.clip(room / max(1, many), FEWEST_FRAMES, MOST_FRAMES))
    return [
        lane_data(of, each, frames, searched_words(results, of)) for of, each in found[:many]
    ], len(there)


def searched_lanes(results: Results) -> Iterator[tuple[Results, Watched]]:
    """Yield the first lane of the choices that a search found, the worst per ā first."""
    if not (results.path / "worst.csv").exists():
        return
    found = results.worst
    order = np.argsort(-(found["found"] / found["magnitude"]).to_numpy(), kind="stable")
    for cell in found["cell"].to_numpy()[order[:MOST_SEARCHED]]:
        alone = replace(results, path=results.path / "worst" / str(cell))
        if (alone.path / "trajectories.zarr").exists():
            yield from ((alone, each) for each in watched(alone)[:1])


def searched_words(results: Results, of: Results) -> tuple[int, str] | None:
    """Cell and label of a lane that a search found, None for another lane."""
    if of is results:
        return None
    number = int(of.path.name)
    where = labels_title(results.study.cells[number].labels)
    alone = is_leaderless(results.study.cells)
    metric, word = ("spread", "spread") if alone else ("tail_max", "greatest tail error")
    size = error_text(float(of.lanes[metric].iloc[0]))
    told = f"found by the search, cell {number}: {word} {size} m"
    return number, ", ".join(filter(None, [where, told]))


def frame_bytes(cell: Cell) -> float:
    """Bytes of one frame: four numbers a vehicle, two an attacked one, a byte a link."""
    links = np.count_nonzero(situation_of(cell.scenario).graph.weights)
    numbers = 4 * cell.scenario.vehicles + 2 * cell.scenario.attack.number()
    return CHARACTERS_PER_BYTE * (4 * numbers + links)


def lane_data(
    results: Results, one: Watched, most: int, searched: tuple[int, str] | None = None
) -> dict[str, Any]:
    """A lane with at most `most` frames and the last one."""
    cell, data = results.study.cells[one.cell], one.arrays(results)
    outputs = np.arange(data.sizes["time"])
    data = data.isel(time=np.union1d(outputs[:: -(-len(outputs) // most)], outputs[-1:])).load()
    time, places = data["time"].values, data["states"].values[..., :2]
    attacked, graph = attacked_vehicles(cell, data), lane_graph(results, one, cell)
    listeners, slots = graph.edges()
    sources = graph.sources[listeners, slots]
    false = falsified_links(cell, graph, attacked)[listeners, slots]
    leaderless = not cell.scenario.navigator.present
    centre = fleet_centre(places, attacked) if leaderless else data["navigator"].values
    everybody = np.concatenate([centre[:, None], places], axis=1)
    off = np.linalg.norm(places - centre[:, None], axis=-1)
    # An attack falsifies a vehicle's own place, or the navigator's that it hears.
    of_navigator = bool(false[sources == 0].any())
    falsified = np.zeros(len(attacked), int) if of_navigator else np.array(attacked, int)
    base = everybody[:, falsified]
    if cell.scenario.attack.replaces():  # a link that is replaced carries the signal alone
        base = np.zeros_like(base) if leaderless else np.repeat(centre[:, None], len(attacked), 1)
    told = base + data["attack"].values[:, np.array(attacked, int) - 1]
    lies, half = np.linalg.norm(told - centre[:, None], axis=-1), len(time) // 2
    names = [called(n, cell.scenario.topology.vehicle_names()) for n in range(places.shape[1] + 1)]
    hears = "hears of the navigator" if of_navigator else "tells its neighbours"
    number, label = searched or (one.cell, lane_label(results, one, cell))
    links = [
        [int(i) + 1, int(j), bool(lies)]
        for i, j, lies in zip(listeners, sources, false, strict=True)
    ]
    raster = None
    if cell.scenario.defence.decides:
        kept = hearing.by_link(graph, data["kept"].values > 0, data["source"].values)
        raster = raster_figure(links, 2 * kept.T + false[:, None], time)
    axis = "{}\u0304" if leaderless else "{}<sub>0</sub>"
    return {
        "cells": [number],
        "sample": one.sample,
        "label": label,
        "command": results.replay_command(one.cell, one.sample, one.engine),
        "said": lane_words(label, time, len(outputs), raster is not None),
        "views": f"around the {'mean of vehicles not attacked' if leaderless else 'navigator'}",
        "vehicles": places.shape[1],
        "names": names,
        "attacked": attacked,
        "falsified": falsified.tolist(),
        "hover": f"%{{text}}: {'' if leaderless else 'error '}%{{customdata:.3~g}} m"
        f"{' from the mean' if leaderless else ''}<extra></extra>",
        "tells": [f"{names[each]} {hears}" for each in attacked],
        "links": links,
        "leaderless": leaderless,
        "shape": "spline" if len(time) <= MOST_CURVED else "linear",
        "worst": worst_frame(off),
        "reach": [
            max(1.0, 1.05 * greatest_finite(np.abs(everybody))),
            max(1e-3, 1.15 * greatest_finite(off[half:], lies[half:])),
        ],
        "axes": [
            ["x [m]", "y [m]"],
            [f"{name} − {axis.format(name)} [m]" for name in "xy"],
        ],
        "x": packed(everybody[..., 0].ravel()),
        "y": packed(everybody[..., 1].ravel()),
        "ahead": packed(headings(data["states"]).ravel()),
        "told": packed(told.ravel()),
        "errors": errors_figure(time, off, names, attacked, axis.format("y")),
        "raster": raster,
    }


def greatest_finite(*arrays: np.ndarray) -> float:
    """Greatest finite number, 0 without one."""
    known = np.concatenate([np.ravel(each) for each in arrays])
    return float(np.max(known, where=np.isfinite(known), initial=0.0))


def worst_frame(off: Float[np.ndarray, "times m"]) -> int:
    """The frame of the last quarter at which a vehicle is farthest off."""
    first = int(0.75 * len(off))
    return first + int(np.nan_to_num(off[first:]).max(axis=1).argmax())


def called(source: int, names: Sequence[str]) -> str:
    if source == 0:
        return "the navigator"
    return f"vehicle {source}" + (f" ({plain(names[source - 1])})" if names else "")


def errors_figure(
    time: np.ndarray, off: np.ndarray, names: Sequence[str], attacked: Sequence[int], centre: str
) -> dict[str, Any]:
    """The error of each vehicle over time, and a cursor."""
    traces = []
    for vehicle in range(1, off.shape[1] + 1):
        look: dict[str, Any] = {"color": "--sky", "width": 1.2}
        told, name = "", "vehicle"
        if vehicle in attacked:
            look, told, name = {"color": "--red", "dash": "6px,2px"}, " (attacked)", LIAR
        hover = f"{names[vehicle]}{told}: %{{y:.3~g}} m"
        traces.append(curve(name, [], packed(off[:, vehicle - 1]), hover=hover, **look))
    known = off[np.isfinite(off) & (off > LOG_FLOOR)]
    ends = decades(known.min(initial=np.inf), known.max()) if known.size else (LOG_FLOOR, 1.0)
    upwards = decades_axis(*ends, f"‖y<sub>i</sub> − {centre}‖ [m]")
    layout = {"xaxis": TIME_AXIS, "yaxis": upwards, "shapes": [CURSOR]}
    columns = {"time": "x"} | {f"vehicle {n + 1}": n for n in range(off.shape[1])}
    extra = {"x": packed(time), "floor": LOG_FLOOR}
    return Panel("", None, traces, layout, columns, extra).figure


def raster_figure(
    links: Sequence[list[Any]], fates: np.ndarray, time: np.ndarray
) -> dict[str, Any]:
    """Whom vehicles retain: a row a link, a colour of FATE_COLOURS at each time."""
    steps = [[(n + side) / 4, colour] for n, colour in enumerate(FATE_COLOURS) for side in (0, 1)]
    trace = {"type": "heatmap", "z": packed(fates, "u1"), "zmin": -0.5, "zmax": 3.5}
    trace |= {"colorscale": steps, "showscale": False}
    trace |= {"hovertemplate": "%{text}, t = %{x:.3~g} s<extra></extra>"}
    trace["y"] = [f"{to} ← {source}{' ⚠' if lies else ''}" for to, source, lies in links]
    rows = {"type": "category", "autorange": "reversed", "showgrid": False, "tickfont": {"size": 9}}
    rows["title"] = {"text": "listener ← source"}
    times = {"title": {"text": "t [s]"}, "range": [0, time[-1]], "showgrid": False}
    return {"data": [trace], "layout": {"xaxis": times, "yaxis": rows, "shapes": [CURSOR]}}


def lane_words(label: str, time: np.ndarray, outputs: int, trims: bool) -> str:
    thinned = f", some of {outputs} output times" if len(time) < outputs else ""
    kept = "" if trims else " Nobody trims here: every source is retained at all times."
    return (
        f"{label}. Shown every {time[1] - time[0]:.3g} s{thinned}; a path is a smooth curve through"
        f" its places. A triangle points where a vehicle heads.{kept}"
    )


def lane_graph(results: Results, one: Watched, cell: Cell) -> Digraph:
    """The graph of a lane, which may differ from the cell's graph."""
    if not cell.scenario.topology.differs():
        return situation_of(cell.scenario).graph
    from jaxnet.lanes.jobs import job, source_of

    made = job(cell.scenario, source_of(results.study.config, cell.scenario), [one.sample])
    return hearing.graph_of(
        np.asarray(made.network.hearing.sources), np.asarray(made.inputs.lane.weights[0])
    )


def lane_label(results: Results, one: Watched, cell: Cell) -> str:
    """The name of a lane in the page's menu."""
    row = results.row(one.cell, one.sample)
    error = float("nan") if row is None else float(row.loc[cell.scenario.judged])
    where = f"{labels_title(cell.labels)}, " if cell.labels else ""
    by = f", {one.engine} engine" if one.engine else ""
    size = float(cell_magnitudes(results)[one.cell])
    told = "none, it failed" if np.isnan(error) else f"{error_text(error, size)} m"
    word = "spread" if cell.scenario.leaderless else "tail mean"
    return f"{where}cell {one.cell}, sample {one.sample} ({one.why}{by}): {word} {told}"


def headings(states: xr.DataArray) -> Float[np.ndarray, "times m"]:
    """Direction of motion of each vehicle [°], counterclockwise from x.

    A vehicle that drives backwards moves against its heading. Without a heading in the states, the
    path's direction serves.
    """
    names, values = states["state"].values.tolist(), states.values
    if {"heading", "speed"} <= set(names):
        heading, speed = (values[..., names.index(name)] for name in ("heading", "speed"))
        return np.degrees(heading + np.pi * (speed < 0))
    dx, dy = np.gradient(values[..., 0], axis=0), np.gradient(values[..., 1], axis=0)
    return np.degrees(np.arctan2(dy, dx))
