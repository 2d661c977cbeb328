"""Lanes in motion: trajectories, packed for lanes.js."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from html import escape
from string import Template
from typing import Any

import numpy as np

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.naming import labels_title
from jaxnet.config.scenario import situation_of
from jaxnet.runs.replay import pictured
from jaxnet.runs.watched import MOST_VEHICLES, WORST_OF_ALL, Watched, watched
from jaxnet.statistics.curves import LOG_FLOOR, cell_magnitudes, log_ends
from jaxnet.store.results import Results
from jaxnet.view.drawings.scene import LaneScene, scene_of
from jaxnet.view.drawings.words import ROUNDED, error_text
from jaxnet.view.page.elements import (
    Plot,
    about,
    file_text,
    key_html,
    packed,
    plain,
    plot_html,
    script_json,
    swatch,
)
from jaxnet.view.page.plots import TIME_AXIS, decades_axis

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
TOLD, LIAR = "false place in messages", "attacked vehicle"
SHAPE, LIMITED, TOUCHES = "place in the formation", "input saturated", "touches another"
ARENA = {"type": "rect", "line": {"color": "--muted", "width": 1}}
EMPTY = {"data": [], "layout": {}}  # what a lane brings
PLANE_MARGIN = {"l": 62, "r": 12, "t": 6, "b": 48}


def plane_trace(fill: str, name: str, color: str, **look: Any) -> dict[str, Any]:
    """A trace of the plane, which lanes.js fills: lines of a `width`, or markers of a `symbol`.

    Narrow diamonds point ahead: their front half looks out of a vehicle as a triangle.
    """
    drawn = {"type": "scatter", "meta": fill, "name": name, "cliponaxis": False}
    drawn |= {"hoverinfo": "skip", "showlegend": "link" in name, "mode": "lines"}
    symbol = look.get("symbol", "")
    if not symbol:
        return drawn | {"line": {"color": color} | look}
    rim = {"width": 2 if "open" in symbol else 0}
    marker = {"color": color, "size": 10, "line": rim} | look
    if symbol != AHEAD:
        hover = FALSE if fill == "told" else "%{text}"
        words = {"hoverinfo": "all", "hovertemplate": f"{hover}<extra></extra>"}
        drawn |= words | {"showlegend": True}
    return drawn | {"mode": "markers", "marker": marker}


AHEAD = "diamond-tall"
PLANE = [
    plane_trace("dropped", "dropped link", "--muted", width=1, dash="1px,4px"),
    plane_trace("retained", "retained link", "--muted", width=0.8),
    plane_trace("course", "navigator", "--black", width=1.5, dash="2px,3px"),
    plane_trace("trails", "vehicle", "--sky", width=1.2),
    plane_trace("attackedTrails", LIAR, "--red", width=1.4, dash="6px,2px"),
    plane_trace("lies", TOLD, "--purple", width=2),
    plane_trace("told", TOLD, "--purple", symbol="diamond-open"),
    plane_trace("formation", SHAPE, "--muted", symbol="cross-thin-open", size=7),
    plane_trace("honest", "vehicle", "--blue", symbol="circle"),
    plane_trace("honest", "vehicle", "--blue", symbol=AHEAD, size=11, standoff=6),
    plane_trace("attacked", LIAR, "--red", symbol="diamond"),
    plane_trace("attacked", LIAR, "--red", symbol=AHEAD, size=11, standoff=7),
    plane_trace("saturated", LIMITED, "--orange", symbol="circle", size=6),
    plane_trace("colliding", TOUCHES, "--purple", symbol="circle-open", size=18),
    plane_trace("navigator", "navigator", "--black", symbol="square-open"),
]


def lanes_html(lanes: Sequence[dict[str, Any]]) -> str:
    """The stage: choices, controls, the plane, errors and whom vehicles retain."""
    alone, lies = all(lane["leaderless"] for lane in lanes), any(lane["attacked"] for lane in lanes)
    there = {"navigator": not alone, LIAR: lies, TOLD: lies}
    marks = {SHAPE: "formation", LIMITED: "saturated", TOUCHES: "colliding"}
    there |= {name: any(lane[key] for lane in lanes) for name, key in marks.items()}
    there["dropped link"] = any(lane["raster"] for lane in lanes)
    off = "Distance of each vehicle from the mean of honest ones"
    off = off if alone else "Error of each vehicle"
    off += ", less the offsets" * there[SHAPE]
    across, up = {"constrain": "domain"}, {"constrain": "domain", "scaleanchor": "x"}
    layout = {"xaxis": across, "yaxis": up, "margin": PLANE_MARGIN, "shapes": [ARENA]}
    areas = zip(FATES, FATE_COLOURS, strict=True)
    menu = "".join(
        f'<option value="lane-{place}"{about(lane["cells"])}>{escape(lane["label"])}</option>'
        for place, lane in enumerate(lanes)
    )
    return Template(file_text("lanes.html")).substitute(
        lanes=menu,
        key=key_html(trace for trace in PLANE if there.get(trace["name"], True)),
        plane=plot_html(Plot("Positions", None, {"data": PLANE, "layout": layout}), "plane"),
        errors=plot_html(Plot(off, None, EMPTY), "errors"),
        raster=plot_html(Plot("Whom vehicles retain", None, EMPTY), "raster"),
        fates="".join(f"<li>{swatch({'fillcolor': colour})}{name}</li>" for name, colour in areas),
        packs="".join(script_json(lane, f' id="lane-{n}"') for n, lane in enumerate(lanes)),
    )


def lanes_data(results: Results) -> tuple[list[dict[str, Any]], int]:
    """As many lanes as MOST_PAGE_BYTES permits, and the number of stored trajectories.

    The study's worst lane is first, then what a search found. Lanes of more than MOST_VEHICLES
    vehicles are left out.
    """
    there = [*searched_lanes(results), *((results, each) for each in watched(results))]
    there.sort(key=lambda pair: pair[0] is not results or pair[1].why != WORST_OF_ALL)
    found = [
        (of, each)
        for of, each in there
        if of.study.cells[each.cell].scenario.vehicles <= MOST_VEHICLES
    ]
    sizes = [frame_bytes(of.study.cells[each.cell]) for of, each in found[:MOST_PAGE_LANES]]
    room = MOST_PAGE_BYTES / max(sizes, default=1.0)
    many = min(len(found), int(np.clip(room / FEWEST_FRAMES, 1, MOST_PAGE_LANES)))
    frames = int(np.clip(room / max(1, many), FEWEST_FRAMES, MOST_FRAMES))
    lanes = []
    for of, each in found[:many]:
        lane = lane_data(of, each, frames)
        if of is not results:
            lane |= searched_words(results, of)
        lanes.append(lane)
    return lanes, len(there)


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


def searched_words(results: Results, of: Results) -> dict[str, Any]:
    """Cell and label of a lane that a search found."""
    number = int(of.path.name)
    where = labels_title(results.study.cells[number].labels)
    alone = is_leaderless(results.study.cells)
    metric, word = ("spread", "spread") if alone else ("tail_max", "greatest tail error")
    size = error_text(float(of.lanes[metric].iloc[0]))
    told = f"found by the search, cell {number}: {word} {size} m"
    return {"cells": [number], "label": ", ".join(filter(None, [where, told]))}


def frame_bytes(cell: Cell) -> float:
    """Bytes of one frame: four numbers a vehicle, two an attacked one, a byte a link."""
    links = np.count_nonzero(situation_of(cell.scenario).graph.weights)
    numbers = 4 * cell.scenario.vehicles + 2 * cell.scenario.attack.number()
    return CHARACTERS_PER_BYTE * (4 * numbers + links)


def lane_data(results: Results, one: Watched, most: int) -> dict[str, Any]:
    """A lane with at most `most` frames and the last one."""
    cell, data = results.study.cells[one.cell], one.arrays(results)
    outputs = np.arange(data.sizes["time"])
    data = data.isel(time=np.union1d(outputs[:: -(-len(outputs) // most)], outputs[-1:])).load()
    data, graph = pictured(results, one.cell, one.sample, data)
    scene = scene_of(data, cell, graph)
    time, leaderless = scene.time, scene.leaderless
    half, last = len(time) // 2, int(0.75 * len(time))  # it opens at the worst of the last quarter
    lies = np.linalg.norm(scene.told - scene.places[:, :1], axis=-1)
    apart = np.linalg.norm(scene.places[:, 1:] - scene.places[:, :1], axis=-1)
    given = cell.scenario.topology.vehicle_names()
    names = [called(source, given) for source in range(scene.places.shape[1])]
    hears = "hears of the navigator" if 0 in scene.about else "tells its neighbours"
    links = [
        [int(i) + 1, int(j), bool(lies)]
        for (i, j), lies in zip(scene.links.T, scene.lied, strict=True)
    ]
    decides = cell.scenario.defence.decides
    triangle = "" if scene.heading is None else " A triangle points where a vehicle heads."
    step, axis = time[1] - time[0], "{}\u0304" if leaderless else "{}<sub>0</sub>"
    mean = " from the mean" if leaderless else ""
    thinned = f", some of {len(outputs)} output times" if len(time) < len(outputs) else ""
    retained = "" if decides else " Nobody trims here: a vehicle uses every message that it gets."
    return {
        "cells": [one.cell],
        "label": lane_label(results, one, cell),
        "command": results.replay_command(one.cell, one.sample, one.engine),
        "said": f"Shown every {step:.3g} s{thinned}; a path is a smooth curve through its places."
        f"{triangle}{retained}",
        "views": f"around the {'mean of honest vehicles' if leaderless else 'navigator'}",
        "vehicles": scene.places.shape[1] - 1,
        "names": names,
        "attacked": scene.attacked,
        "falsified": scene.about,
        "hover": f"%{{text}}: {'error ' * (not mean)}%{{customdata:.3~g}} m{mean}<extra></extra>",
        "tells": [f"{names[each]} {hears}" for each in scene.attacked],
        "links": links,
        "leaderless": leaderless,
        "shape": "spline" if len(time) <= MOST_CURVED else "linear",
        "worst": last + int(np.nan_to_num(scene.off[last:]).max(axis=1).argmax()),
        "reach": [
            1.05 * greatest_finite(np.abs(scene.places), np.array(scene.arena or 1e-3)),
            max(1e-3, 1.15 * greatest_finite(apart[half:], lies[half:])),
        ],
        "axes": [
            ["x [m]", "y [m]"],
            [f"{name} − {axis.format(name)} [m]" for name in "xy"],
        ],
        "x": packed(scene.places[..., 0].ravel()),
        "y": packed(scene.places[..., 1].ravel()),
        "ahead": None if scene.heading is None else packed(scene.heading.ravel()),
        "formation": None if scene.shape is None else packed(scene.shape.ravel()),
        "saturated": packed(scene.saturated.ravel(), "u1") if scene.saturated.any() else None,
        "colliding": packed(scene.colliding.ravel(), "u1") if scene.colliding.any() else None,
        "arena": scene.arena,
        "told": packed(scene.told.ravel()),
        "errors": errors_figure(scene, names, axis.format("y")),
        "raster": raster_figure(scene, links) if decides else None,
    }


def greatest_finite(*arrays: np.ndarray) -> float:
    """Greatest finite number, 0 without one."""
    known = np.concatenate([np.ravel(each) for each in arrays])
    return float(np.max(known, where=np.isfinite(known), initial=0.0))


def called(source: int, names: Sequence[str]) -> str:
    if source == 0:
        return "the navigator"
    return f"vehicle {source}" + (f" ({plain(names[source - 1])})" if names else "")


def errors_figure(scene: LaneScene, names: Sequence[str], centre: str) -> dict[str, Any]:
    """The error of each vehicle over time, and a cursor."""
    traces, off = [], scene.off
    for vehicle, errors in enumerate(off.T, 1):
        lies = vehicle in scene.attacked
        line: dict[str, Any] = {"color": "--sky", "width": 1.2}
        if lies:
            line = {"color": "--red", "dash": "6px,2px"}
        hover = f"{names[vehicle]}{' (attacked)' * lies}: %{{y:.3~g}} m<extra></extra>"
        drawn = {"type": "scatter", "mode": "lines", "name": LIAR if lies else "vehicle"}
        traces.append(drawn | {"x": [], "y": packed(errors), "line": line, "hovertemplate": hover})
    less = "" if scene.shape is None else " − δ<sub>i</sub>"
    upwards = decades_axis(*log_ends(off)) | {
        "title": {"text": f"‖y<sub>i</sub>{less} − {centre}‖ [m]"}
    }
    layout = {"xaxis": TIME_AXIS, "yaxis": upwards, "shapes": [CURSOR]}
    columns = [f"vehicle {n + 1}" for n in range(off.shape[1])]
    common = {"x": packed(scene.time), "names": columns, "floor": LOG_FLOOR}
    return {"data": traces, "layout": layout} | common


def raster_figure(scene: LaneScene, links: Sequence[list[Any]]) -> dict[str, Any]:
    """Make the raster of links: a row a link, a colour of FATE_COLOURS at each time."""
    fates = 2 * scene.kept.T + scene.lied[:, None]
    steps = [[(n + side) / 4, colour] for n, colour in enumerate(FATE_COLOURS) for side in (0, 1)]
    trace = {"type": "heatmap", "z": packed(fates, "u1"), "zmin": -0.5, "zmax": 3.5}
    trace |= {"colorscale": steps, "showscale": False}
    trace |= {"hovertemplate": "%{text}, t = %{x:.3~g} s<extra></extra>"}
    trace["y"] = [f"{to} ← {source}{' ⚠' if lies else ''}" for to, source, lies in links]
    rows = {"type": "category", "autorange": "reversed", "showgrid": False, "tickfont": {"size": 9}}
    rows["title"] = {"text": "listener ← source"}
    times = {"title": {"text": "t [s]"}, "range": [0, scene.time[-1]], "showgrid": False}
    return {"data": [trace], "layout": {"xaxis": times, "yaxis": rows, "shapes": [CURSOR]}}


def lane_label(results: Results, one: Watched, cell: Cell) -> str:
    """The name of a lane in the page's menu."""
    row = results.row(one.cell, one.sample)
    error = float("nan") if row is None else float(row.loc[cell.scenario.judged])
    where = f"{labels_title(cell.labels)}, " if cell.labels else ""
    by = f", {one.engine} engine" if one.engine else ""
    size = float(cell_magnitudes(results)[one.cell])
    length = error_text(error, size).replace(ROUNDED, "0")
    told = "none, it failed" if np.isnan(error) else f"{length} m"
    word = "spread" if cell.scenario.leaderless else "error"
    return f"{where}cell {one.cell}, sample {one.sample} ({one.why}{by}): {word} {told}"
