"""Vehicles that no attack keeps off the navigator, and the attackers that end the proof (O11)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from jaxnet.config.scenario import MOTION, safe_in, safe_in_all
from jaxnet.model.safety import Safe, Vehicles
from jaxnet.theory import certificate
from jaxnet.theory.certificate import Margin
from jaxnet.theory.robustness import MOST_NODES
from jaxnet.theory.theorem import Case, Theorem


class SafeVehicles(NamedTuple):
    """Safe vehicles by reason, the strongest first; the weakest of all sets that are drawn."""

    reasons: list[Safe]
    drawn: bool  # whether several sets of attacked vehicles may be drawn
    tried: bool  # whether these sets were tried one by one, not all of them together

    def by_majority(self) -> Bool[np.ndarray, " m"]:
        """Vehicles that are safe only where attacked links announce what they carry."""
        found = np.zeros(len(self.reasons[0].vehicles), bool)
        for each in sorted(self.reasons, key=lambda each: not each.consistent):
            found = found | each.vehicles if each.consistent else found & ~each.vehicles
        return found

    def left(self) -> float:
        """What a tolerance of rounding leaves on links, 2M + δ [m/s³] (corollary 1)."""
        return max((each.left for each in self.reasons), default=0.0)


def safe_vehicles(case: Case) -> SafeVehicles:
    graph, attacked, *_ = case.situation
    sets = [attacked] if case.draws is None else case.draws
    reasons = safe_in_all(case.scenario, graph, sets)
    return SafeVehicles(reasons, len(sets) > 1, case.draws is not None)


def proof_ends(case: Case) -> Margin | None:
    """Attackers that leave no proof; None for large fleets, and where sets are too many to try."""
    scenario, graph = case.scenario, case.situation.graph
    few = case.seconds > 0 and graph.vehicles <= MOST_NODES and case.draws is not None
    if not few or not scenario.attack.present:
        return None

    def safe(attacked: list[int]) -> Vehicles:
        reasons = safe_in(scenario, graph, scenario.attack.on(attacked).attacked_links(graph))
        return np.any([each.vehicles for each in reasons], axis=0)

    everyone = range(1, graph.vehicles + 1)
    return certificate.margin(safe, scenario.attack.targets() or everyone, graph.vehicles)


SAFE = Theorem("O11", "safe", "", ("leader", *MOTION), safe_vehicles)
PROOF_ENDS = Theorem("O11", "proof ends", "", ("leader", *MOTION), proof_ends)
