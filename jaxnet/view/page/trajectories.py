"""The replayed lanes' trajectories, packed for the page's slider."""

import re
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float
from upath import UPath

from jaxnet.runs.replay import worst_of
from jaxnet.statistics.curves import size_of
from jaxnet.store.arrays import open_store
from jaxnet.store.results import Results
from jaxnet.view.figures.multiples import title
from jaxnet.view.figures.panels import attacked_vehicles
from jaxnet.view.page import findings
from jaxnet.view.page.elements import measured
from jaxnet.view.page.plots import packed

MOST_FRAMES = 100
MOST_LANES = 60


def lanes(results: Results) -> list[dict[str, Any]]:
    """Trajectories of replayed lanes, at MOST_FRAMES instants at most.

    The worst, which the report asks for, come first and then those that someone else replayed; of each, the
    greatest tail error per ā first.
    """
    found: list[tuple[Any, ...]] = []
    for path in sorted(file.parent for file in results.path.glob("replays/cell-*.zarr/zarr.json")):
        named = re.fullmatch(r"cell-(\d+)-sample-(\d+)(?:-(\w+))?", path.stem)
        row = results.row(int(named[1]), int(named[2])) if named else None
        if named and row is not None:
            cell, sample, error = int(row["cell"]), int(row["sample"]), float(row["tail_mean"])
            found.append((relative(results, cell, error), cell, sample, named[3], error, path))
    worst = set(worst_of(results)) if found else set()
    found.sort(key=lambda each: (each[1:3] not in worst, -each[0], *each[1:3]))
    return [lane(results, each[1:3] in worst, *each[1:]) for each in found[:MOST_LANES]]


def relative(results: Results, cell: int, error: float) -> float:
    """An error per ā, so that lanes of all ā compare; 0 where nobody is attacked or the lane failed."""
    amount = size_of(results.study.cells[cell])
    return error / amount if isinstance(amount, int | float) and amount and np.isfinite(error) else 0.0


def lane(
    results: Results, worst: bool, number: int, sample: int, engine: str | None, error: float, path: UPath
) -> dict[str, Any]:
    """One lane's trajectory."""
    cell, data = results.study.cells[number], open_store(path).isel(lane=0)
    times = data.sizes["time"]
    frames = np.unique(np.linspace(0, times - 1, min(times, MOST_FRAMES)).round().astype(int))
    ahead = headings(data["states"])[frames]
    states = data["states"].values[frames, :, :2]
    navigator = data["navigator"].values[frames]
    where = f"{title(cell.labels)}, " if cell.labels else ""
    by = f", {engine} engine" if engine else ""
    scale = float(findings.scales(results)[number])
    told = f"{measured(error, scale)} m" if not np.isnan(error) else "none, it failed"
    which = "worst" if worst else "replayed"
    return {
        "worst": worst,
        "label": f"{which}: {where}sample {sample}: tail mean {told} (cell {number}{by})",
        "command": results.replay_command(number, sample, engine),
        "vehicles": states.shape[1],
        "attacked": attacked_vehicles(cell),
        "time": packed(data["time"].values[frames]),
        "x": packed(states[..., 0]),
        "y": packed(states[..., 1]),
        "ahead": packed(ahead),
        "navigator_x": packed(navigator[:, 0]),
        "navigator_y": packed(navigator[:, 1]),
        "reach": 1.05 * float(max(np.nanmax(np.abs(states), initial=1.0), np.abs(navigator).max())),
    }


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
