"""A scenario on the host: its graph and links as NumPy arrays, its times, and premises of theorems."""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from jaxnet.config.keys import Scenario
from jaxnet.model import hearing, safety
from jaxnet.model.graph import Digraph, Links, normalised, of_links
from jaxnet.model.retained import DropPolicy
from jaxnet.model.safety import Safe

MOST_DRAWN_SETS = 1_000  # sets of attacked vehicles that are tried one by one, 1 to 2 ms each


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
    graph = scenario_graph(scenario)
    trusted = scenario.defence.trusts(graph)
    attacked = scenario.attack.attacked_links(graph)
    retained = scenario.defence.retained(graph, trusted) if is_ideal(scenario) else None
    return Situation(graph, attacked, trusted, retained)


def scenario_graph(scenario: Scenario) -> Digraph:
    """Return the graph of a scenario, with rows that sum to 1; without a navigator, without its links."""
    graph = scenario.topology.normalised_rows(scenario.vehicles)
    return graph if scenario.navigator.present else normalised(without_navigator(graph))


def links_of(scenario: Scenario) -> Digraph:
    """Return the graph of the possible links, each with weight 1."""
    linked = scenario.topology.linked(scenario.vehicles)
    return linked if scenario.navigator.present else without_navigator(linked)


def without_navigator(graph: Digraph) -> Digraph:
    """Return a graph without the links from the navigator."""
    return graph.only(graph.heard & (graph.sources != 0))


def is_ideal(scenario: Scenario) -> bool:
    """Return whether the theory's premises hold: exact sensors, one network, and every message arrives at
    once.
    """
    one_network = len(scenario.topology.turns()) == 1
    channel = scenario.channel.loss.perfect() and scenario.channel.noise.exact()
    channel = channel and not scenario.channel.rounded
    return scenario.sensing.exact() and channel and not scenario.channel.late and one_network


def safe_in(scenario: Scenario, graph: Digraph, attacked: Links) -> list[Safe]:
    """Return the safe vehicles, by reason, of this graph if these links are attacked.

    A sybil is one more attacked source, and hears the navigator alone. A reason that needs consistent
    announcements is left out if attacked links announce otherwise. No reason is known without the premises
    of MOTION. A vehicle that moves as it tells is not safe.
    """
    if broken_premise(scenario, MOTION):
        return []
    honest = ~movers(scenario, graph, attacked)
    trusted, more = scenario.defence.trusts(graph), scenario.attack.identities() - 1
    if more:
        graph, attacked, trusted = with_sybils(graph, attacked, trusted, more)
    believable = scenario.attack.announcement().consistent
    found = scenario.defence.safe(graph, attacked, trusted)
    return [
        each._replace(vehicles=each.vehicles[: scenario.vehicles] & honest)
        for each in found
        if believable or not each.consistent
    ]


def movers(scenario: Scenario, graph: Digraph, attacked: Links) -> np.ndarray:
    """Return the vehicles that may move as they tell if these links are attacked: (m,).

    A drawn vehicle that nobody hears may do so too.
    """
    everyone, attack = np.arange(1, graph.vehicles + 1), scenario.attack
    if not attack.as_told():
        return everyone < 0
    if attack.targets():
        return np.isin(everyone, attack.targets())
    return np.isin(everyone, graph.sources[attacked]) | ~np.isin(
        everyone, graph.sources[graph.heard]
    )


def attacked_draws(scenario: Scenario, graph: Digraph) -> list[Links] | None:
    """Return the attacked links for each set of vehicles that a lane may draw, None for too many sets.

    Where vehicles are listed or nobody is attacked, there is one set.
    """
    attack = scenario.attack
    if not attack.present or attack.targets() or not attack.number():
        return [attack.attacked_links(graph)]
    if math.comb(scenario.vehicles, attack.number()) > MOST_DRAWN_SETS:
        return None
    sets = itertools.combinations(range(1, scenario.vehicles + 1), attack.number())
    return [attack.on([*each]).attacked_links(graph) for each in sets]


