"""The host's side of a scenario: its graph and its links as NumPy arrays, and when things happen."""

from typing import NamedTuple

import numpy as np

from jaxnet.config.keys import Scenario
from jaxnet.kinds.fields import is_drawn
from jaxnet.model import graph
from jaxnet.model.graph import Links, Weights
from jaxnet.model.retained import AnySubset
from jaxnet.model.safety import Safe


class Situation(NamedTuple):
    """Who hears whom, which links are attacked and trusted, and whom vehicles may retain (None: not known).

    Where weights are drawn, these are of the graph with their medians. All is shared by the lanes of a cell,
    unless its graph is drawn lane by lane.
    """

    weights: Weights
    attacked: Links
    trusted: Links
    retained: AnySubset | None


def situation_of(scenario: Scenario) -> Situation:
    """What is known of a scenario before anything moves."""
    weights = scenario.topology.normalised(scenario.vehicles)
    trusted = scenario.defence.trusts(weights)
    attacked = scenario.attack.links(weights)
    return Situation(weights, attacked, trusted, scenario.defence.retained(weights, trusted))


def safe_in(scenario: Scenario, weights: Weights, attacked: Links) -> list[Safe]:
    """Vehicles that end on the navigator, by reason, on this graph if these of its links are attacked.

    A sybil is one more attacked source, which itself hears the navigator alone.
    """
    m, trusted = len(weights), scenario.defence.trusts(weights)
    twice = np.flatnonzero(attacked.any(axis=0)).repeat(scenario.attack.identities() - 1)
    alone = np.eye(1, m + 1 + len(twice)).repeat(len(twice), axis=0)

    def with_sybils(given: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return np.vstack([np.hstack([given, given[:, twice] * attacked[:, twice]]), rows])

    links = (with_sybils(attacked, alone > 1), with_sybils(trusted, alone > 0))
    found = scenario.defence.safe(graph.normalised(with_sybils(weights, alone)), *links)
    return [Safe(why, vehicles[:m]) for why, vehicles in found]


def differs_by_lane(scenario: Scenario) -> bool:
    """Whether lanes have graphs, weights or gains of their own, and with them bounds of their own."""
    return scenario.topology.differs() or any(map(is_drawn, scenario.gain))


def has_ticks(scenario: Scenario) -> bool:
    """Whether anything happens at ticks: somebody decides, effects are summed up, a jerk is held."""
    something = scenario.defence.decides or scenario.attack.strategic or not scenario.attack.consistent()
    return (something or scenario.law.holds) and scenario.tick > 0


def interval_of(scenario: Scenario) -> float:
    """From tick to tick [s]: where nothing happens at ticks, one is an output step."""
    return scenario.tick if has_ticks(scenario) else scenario.output_step


def outputs_of(scenario: Scenario) -> int:
    """Output times after t = 0."""
    return round(scenario.horizon / scenario.output_step)
