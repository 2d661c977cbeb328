"""Retained neighbours: from what a vehicle decides to the weights in force (paper, section 5.1).

A decision is an array over slots (see `hearing`), (slots, m, lanes), or (2, slots, m, lanes) where axes
differ: booleans, which slots are retained, or weights themselves, none negative.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from jaxnet.model.graph import Digraph, Links, normalised
from jaxnet.model.hearing import AxisWeights, SlotWeights


class DropPolicy(NamedTuple):
    """What a defence promises of whom it retains, for theory: of some links each vehicle drops a fixed
    number.

    Which ones may change at every tick. The other links are always retained.
    """

    graph: Digraph
    links: Links  # that may be dropped
    number: Int[np.ndarray, " m"]  # of them that are

    @property
    def fixed(self) -> Digraph | None:
        """The graph in force for good, or None where retained neighbours may change."""
        if (self.number < self.links.sum(axis=1)).any():
            return None
        return normalised(self.graph.only(~self.links))

    def believed(self) -> "DropPolicy":
        """The same without links that are dropped for good."""
        for_good = self.links & (self.number >= self.links.sum(axis=1))[:, None]
        number = np.where(for_good.any(axis=1), 0, self.number)
        return DropPolicy(self.graph.only(~for_good), self.links & ~for_good, number)


def everybody(graph: Digraph) -> DropPolicy:
    """Nobody drops anybody."""
    return DropPolicy(graph, graph.none, np.zeros(graph.vehicles, int))


def any_untrusted(graph: Digraph, trusted: Links, number: Any) -> DropPolicy:
    """Each drops so many untrusted sources, or all where it hears fewer."""
    links = graph.heard & ~trusted
    return DropPolicy(graph, links, np.minimum(number, links.sum(axis=1)))


def in_force(weights: SlotWeights, decision: Any) -> AxisWeights:
    """Weights that follow from a decision, renormalised to sum 1; not-a-number where one is negative."""
    xp = decision.__array_namespace__()
    by_axis = decision.reshape(-1, *weights.shape)
    if by_axis.dtype == bool:
        kept = xp.where(by_axis, weights[None], 0.0)
    else:
        kept = xp.where(by_axis >= 0, by_axis, xp.nan)
    return kept / kept.sum(axis=1, keepdims=True)


def changed(decision: Any, before: Any) -> Bool[Any, "m *lanes"]:
    """Vehicles whose decision is another one."""
    apart = decision != before
    return apart.any(axis=tuple(range(apart.ndim - 2)))


def support(decision: Any) -> Any:
    """Slots that are retained at all."""
    return decision if decision.dtype == bool else decision > 0
