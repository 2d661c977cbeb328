"""Certificate of a network: whom the navigator reaches, the paper's Assumption 1."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from jaxnet.config.scenario import MOST_INVERTED
from jaxnet.kinds.kind import vehicle_numbers
from jaxnet.lazy import sparse
from jaxnet.model import graph, safety
from jaxnet.model.graph import Digraph, Links
from jaxnet.theory.case import Case

MOST_CUT = 20  # sets of attacked links of which wrong cuts are counted


def inverse_norm_of(case: Case) -> float | None:
    """`‖L⁻¹‖₂`, infinite if L is singular or a vehicle is not reached; None for large fleets."""
    network = case.situation.graph
    if graph.unreachable(network):
        return np.inf
    return graph.inverse_norm(network) if network.vehicles <= MOST_INVERTED else None


class HonestPaths(NamedTuple):
    """Vehicles, from 1, without an honest path from the navigator, or without an honest source."""

    cut_off: list[int] | None  # in some lane; None for too many drawn sets
    perhaps: list[int]  # if all that may be drawn are attacked at once
    all_attacked: list[int]


def honest_paths(case: Case) -> HonestPaths:
    """Whom attacks part from the navigator in some lane (the paper's Assumption 1)."""
    network, attacked, *_ = case.situation
    honest = network.heard & ~attacked
    perhaps = graph.unreachable(network.only(honest))
    cut_off = None if perhaps else []
    if perhaps and case.draws is not None:
        each = (graph.unreachable(network.only(network.heard & ~links)) for links in case.draws)
        cut_off = sorted(set().union(*each))
    return HonestPaths(cut_off, perhaps, vehicle_numbers(np.asarray(~honest.any(axis=1))))


def droppable(case: Case) -> list[int] | None:
    """Vehicles that dropped links may part from the navigator."""
    network, _, trusted, _ = case.situation
    drops = case.scenario.defence.may_drop(network, trusted)
    return vehicle_numbers(~safety.stay_joined(drops, np.ones(network.vehicles, bool))) or None


class CutReach(NamedTuple):
    """Reach of what is left where alarms have cut all attacked links."""

    lost: list[int] | None  # vehicles, from 1, cut off in some lane; None for too many drawn sets
    wrong: int  # least number of further links whose cut parts another vehicle; 0 if not computed
    whom: list[int]  # the vehicles that so few can part


def isolation(case: Case) -> CutReach | None:
    """Reach without all attacked links, and the wrong cuts that it bears (Menger's theorem)."""
    detector, network = case.scenario.detector, case.situation.graph
    if not detector.cuts_links:
        return None
    if case.draws is None:
        return CutReach(None, 0, [])
    left = [network.only(network.heard & ~links) for links in case.draws]
    if detector.cuts == "both_ways":
        left = [without_answers(network, links) for links in case.draws]
    lost = sorted(set().union(*map(graph.unreachable, left)))
    if len(left) > MOST_CUT:
        return CutReach(lost, 0, [])
    cuts = np.min([least_cuts(each) for each in left], axis=0)
    wrong = cuts[cuts > 0].min(initial=network.heard.sum())
    return CutReach(lost, int(wrong), vehicle_numbers(cuts == wrong))


def without_answers(network: Digraph, cut: Links) -> Digraph:
    """The network without some links, and without those from the listeners to the sources."""
    listeners = np.broadcast_to(np.arange(1, network.vehicles + 1)[:, None], cut.shape)
    back = {*zip(network.sources[cut].tolist(), listeners[cut].tolist(), strict=True)}
    ends = zip(listeners.ravel().tolist(), network.sources.ravel().tolist(), strict=True)
    answers = np.array([pair in back for pair in ends]).reshape(cut.shape)
    return network.only(network.heard & ~cut & ~answers)


def least_cuts(network: Digraph) -> Int[np.ndarray, " m"]:
    """The least number of links whose loss parts each vehicle from the navigator; 0 if it is."""
    from scipy.sparse.csgraph import maximum_flow  # the import is slow

    listeners, slots = network.edges()
    ends = network.sources[listeners, slots], listeners + 1
    size = network.vehicles + 1
    links = sparse.csr_array((np.ones(len(listeners), np.int32), ends), shape=(size, size))
    return np.array([maximum_flow(links, 0, i).flow_value for i in range(1, size)])


class JointReach(NamedTuple):
    """Vehicles, from 1, that the navigator reaches where networks take turns."""

    union: list[int]  # over the links of all networks
    always: list[int]  # in each network
    nominal: list[int]  # in each network, and so is every vehicle upstream


def joint_reach(networks: Sequence[Digraph]) -> JointReach:
    """Whom the navigator reaches in networks that take turns.

    Without attack and errors, the `nominal` vehicles obey O1 (theorems.md): all their messages are
    those of vehicles that obey it too.
    """
    pairs = sorted({pair for network in networks for pair in network.pairs()})
    listeners, sources = np.array(pairs, int).reshape(-1, 2).T
    union = graph.of_links(networks[0].vehicles, listeners, sources)
    always = np.isfinite(np.max([graph.hops(network) for network in networks], axis=0))
    one, each = np.ones(union.vehicles, int), np.ones(union.sources.shape, int)
    spoilt = safety.percolate(union, each, one, np.append(False, ~always))[1:]
    reached = np.isfinite(graph.hops(union))
    return JointReach(*map(vehicle_numbers, (reached, always, ~spoilt)))


def reach_in_turns(case: Case) -> JointReach | None:
    networks = case.scenario.topology.turns()
    if len(networks) == 1:
        return None
    return joint_reach([each.normalised_rows(case.scenario.vehicles) for each in networks])


def nominal_in_turns(case: Case) -> list[int] | None:
    found = reach_in_turns(case)
    return found and found.nominal
