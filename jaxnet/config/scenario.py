"""A scenario on the host: graph and links as NumPy arrays, times, and premises of theorems."""

import functools
import itertools
import math
from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import numpy as np

from jaxnet.config.keys import Scenario
from jaxnet.kinds.fields import is_drawn
from jaxnet.kinds.graphs import ByIdentity, shared_by_cells
from jaxnet.model import hearing, safety
from jaxnet.model.graph import Digraph, Links, normalised, of_links
from jaxnet.model.retained import DropPolicy
from jaxnet.model.safety import Safe

# Keys of an attack on which no fault, gain or bound per ā depends where they are one number each
SIGNAL_NUMBERS = ("magnitude", "frequency", "phase", "direction")
MOST_INVERTED = 1_000  # vehicles; L of a larger fleet takes over a second to invert
MOST_DRAWN_SETS = 1_000  # sets of attacked vehicles that are tried one by one, 1 to 2 ms each


class Situation(NamedTuple):
    """The graph of a scenario, its attacked and trusted links, and the sources that may be retained
    (None: unknown).

    If weights are drawn, the graph has their medians. All lanes of a cell share a situation unless
    each lane draws its own graph.
    """

    graph: Digraph
    attacked: Links
    trusted: Links
    retained: DropPolicy | None


def but_signal(scenario: Scenario) -> ByIdentity:
    """A cache key that equals those of scenarios with the same objects but for SIGNAL_NUMBERS.

    Lists and distributions, and numbers of a kind from outside, are told apart.
    """
    attack, own = scenario.attack, dict(vars(scenario.attack))
    for name in SIGNAL_NUMBERS if type(attack).__module__.startswith("jaxnet.") else ():
        if type(own.get(name)) is float:
            own[name] = float
    others = vars(scenario) | {"attack": type(attack)}
    return ByIdentity(scenario, *others.values(), *own.values())


for_any_signal = functools.partial(shared_by_cells, key=but_signal)


def situation_of(scenario: Scenario) -> Situation:
    graph = scenario_graph(scenario)
    trusted = scenario.defence.trusts(graph)
    attacked = scenario.attack.attacked_links(graph)
    retained = scenario.defence.retained(graph, trusted) if is_ideal(scenario) else None
    return Situation(graph, attacked, trusted, retained)


def scenario_graph(scenario: Scenario) -> Digraph:
    """Graph of a scenario, with rows that sum to 1; without a navigator, without its links."""
    graph = scenario.topology.normalised_rows(scenario.vehicles)
    return graph if scenario.navigator.present else normalised(without_navigator(graph))


def greatest_strength(scenario: Scenario) -> float:
    """Greatest factor of a row of the graph in a local law (`Graph.strength`)."""
    rows = scenario_graph(scenario).weights.T[None]
    strength = scenario.topology.strength(rows, scenario.navigator.present)
    most = 1.0 if strength is None else float(strength.of(np.ones((1, *rows.shape[::2]))).max())
    return max(1.0, most) if scenario.defence.anchors() else most


def links_of(scenario: Scenario) -> Digraph:
    """Graph of the possible links, each with weight 1."""
    linked = scenario.topology.linked(scenario.vehicles)
    return linked if scenario.navigator.present else without_navigator(linked)


def without_navigator(graph: Digraph) -> Digraph:
    return graph.only(graph.heard & (graph.sources != 0))


def is_ideal(scenario: Scenario) -> bool:
    """Whether sensors are exact, one network is in force, and every message arrives at once."""
    return not breaks(scenario).intersection(EVERY_MESSAGE)


