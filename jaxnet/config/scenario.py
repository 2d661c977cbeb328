"""The host's side of a scenario: its graph and its links as NumPy arrays, and when things happen."""

from typing import Any, NamedTuple

import numpy as np

from jaxnet.config.keys import Scenario
from jaxnet.kinds.fields import is_drawn
from jaxnet.model import hearing
from jaxnet.model.graph import Digraph, Links, normalised, of_links
from jaxnet.model.retained import AnySubset
from jaxnet.model.safety import Safe


class Situation(NamedTuple):
    """Who hears whom, which links are attacked and trusted, and whom vehicles may retain (None: not known).

    Where weights are drawn, these are of the graph with their medians. All is shared by the lanes of a cell,
    unless its graph is drawn lane by lane.
    """

    graph: Digraph
    attacked: Links
    trusted: Links
    retained: AnySubset | None


def situation_of(scenario: Scenario) -> Situation:
    """What is known of a scenario before anything moves."""
    graph = scenario.topology.normalised(scenario.vehicles)
    trusted = scenario.defence.trusts(graph)
    attacked = scenario.attack.links(graph)
    return Situation(graph, attacked, trusted, scenario.defence.retained(graph, trusted))


def safe_in(scenario: Scenario, graph: Digraph, attacked: Links) -> list[Safe]:
    """Vehicles that end on the navigator, by reason, on this graph if these of its links are attacked.

    A sybil is one more attacked source, which itself hears the navigator alone. A reason that rests on
    consistent announcements does not hold against an attack whose links announce otherwise.
    """
    trusted, more = scenario.defence.trusts(graph), scenario.attack.identities() - 1
    if more:
        graph, attacked, trusted = with_sybils(graph, attacked, trusted, more)
    believable = scenario.attack.announcement().consistent
    found = scenario.defence.safe(graph, attacked, trusted)
    return [
        each._replace(vehicles=each.vehicles[: scenario.vehicles])
        for each in found
        if believable or not each.consistent
    ]


def with_sybils(graph: Digraph, attacked: Links, trusted: Links, more: int) -> tuple[Digraph, Any, Any]:
    """The graph and its attacked and trusted links with so many vehicles more for each attacked source."""
    listeners, slots = graph.edges()
    sources, lies = graph.sources[listeners, slots], attacked[listeners, slots]
    liars, number = np.unique(sources[lies], return_inverse=True)
    sybils = graph.vehicles + 1 + np.arange(len(liars) * more).reshape(-1, more)
    rows = np.concatenate([listeners, listeners[lies].repeat(more), sybils.ravel() - 1])
    columns = np.concatenate([sources, sybils[number].ravel(), np.zeros(sybils.size)])

    def wider(given: Any, of_sybils: float) -> Digraph:
        values = given[listeners, slots]
        values = np.concatenate([values, values[lies].repeat(more), np.full(sybils.size, of_sybils)])
        return of_links(graph.vehicles + sybils.size, rows, columns, values)

    links = (wider(attacked, 0.0).heard, wider(trusted, 1.0).heard)
    return normalised(wider(graph.weights, 1.0)), *links


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


def sources_of(scenario: Scenario) -> np.ndarray:
    """Who is heard slot by slot: attacked sources as often as they have identities."""
    linked = scenario.topology.linked(scenario.vehicles)
    each = scenario.attack.identities() + scenario.attack.splits()
    return hearing.slots(linked, np.where(scenario.attack.links(linked), each, 1))
