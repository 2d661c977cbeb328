"""The host's side of a scenario: its graph, links and navigator as NumPy arrays."""

import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxnet.config import keys as config
from jaxnet.config.keys import Scenario
from jaxnet.model import graph
from jaxnet.model.navigator import Lissajous


class Network(NamedTuple):
    """Who hears whom, who lies on which links, who trusts and trims; arrays as in `model.graph`."""

    weights: Float[np.ndarray, "m sources"]
    attacked: Bool[np.ndarray, "m sources"]
    trusted: Bool[np.ndarray, "m sources"]
    theta: Int[np.ndarray, " m"]
    protected: Bool[np.ndarray, " m"]


def network_of(scenario: Scenario) -> Network:
    """The network of a scenario; without a defence nobody trims, without an attack no link is attacked.

    Where weights are drawn, they are here those of `weights_of`; all else is the same whatever is drawn.
    """
    weights, m = weights_of(scenario), scenario.vehicles
    attacked = np.zeros(weights.shape, dtype=bool)
    if isinstance(scenario.attack, config.Attacked):
        attacked = graph.attacked_links(weights, scenario.attack.vehicles, scenario.attack.channel)
    theta, trusted = np.zeros(m, dtype=np.int64), graph.trusted_links(weights, {})
    if isinstance(scenario.defence, config.TrustedTrim):
        trusted = graph.trusted_links(weights, scenario.defence.trusted)
        given = scenario.defence.theta
        each = given if isinstance(given, dict) else dict.fromkeys(range(1, m + 1), given)
        for vehicle, value in each.items():
            theta[vehicle - 1] = value
    return Network(weights, attacked, trusted, theta, graph.protected(weights, trusted, theta))


def weights_of(scenario: Scenario) -> Float[np.ndarray, "m sources"]:
    """Weights of a scenario's graph; where numbers are drawn, of the graph with their medians.

    Who hears whom does not depend on what is drawn.
    """
    match scenario.topology:
        case config.Star():
            return graph.star(scenario.vehicles)
        case config.Cyclic(navigator_weight=weight):
            return graph.cyclic(scenario.vehicles, config.median(weight))
        case config.Path():
            return graph.path(scenario.vehicles)
        case config.Figure1():
            return graph.figure1()
        case config.Edges(edges=edges):
            medians = [(i, j, config.median(weight)) for i, j, weight in edges]
            return graph.weighted(scenario.vehicles, medians)


def weights_are_drawn(scenario: Scenario) -> bool:
    """Whether the graph's weights differ from lane to lane."""
    match scenario.topology:
        case config.Cyclic(navigator_weight=weight):
            return config.is_drawn(weight)
        case config.Edges(edges=edges):
            return any(config.is_drawn(weight) for *_, weight in edges)
    return False


def navigator_of(scenario: Scenario) -> Lissajous:
    """The navigator of a scenario."""
    given = scenario.navigator
    return Lissajous(*(np.array(each) for each in (given.amplitude, given.frequency, given.phase)))


def slowest_of(scenario: Scenario) -> tuple[float, float]:
    """Least speed of a scenario's navigator within its horizon [m/s], and when [s]."""
    given = scenario.navigator
    numbers = (*given.amplitude, *given.frequency, *given.phase)
    return slowest(numbers, scenario.horizon)


@functools.lru_cache
def slowest(numbers: tuple[float, ...], horizon: float) -> tuple[float, float]:
    """The same, remembered, for the cells of a study mostly share their navigator."""
    return Lissajous(*np.array(numbers).reshape(3, 2)).slowest(horizon)
