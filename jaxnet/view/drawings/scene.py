"""What one lane shows over time: places, links, and what attacked vehicles transmit falsely."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int

from jaxnet.config.cells import Cell
from jaxnet.model import hearing
from jaxnet.model.graph import Digraph, Links


class LaneScene(NamedTuple):
    """A lane, frame by frame. Source 0 is the navigator, or the fleet's centre without one."""

    time: Float[np.ndarray, " times"]
    places: Float[np.ndarray, "times sources 2"]  # of source 0, then of the vehicles [m]
    heading: Float[np.ndarray, "times m"] | None  # [°] counterclockwise from x, if they have one
    off: Float[np.ndarray, "times m"]  # [m] of what the law steers, from source 0
    links: Int[np.ndarray, "2 links"]  # of the graph: listeners, from 0, and sources
    lied: Bool[np.ndarray, " links"]  # attacked links
    kept: Bool[np.ndarray, "times links"]  # whether they are retained
    attacked: list[int]  # attacked vehicles
    about: list[int]  # the source whose place each of them falsifies: itself, or the navigator
    told: Float[np.ndarray, "times attacked 2"]  # where attacked links say that these are [m]
    leaderless: bool
    shape: Float[np.ndarray, "times m 2"] | None  # places in the formation about the centre [m]
    saturated: Bool[np.ndarray, "times m"]
    colliding: Bool[np.ndarray, "times m"]
    arena: tuple[float, float] | None  # half of its sides [m]

    @property
    def truth(self) -> Float[np.ndarray, "times attacked 2"]:
        """Where the sources are that attacked links tell of [m]."""
        return self.places[:, self.about]


def scene_of(lane: xr.Dataset, cell: Cell, graph: Digraph) -> LaneScene:
    vehicles, navigator = lane["states"].values[..., :2], lane["navigator"].values
    attack, attacked = cell.scenario.attack, attacked_vehicles(cell, lane)
    arena = lane.attrs["arena"]
    listeners, slots = graph.edges()
    sources = graph.sources[listeners, slots]
    lied = falsified_links(cell, graph, attacked)[listeners, slots]
    leaderless = not cell.scenario.navigator.present
    centre = fleet_centre(vehicles, attacked) if leaderless else navigator
    places = np.concatenate([centre[:, None], vehicles], axis=1)
    output, offset = (lane[name].values.T for name in ("output", "offset"))
    steered = output - offset
    middle = fleet_centre(steered, attacked) if leaderless else navigator
    # An attack falsifies a vehicle's own place, or the navigator's that it receives.
    about = [0] * len(attacked) if lied[sources == 0].any() else attacked
    base = places[:, about]
    if attack.replaces():  # a link that is replaced carries the navigator's path and the signal
        path = np.zeros_like(centre) if leaderless else navigator
        base = np.repeat(path[:, None], len(attacked), axis=1)
    kept = np.ones((len(places), len(sources)), bool)
    if "kept" in lane:
        kept = hearing.by_link(graph, lane["kept"].values > 0, lane["source"].values)
    return LaneScene(
        lane["time"].values,
        places,
        headings(lane["states"]),
        np.linalg.norm(steered - middle[:, None], axis=-1),
        np.stack([listeners, sources]),
        lied,
        kept,
        attacked,
        about,
        base + lane["attack"].values[:, np.array(attacked, int) - 1],
        leaderless,
        middle[:, None] + offset if offset.any() else None,
        lane["saturated"].values.T,
        lane["colliding"].values.T,
        arena and (arena["x"], arena["y"]),
    )


def attacked_vehicles(cell: Cell, lane: xr.Dataset | None = None) -> list[int]:
    """The attacked vehicles, from 1, or none if the magnitude is 0.

    A vehicle drawn at random counts as attacked if `lane` holds a nonzero attack signal for it.
    """
    attack = cell.scenario.attack
    if attack.amplitude() == 0:
        return []
    if lane is None or attack.targets():
        return attack.targets()
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


def headings(states: xr.DataArray) -> Float[np.ndarray, "times m"] | None:
    """Where each vehicle points [°], counterclockwise from x; None without a heading."""
    if "heading" not in states["state"]:
        return None
    return np.degrees(states.sel(state="heading").values)