def safe_in_all(scenario: Scenario, graph: Digraph, draws: Sequence[Links]) -> list[Safe]:
    """Return the vehicles that are safe whichever of several sets of links is attacked.

    A vehicle has the weakest of its reasons.
    """
    each = [safe_in(scenario, graph, attacked) for attacked in draws]
    if len(each) == 1:
        return each[0]
    reasons = {short_reason(reason): reason for found in reversed(each) for reason in found}
    by_reason = [{short_reason(reason): reason.vehicles for reason in found} for found in each]
    nobody = np.zeros(scenario.vehicles, bool)
    flags = np.array([[found.get(why, nobody) for why in reasons] for found in by_reason])
    weakest = np.where(flags.any(axis=1), flags.argmax(axis=1), len(reasons)).max(axis=0)
    return [
        reason._replace(why=why, vehicles=weakest == rank)
        for rank, (why, reason) in enumerate(reasons.items())
    ]


def short_reason(reason: Safe) -> str:
    """Return a reason without its numbers, which differ from one set of attacked links to another."""
    return reason.why.partition(",")[0]


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
        values = np.concatenate(
            [values, values[lies].repeat(more), np.full(sybils.size, of_sybils)]
        )
        return of_links(graph.vehicles + sybils.size, rows, columns, values)

    links = (wider(attacked, 0.0).heard, wider(trusted, 1.0).heard)
    return normalised(wider(graph.weights, 1.0)), *links


def differs_by_lane(scenario: Scenario) -> bool:
    """Return whether lanes have graphs, weights or gains of their own, and therefore bounds of their own."""
    return scenario.topology.differs() or scenario.draws_gain


class Premise(NamedTuple):
    """What a theorem needs of a scenario, and what is said of a scenario without it."""

    holds: Callable[[Scenario], bool]
    broken: str


def settles(scenario: Scenario) -> bool:
    """Return whether errors die away with the gains in use: one gain, weights that stay, or no cycle."""
    if scenario.own_gains is None:
        return True
    graph, _, _, kept = situation_of(scenario)
    if kept is not None and kept.fixed is not None:
        return True
    one = DropPolicy(
        graph, graph.heard, graph.heard.sum(axis=1) - 1
    )  # all sources but one are dropped
    return bool(safety.stay_joined(one, np.ones(graph.vehicles, bool)).all())


PREMISES = {
    "leader": Premise(lambda one: one.navigator.present, "there is no navigator"),
    "ideal": Premise(is_ideal, "vehicles sense with errors or messages are lost"),
    "alike": Premise(
        lambda one: not differs_by_lane(one), "networks, weights or gains are drawn for each lane"
    ),
    "one gain": Premise(
        lambda one: one.gain_matrices is None, "gains differ by axis or vehicle, or couple the axes"
    ),
    "bounded": Premise(lambda one: one.attack.bounded, "ā does not bound the attack"),
    "one identity": Premise(
        lambda one: one.attack.identities() == 1, "attacked vehicles have several identities"
    ),
    "by law": Premise(lambda one: not one.attack.as_told(), "attacked vehicles move as they tell"),
    "not held": Premise(
        lambda one: not one.law.needs_ticks(), "the law holds the jerk between ticks"
    ),
    "solved": Premise(lambda one: one.law.solves(), "the law is {one.law.kind}"),
    "flat": Premise(
        lambda one: one.vehicle.flat, "{one.vehicle.kind} may not move as the law asks"
    ),
    "settled": Premise(settles, "gains differ by vehicle, and weights may switch"),
    "retained": Premise(
        lambda one: situation_of(one).retained is not None, "the defence may retain any neighbour"
    ),
}
MOTION = (
    "ideal",
    "not held",
    "solved",
    "flat",
    "settled",
)  # of the motion at last (theorems.md O1)
BOUNDS = (  # of bounds on the ultimate error (theorems.md O5)
    *(
        "leader",
        "ideal",
        "alike",
        "one gain",
        "bounded",
        "one identity",
        "by law",
        "not held",
        "solved",
    ),
    *("flat", "retained"),
)


def broken_premise(scenario: Scenario, needed: Sequence[str]) -> str:
    """Return what is said of the first premise that a scenario breaks, "" if it has all."""
    found = (PREMISES[each].broken for each in needed if not PREMISES[each].holds(scenario))
    return next(found, "").format(one=scenario)


def has_ticks(scenario: Scenario) -> bool:
    """Return whether anything happens at ticks: a decision, other attacked vehicles, a sum of effects, a held
    jerk, noise, a loss.
    """
    attack = scenario.attack
    decides = scenario.defence.decides or attack.strategic or bool(attack.periods())
    holds = not scenario.law.solves() or not attack.consistent()
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
