"""Lanes with their trajectories, packed for the page's lane viewer."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from jaxnet.config.cells import Cell
from jaxnet.config.naming import labels_title
from jaxnet.config.scenario import situation_of
from jaxnet.model import hearing
from jaxnet.model.graph import Digraph
from jaxnet.runs.watched import MOST_VEHICLES, Watched, watched
from jaxnet.statistics.curves import scales
from jaxnet.store.results import Results
from jaxnet.view.figures.panels import attacked_vehicles, falsified_links
from jaxnet.view.page.elements import measured
from jaxnet.view.page.plots import packed

BUDGET = 1_200_000  # bytes of the page that lanes take, at most
MOST_LANES = 30
MOST_SEARCHED = 6
MOST_FRAMES, FEWEST_FRAMES = 601, 51
LETTERS = 4 / 3  # per byte


def lanes(results: Results) -> tuple[list[dict[str, Any]], int]:
    """As many lanes as the page has room for, and how many have a trajectory in all.

    There is room for none of a large fleet.
    """
    there = [*searched_for(results), *((results, each) for each in watched(results))]
    found = [(of, each) for of, each in there if of.study.cells[each.cell].scenario.vehicles <= MOST_VEHICLES]
    most = max((frame_bytes(of.study.cells[each.cell]) for of, each in found[:MOST_LANES]), default=1.0)
    room = BUDGET / most
    count = min(len(found), int(np.clip(room / FEWEST_FRAMES, 1, MOST_LANES)))
    frames = int(np.clip(room / max(1, count), FEWEST_FRAMES, MOST_FRAMES))
    return [lane(of, each, frames) | about(results, of, each) for of, each in found[:count]], len(there)


def searched_for(results: Results) -> Iterator[tuple[Results, Watched]]:
    """The first lane of what a search found in each cell, the worst for its ā first, of a few cells."""
    if not (results.path / "worst.csv").exists():
        return
    found = results.worst
    order = np.argsort(-(found["found"] / found["magnitude"]).to_numpy(), kind="stable")[:MOST_SEARCHED]
    for cell in found["cell"].to_numpy()[order]:
        alone = replace(results, path=results.path / "worst" / str(cell))
        if (alone.path / "trajectories.zarr").exists():
            yield from ((alone, each) for each in watched(alone)[:1])


def about(results: Results, of: Results, one: Watched) -> dict[str, Any]:
    """Of which cell a lane is, and what it is called, if a search has found it."""
    if of is results:
        return {}
    number = int(of.path.name)
    where = labels_title(results.study.cells[number].labels)
    error = float(of.lanes["tail_max"].iloc[0])
    told = f"found by the search, cell {number}: greatest tail error {measured(error)} m"
    return {"cells": [number], "label": ", ".join(filter(None, [where, told]))}


def frame_bytes(cell: Cell) -> float:
    """What one instant of a lane takes on the page: four numbers a vehicle, two an attacked, a bit a link."""
    links = np.count_nonzero(situation_of(cell.scenario).graph.weights)
    return LETTERS * (4 * (4 * cell.scenario.vehicles + 2 * cell.scenario.attack.number()) + links / 8)


def lane(results: Results, one: Watched, most: int) -> dict[str, Any]:
    """One lane at so many instants at most, and at the last."""
    cell, data = results.study.cells[one.cell], one.arrays()
    outputs = np.arange(data.sizes["time"])
    data = data.isel(time=np.union1d(outputs[:: -(-len(outputs) // most)], outputs[-1:])).load()
    attacked, graph = attacked_vehicles(cell, data), graph_of(results, one, cell)
    listeners, slots = graph.edges()
    sources, false = graph.sources[listeners, slots], falsified_links(cell, graph, attacked)[listeners, slots]
    places, navigator = data["states"].values[..., :2], data["navigator"].values
    given = {
        "cells": [one.cell],
        "sample": one.sample,
        "label": label(results, one, cell),
        "command": results.replay_command(one.cell, one.sample, one.engine),
        "outputs": len(outputs),
        "vehicles": places.shape[1],
        "attacked": attacked,
        "heard_from_navigator": bool(false[sources == 0].any()),
        "replaced": cell.scenario.attack.replaces(),
        "links": [
            [int(i) + 1, int(j), bool(lies)] for i, j, lies in zip(listeners, sources, false, strict=True)
        ],
        "time": packed(data["time"].values),
        "x": packed(places[..., 0]),
        "y": packed(places[..., 1]),
        "ahead": packed(headings(data["states"])),
        "navigator_x": packed(navigator[:, 0]),
        "navigator_y": packed(navigator[:, 1]),
        "error": packed(np.linalg.norm(places - navigator[:, None], axis=-1)),
        "attack": packed(data["attack"].values[:, np.array(attacked, int) - 1]),
    }
    if cell.scenario.defence.decides:
        kept = hearing.by_link(graph, data["kept"].values > 0, data["source"].values)
        given["kept"] = packed(np.packbits(kept), "u1")
    return given


def graph_of(results: Results, one: Watched, cell: Cell) -> Digraph:
    """Who hears whom in a lane, whose graph may be its own."""
    if not cell.scenario.topology.differs():
        return situation_of(cell.scenario).graph
    from jaxnet.lanes.jobs import job, source_of

    made = job(cell.scenario, source_of(results.study.config, cell.scenario), [one.sample])
    return hearing.graph_of(np.asarray(made.network.hearing.sources), np.asarray(made.inputs.lane.weights[0]))


def label(results: Results, one: Watched, cell: Cell) -> str:
    """How the choice of lanes names one."""
    row = results.row(one.cell, one.sample)
    error = float("nan") if row is None else float(row["tail_mean"])
    where = f"{labels_title(cell.labels)}, " if cell.labels else ""
    by = f", {one.engine} engine" if one.engine else ""
    size = float(scales(results)[one.cell])
    told = "none, it failed" if np.isnan(error) else f"{measured(error, size)} m"
    return f"{where}cell {one.cell}, sample {one.sample} ({one.why}{by}): tail mean {told}"


def headings(states: xr.DataArray) -> Float[np.ndarray, "times m"]:
    """Direction in which each vehicle moves [°], counterclockwise from x.

    Its heading, or the opposite while it goes backwards; of states that have none, the path's direction.
    """
    names, values = states["state"].values.tolist(), states.values
    if {"heading", "speed"} <= set(names):
        heading, speed = (values[..., names.index(name)] for name in ("heading", "speed"))
        return np.degrees(heading + np.pi * (speed < 0))
    dx, dy = np.gradient(values[..., 0], axis=0), np.gradient(values[..., 1], axis=0)
    return np.degrees(np.arctan2(dy, dx))
