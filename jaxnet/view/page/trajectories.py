"""Trajectories of lanes, packed for the page's animation."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import xarray as xr
from jaxtyping import Float

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.naming import labels_title
from jaxnet.config.scenario import situation_of
from jaxnet.model import hearing
from jaxnet.model.graph import Digraph
from jaxnet.runs.watched import MOST_VEHICLES, Watched, watched
from jaxnet.statistics.curves import cell_magnitudes
from jaxnet.store.results import Results
from jaxnet.view.figures.panels import attacked_vehicles, falsified_links, fleet_centre
from jaxnet.view.page.elements import error_text
from jaxnet.view.page.plots import pack_numbers

MOST_PAGE_BYTES = 1_200_000  # bytes of the page that lanes take, at most
MOST_PAGE_LANES = 30
MOST_SEARCHED = 6
MOST_FRAMES, FEWEST_FRAMES = 601, 51
CHARACTERS_PER_BYTE = 4 / 3  # per byte


def lanes_data(results: Results) -> tuple[list[dict[str, object]], int]:
    """Return as many lanes as MOST_PAGE_BYTES permits, and the number of stored trajectories.

    Lanes of more than MOST_VEHICLES vehicles are left out.
    """
    there = [*searched_lanes(results), *((results, each) for each in watched(results))]
    found = [
        (of, each)
        for of, each in there
        if of.study.cells[each.cell].scenario.vehicles <= MOST_VEHICLES
    ]
    most = max(
        (frame_bytes(of.study.cells[each.cell]) for of, each in found[:MOST_PAGE_LANES]),
        default=1.0,
    )
    room = MOST_PAGE_BYTES / most
    count = min(len(found), int(np.clip(room / FEWEST_FRAMES, 1, MOST_PAGE_LANES)))
    frames = int(np.clip(room / max(1, count), FEWEST_FRAMES, MOST_FRAMES))
    return [
        lane_data(of, each, frames) | search_label(results, of, each) for of, each in found[:count]
    ], len(there)


def searched_lanes(results: Results) -> Iterator[tuple[Results, Watched]]:
    """Yield the first lane of the choices that a search found, the worst per ā first."""
    if not (results.path / "worst.csv").exists():
        return
    found = results.worst
    order = np.argsort(-(found["found"] / found["magnitude"]).to_numpy(), kind="stable")[
        :MOST_SEARCHED
    ]
    for cell in found["cell"].to_numpy()[order]:
        alone = replace(results, path=results.path / "worst" / str(cell))
        if (alone.path / "trajectories.zarr").exists():
            yield from ((alone, each) for each in watched(alone)[:1])


def search_label(results: Results, of: Results, one: Watched) -> dict[str, object]:
    """Return cell and label of a lane that a search found; nothing for another lane."""
    if of is results:
        return {}
    number = int(of.path.name)
    where = labels_title(results.study.cells[number].labels)
    alone = is_leaderless(results.study.cells)
    metric, word = ("spread", "spread") if alone else ("tail_max", "greatest tail error")
    told = f"found by the search, cell {number}: {word} {error_text(float(of.lanes[metric].iloc[0]))} m"
    return {"cells": [number], "label": ", ".join(filter(None, [where, told]))}


def frame_bytes(cell: Cell) -> float:
    """Return the bytes of one frame: four numbers a vehicle, two an attacked one, a bit a link."""
    links = np.count_nonzero(situation_of(cell.scenario).graph.weights)
    return CHARACTERS_PER_BYTE * (
        4 * (4 * cell.scenario.vehicles + 2 * cell.scenario.attack.number()) + links / 8
    )


def lane_data(results: Results, one: Watched, most: int) -> dict[str, object]:
    """Return a lane with at most `most` frames and the last one."""
    cell, data = results.study.cells[one.cell], one.arrays(results)
    outputs = np.arange(data.sizes["time"])
    data = data.isel(time=np.union1d(outputs[:: -(-len(outputs) // most)], outputs[-1:])).load()
    attacked, graph = attacked_vehicles(cell, data), lane_graph(results, one, cell)
    listeners, slots = graph.edges()
    sources, false = (
        graph.sources[listeners, slots],
        falsified_links(cell, graph, attacked)[listeners, slots],
    )
    places, leaderless = data["states"].values[..., :2], not cell.scenario.navigator.present
    centre = fleet_centre(places, attacked) if leaderless else data["navigator"].values
    given = {
        "cells": [one.cell],
        "sample": one.sample,
        "label": lane_label(results, one, cell),
        "command": results.replay_command(one.cell, one.sample, one.engine),
        "outputs": len(outputs),
        "vehicles": places.shape[1],
        "names": list(cell.scenario.topology.vehicle_names()),
        "attacked": attacked,
        "heard_from_navigator": bool(false[sources == 0].any()),
        "replaced": cell.scenario.attack.replaces(),
        "links": [
            [int(i) + 1, int(j), bool(lies)]
            for i, j, lies in zip(listeners, sources, false, strict=True)
        ],
        "time": pack_numbers(data["time"].values),
        "x": pack_numbers(places[..., 0]),
        "y": pack_numbers(places[..., 1]),
        "ahead": pack_numbers(headings(data["states"])),
        "leaderless": leaderless,
        "centre_x": pack_numbers(centre[:, 0]),
        "centre_y": pack_numbers(centre[:, 1]),
        "error": pack_numbers(np.linalg.norm(places - centre[:, None], axis=-1)),
        "attack": pack_numbers(data["attack"].values[:, np.array(attacked, int) - 1]),
    }
    if cell.scenario.defence.decides:
        kept = hearing.by_link(graph, data["kept"].values > 0, data["source"].values)
        given["kept"] = pack_numbers(np.packbits(kept), "u1")
    return given


def lane_graph(results: Results, one: Watched, cell: Cell) -> Digraph:
    """Return the graph of a lane, which may differ from the cell's graph."""
    if not cell.scenario.topology.differs():
        return situation_of(cell.scenario).graph
    from jaxnet.lanes.jobs import job, source_of

    made = job(cell.scenario, source_of(results.study.config, cell.scenario), [one.sample])
    return hearing.graph_of(
        np.asarray(made.network.hearing.sources), np.asarray(made.inputs.lane.weights[0])
    )


def lane_label(results: Results, one: Watched, cell: Cell) -> str:
    """Return the name of a lane in the page's menu."""
    row = results.row(one.cell, one.sample)
    error = float("nan") if row is None else float(row.loc[cell.scenario.judged])
    where = f"{labels_title(cell.labels)}, " if cell.labels else ""
    by = f", {one.engine} engine" if one.engine else ""
    size = float(cell_magnitudes(results)[one.cell])
    told = "none, it failed" if np.isnan(error) else f"{error_text(error, size)} m"
    word = "spread" if cell.scenario.leaderless else "tail mean"
    return f"{where}cell {one.cell}, sample {one.sample} ({one.why}{by}): {word} {told}"


def headings(states: xr.DataArray) -> Float[np.ndarray, "times m"]:
    """Return the direction of motion of each vehicle [°], counterclockwise from x.

    A vehicle that drives backwards moves against its heading. Without a heading in the states, the path's
    direction serves.
    """
    names, values = states["state"].values.tolist(), states.values
    if {"heading", "speed"} <= set(names):
        heading, speed = (values[..., names.index(name)] for name in ("heading", "speed"))
        return np.degrees(heading + np.pi * (speed < 0))
    dx, dy = np.gradient(values[..., 0], axis=0), np.gradient(values[..., 1], axis=0)
    return np.degrees(np.arctan2(dy, dx))