def safe_in(scenario: Scenario, graph: Digraph, attacked: Links) -> list[Safe]:
    """Safe vehicles, by reason, of this graph if these links are attacked.

    A sybil is one more attacked source, and hears the navigator alone. A reason that needs
    consistent announcements is left out if attacked links announce otherwise. No reason is known
    without the premises of MOTION. A vehicle that moves as it tells is not safe.
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
    """Vehicles that may move as they tell if these links are attacked: (m,).

    A drawn vehicle that nobody hears may do so too.
    """
    everyone, attack = np.arange(1, graph.vehicles + 1), scenario.attack
    if not attack.as_told():
        return everyone < 0
    if attack.targets():
        return np.isin(everyone, attack.targets())
    unheard = ~np.isin(everyone, graph.sources[graph.heard])
    return np.isin(everyone, graph.sources[attacked]) | unheard


def attacked_draws(scenario: Scenario, graph: Digraph) -> list[Links] | None:
    """Attacked links per drawable set of vehicles, None for too many; one set if none is drawn."""
    attack = scenario.attack
    if not attack.present or attack.targets() or not attack.number():
        return [attack.attacked_links(graph)]
    if too_many_sets(scenario):
        return None
    sets = itertools.combinations(range(1, scenario.vehicles + 1), attack.number())
    return [attack.on([*each]).attacked_links(graph) for each in sets]


def too_many_sets(scenario: Scenario) -> bool:
    drawn = scenario.attack.present and not scenario.attack.targets()
    return drawn and math.comb(scenario.vehicles, scenario.attack.number()) > MOST_DRAWN_SETS


def safe_in_all(scenario: Scenario, graph: Digraph, draws: Sequence[Links]) -> list[Safe]:
    """Vehicles safe whichever set of links is attacked, each with the weakest of its reasons."""
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
    """Reason without its numbers, which differ from one set of attacked links to another."""
    return reason.why.partition(",")[0]


def with_sybils(
    graph: Digraph, attacked: Links, trusted: Links, more: int
) -> tuple[Digraph, np.ndarray, np.ndarray]:
    """Graph, attacked links and trusted links with `more` vehicles added per attacked source."""
    listeners, slots = graph.edges()
    sources, lies = graph.sources[listeners, slots], attacked[listeners, slots]
    liars, number = np.unique(sources[lies], return_inverse=True)
    sybils = graph.vehicles + 1 + np.arange(len(liars) * more).reshape(-1, more)
    rows = np.concatenate([listeners, listeners[lies].repeat(more), sybils.ravel() - 1])
    columns = np.concatenate([sources, sybils[number].ravel(), np.zeros(sybils.size)])

    def wider(given: np.ndarray, of_sybils: float) -> Digraph:
        own = given[listeners, slots]
        values = [own, own[lies].repeat(more), np.full(sybils.size, of_sybils)]
        return of_links(graph.vehicles + sybils.size, rows, columns, np.concatenate(values))

    links = (wider(attacked, 0.0).heard, wider(trusted, 1.0).heard)
    return normalised(wider(graph.weights, 1.0)), *links


PREMISES = {  # what a theorem may need: what is said of a scenario without it
    "leader": "there is no navigator",
    "exact sensors": "sensors err",
    "exact messages": "messages are not exact (noise or rounding)",
    "unrounded messages": "messages are rounded",
    "white": "errors are drawn, correlated in time, or have outliers",
    "every message": "messages are lost",
    "uncut": "alarms cut messages or links",
    "on time": "messages are late",
    "one network": "networks take turns",
    "same links": "each lane has links of its own",
    "alike": "networks, weights or gains are drawn for each lane",
    "one gain": "gains differ by axis or vehicle, or couple the axes",
    "bounded": "ā does not bound the attack",
    "one identity": "attacked vehicles have several identities",
    "by law": "attacked vehicles do not obey the law",
    "solved": "the law ({one.law.kind}) is not solved at every instant",
    "flat": "{one.vehicle.kind} may not move as the law asks",
    "unfiltered": "filter {one.filter.kind} may change what the law asks for",
    "filtered": "there is no filter",
    "true places": "attacked vehicles tell false places",
    "continuous": "the {one.engine.kind} engine holds inputs from tick to tick",
    "settled": "gains differ by vehicle, and weights may switch",
    "retained": "the defence may drop neighbours or change weights",
    "consistent": "attacked links announce {announced}, not what they carry",
    "added path": "the attack adds no given path with its derivatives",
    "no decisions": "the defence decides",
    "unheld": "the defence holds vehicles to their starts",
    "drops": "channel.missing is not drop",
    "steady delay": "channel.delay is drawn",
    "foretold": "messages are compared with what {one.detector.predicts.kind} expects",
    "ticks": "there are no ticks",
    "small": "there are more than {most:,} vehicles",
}
EVERY_MESSAGE = ("exact sensors", "exact messages", "every message", "uncut", "on time")
EVERY_MESSAGE += ("one network",)
# At last (theorems.md O1)
MOTION = (*EVERY_MESSAGE, "same links", "solved", "flat", "unfiltered", "continuous", "settled")
BOUNDS = (  # of bounds on the ultimate error (theorems.md O5)
    *("leader", *EVERY_MESSAGE, "alike", "one gain", "bounded", "one identity", "by law"),
    *("solved", "flat", "unfiltered", "continuous", "retained"),
)
SOLUTION = (  # of the exact solution for known decisions at ticks (theorems.md O1, O2)
    *("leader", *EVERY_MESSAGE, "one gain", "by law", "solved", "flat", "unfiltered"),
    *("continuous", "added path", "ticks"),
)
# Premises that are asked last, as they take time.
OF_GRAPHS: dict[str, Callable[[Scenario], bool]] = {
    "settled": lambda one: settles(one),
    "retained": lambda one: situation_of(one).retained is not None,
}


def breaks(scenario: Scenario) -> set[str]:
    """Premises that a scenario breaks, without those of OF_GRAPHS."""
    attack, channel = scenario.attack, scenario.channel
    own = {
        "exact messages": channel.rounded,
        "unrounded messages": channel.rounded,
        "white": None in (scenario.sensing.white(), channel.noise.white()),
        "on time": channel.late,
        "alike": scenario.draws_gain,
        "one gain": scenario.gain_matrices is not None,
        "added path": not attack.consistent()
        or attack.strategic
        or attack.replaces()
        or bool(attack.periods()),
        "filtered": not scenario.filter.present,
        "true places": attack.present,
        "no decisions": scenario.defence.decides,
        "unheld": scenario.defence.anchors(),
        "drops": channel.missing != "drop",
        "steady delay": is_drawn(channel.delay),
        "foretold": not scenario.detector.foretells(),
        "ticks": scenario.tick == 0,
        "small": scenario.vehicles > MOST_INVERTED,
    }
    kinds = (scenario.navigator, scenario.topology, attack, scenario.law, scenario.vehicle)
    kinds = (
        *kinds,
        scenario.engine,
        scenario.filter,
        attack.announcement(),
        scenario.sensing,
        channel.loss,
        channel.noise,
        scenario.detector,
    )
    return {name for name, broken in own.items() if broken}.union(*(k.breaks() for k in kinds))


def missing(scenario: Scenario, needed: Collection[str]) -> list[str]:
    """Names of the needed premises that a scenario breaks, in the order of PREMISES.

    Those of OF_GRAPHS are asked where no other premise is broken.
    """
    broken = breaks(scenario)
    names = [name for name in PREMISES if name in needed and name in broken]
    return names or [
        name for name, holds in OF_GRAPHS.items() if name in needed and not holds(scenario)
    ]


def premise_words(scenario: Scenario, name: str) -> str:
    announced = scenario.attack.announcement().kind
    return PREMISES[name].format(one=scenario, announced=announced, most=MOST_INVERTED)


def broken_premise(scenario: Scenario, needed: Collection[str]) -> str:
    """Words of the first needed premise that a scenario breaks, "" if it has all."""
    return next((premise_words(scenario, name) for name in missing(scenario, needed)), "")


def settles(scenario: Scenario) -> bool:
    """Whether errors die away with the gains in use: one gain, weights that stay, or no cycle."""
    if scenario.own_gains is None:
        return True
    graph, _, _, kept = situation_of(scenario)
    if kept is not None and kept.fixed is not None:
        return True
    all_but_one = DropPolicy(graph, graph.heard, graph.heard.sum(axis=1) - 1)
    return bool(safety.stay_joined(all_but_one, np.ones(graph.vehicles, bool)).all())


def has_ticks(scenario: Scenario) -> bool:
    """Whether anything happens at ticks: a decision, other attacked vehicles, a sum of effects, a
    held jerk, noise, a loss.
    """
    attack = scenario.attack
    decides = scenario.defence.decides or attack.strategic or bool(attack.periods())
    holds = scenario.engine.samples or not scenario.law.solves() or not attack.consistent()
    return (decides or holds or not is_ideal(scenario)) and scenario.tick > 0


def interval_of(scenario: Scenario) -> float:
    """Time from tick to tick [s]; without ticks, the output step."""
    return scenario.tick if has_ticks(scenario) else scenario.output_step


def outputs_of(scenario: Scenario) -> int:
    """Number of output times after t = 0."""
    return round(scenario.horizon / scenario.output_step)


@for_any_signal
def sources_of(scenario: Scenario) -> np.ndarray:
    """Source of each slot, (slots, m). An attacked source fills a slot for each identity."""
    linked = scenario.topology.linked(scenario.vehicles)
    each = scenario.attack.identities() + scenario.attack.splits()
    return hearing.slots(linked, np.where(scenario.attack.attacked_links(linked), each, 1))
