"""A scenario on the host: its graph and links as NumPy arrays, and its times."""

from typing import NamedTuple

import numpy as np

from jaxnet.config.keys import Scenario
from jaxnet.kinds.fields import is_drawn
from jaxnet.model import hearing
from jaxnet.model.graph import Digraph, Links, normalised, of_links
from jaxnet.model.retained import DropPolicy
from jaxnet.model.safety import Safe


class Situation(NamedTuple):
    """The graph of a scenario, its attacked and trusted links, and the sources that may be retained (None:
    unknown).

    If weights are drawn, the graph has their medians. All lanes of a cell share a situation unless each lane
    draws its own graph.
    """

    graph: Digraph
    attacked: Links
    trusted: Links
    retained: DropPolicy | None


def situation_of(scenario: Scenario) -> Situation:
    """Return the situation of a scenario at the start."""
    graph = scenario.topology.normalised(scenario.vehicles)
    trusted = scenario.defence.trusts(graph)
    attacked = scenario.attack.attacked_links(graph)
    retained = scenario.defence.retained(graph, trusted) if is_ideal(scenario) else None
    return Situation(graph, attacked, trusted, retained)


def is_ideal(scenario: Scenario) -> bool:
    """Return whether vehicles sense without errors and every message arrives, as the theory presupposes."""
    return scenario.sensing.exact() and scenario.channel.loss.perfect()


def safe_in(scenario: Scenario, graph: Digraph, attacked: Links) -> list[Safe]:
    """Return the safe vehicles, by reason, of this graph if these links are attacked.

    A sybil is one more attacked source, and hears the navigator alone. A reason that needs consistent
    announcements is left out if attacked links announce otherwise. No reason is known if vehicles sense with
    errors or messages are lost.
    """
    if not is_ideal(scenario):
        return []
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


def with_sybils(
    graph: Digraph, attacked: Links, trusted: Links, more: int
) -> tuple[Digraph, np.ndarray, np.ndarray]:
    """Return the graph and its attacked and trusted links with `more` additional vehicles for each attacked
    source.
    """
    listeners, slots = graph.edges()
    sources, lies = graph.sources[listeners, slots], attacked[listeners, slots]
    liars, number = np.unique(sources[lies], return_inverse=True)
    sybils = graph.vehicles + 1 + np.arange(len(liars) * more).reshape(-1, more)
    rows = np.concatenate([listeners, listeners[lies].repeat(more), sybils.ravel() - 1])
    columns = np.concatenate([sources, sybils[number].ravel(), np.zeros(sybils.size)])

    def wider(given: np.ndarray, of_sybils: float) -> Digraph:
        values = given[listeners, slots]
        values = np.concatenate([values, values[lies].repeat(more), np.full(sybils.size, of_sybils)])
        return of_links(graph.vehicles + sybils.size, rows, columns, values)

    links = (wider(attacked, 0.0).heard, wider(trusted, 1.0).heard)
    return normalised(wider(graph.weights, 1.0)), *links


def differs_by_lane(scenario: Scenario) -> bool:
    """Return whether lanes have graphs, weights or gains of their own, and therefore bounds of their own."""
    return scenario.topology.differs() or any(map(is_drawn, scenario.gain))


def has_ticks(scenario: Scenario) -> bool:
    """Return whether anything happens at ticks: a decision, a sum of effects, a held jerk, noise, a loss."""
    decides = scenario.defence.decides or scenario.attack.strategic
    holds = scenario.law.holds or not scenario.attack.consistent()
    return (decides or holds or not is_ideal(scenario)) and scenario.tick > 0


def interval_of(scenario: Scenario) -> float:
    """Return the time from tick to tick [s]; without ticks, the output step."""
    return scenario.tick if has_ticks(scenario) else scenario.output_step


def outputs_of(scenario: Scenario) -> int:
    """Return the number of output times after t = 0."""
    return round(scenario.horizon / scenario.output_step)


def sources_of(scenario: Scenario) -> np.ndarray:
    """Return the source of each slot: (slots, m). An attacked source fills one slot for each of its
    identities.
    """
    linked = scenario.topology.linked(scenario.vehicles)
    each = scenario.attack.identities() + scenario.attack.splits()
    return hearing.slots(linked, np.where(scenario.attack.attacked_links(linked), each, 1))
