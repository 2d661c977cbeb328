"""Retained sources: from the decision of a vehicle to the weights in force (paper, section 5.1).

A decision is an array over slots (see `hearing`): (slots, m, lanes), or (2, slots, m, lanes) if the
axes differ. It contains booleans, true for retained slots, or nonnegative weights.

Under a local law a vehicle follows the mean of those it retains, `q_i = s_i (a0 y_0^(r) - P(ε_i))`.
The strength s_i is 1 unless the network says otherwise. Let S be the share of the row's weights
that the vehicle retains.

    with a weight on itself    s = S / (S + w_ii / Σ_j w_ij): the retained weights and w_ii sum to 1
    with weights as they are   s = S Σ_j w_ij: the Laplacian's form, q_i = -Σ_j w_ij P(y_i - y_j)

The exact law and its rounds solve `L q = b`, which does not depend on the strength of a row.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxnet.model.graph import Digraph, Links, normalised
from jaxnet.model.hearing import AxisWeights, SlotWeights
from jaxnet.model.shapes import Flags, Numbers, RetainedSlots

RowShares = Float[Any, "axes m *lanes"]


class DropPolicy(NamedTuple):
    """Links that a defence may drop, for the theory: each vehicle drops a fixed number of these.

    The dropped links may change at every tick. The vehicle always retains its other links.
    """

    graph: Digraph
    links: Links  # links that may be dropped
    number: Int[np.ndarray, " m"]  # number of those links that each vehicle drops

    @property
    def fixed(self) -> Digraph | None:
        """The permanent graph in force, or None if retained sources may change."""
        if (self.number < self.links.sum(axis=1)).any():
            return None
        return normalised(self.graph.only(~self.links))

    def believed(self) -> "DropPolicy":
        """The policy without the links that a vehicle drops permanently."""
        for_good = self.links & (self.number >= self.links.sum(axis=1))[:, None]
        number = np.where(for_good.any(axis=1), 0, self.number)
        return DropPolicy(self.graph.only(~for_good), self.links & ~for_good, number)


def everybody(graph: Digraph) -> DropPolicy:
    """The policy of a defence that retains every link."""
    return DropPolicy(graph, graph.none, np.zeros(graph.vehicles, int))


def any_untrusted(
    graph: Digraph, trusted: Links, number: int | Int[np.ndarray, " m"]
) -> DropPolicy:
    """Policy of a defence that drops `number` untrusted sources of a vehicle, or all if fewer."""
    links = graph.heard & ~trusted
    return DropPolicy(graph, links, np.minimum(number, links.sum(axis=1)))


def in_force(weights: SlotWeights, decision: RetainedSlots) -> AxisWeights:
    """The weights that follow from a decision, normalised to sum 1.

    `weights` are the weights of all slots. If a weight in the decision is negative, the weights of
    its listener are NaN.
    """
    xp = decision.__array_namespace__()
    by_axis = decision.reshape(-1, *weights.shape)
    if by_axis.dtype == bool:
        kept = xp.where(by_axis, weights[None], 0.0)
    else:
        kept = xp.where(by_axis >= 0, by_axis, xp.nan)
    return kept / kept.sum(axis=1, keepdims=True)


def changed(decision: RetainedSlots, before: RetainedSlots) -> Flags:
    apart = decision != before
    return apart.any(axis=tuple(range(apart.ndim - 2)))


def support(decision: RetainedSlots) -> Flags:
    """The slots that the decision retains with any weight."""
    return decision if decision.dtype == bool else decision > 0


class WithOwnWeight(NamedTuple):
    """Strength of rows in which a vehicle has a weight on itself."""

    own: Numbers  # w_ii over the sum of the other weights, (m, lanes)

    def of(self, retained: RowShares) -> RowShares:
        """The strength of rows of which this share of the weights is retained."""
        total = retained + self.own[None]
        return retained / total.__array_namespace__().where(total > 0, total, 1.0)

    def within(self, share: Numbers) -> "WithOwnWeight":
        """Strength of the rows of a network with this share of the weights, (m, lanes)."""
        xp = share.__array_namespace__()
        return WithOwnWeight(self.own / xp.where(share > 0, share, 1.0))


class WeightsAsTheyAre(NamedTuple):
    """Strength of rows whose weights are not normalised."""

    total: Numbers  # Σ_j w_ij, (m, lanes)

    def of(self, retained: RowShares) -> RowShares:
        return self.total[None] * retained

    def within(self, share: Numbers) -> "WeightsAsTheyAre":
        """Strength of the rows of a network with this share of the weights, (m, lanes)."""
        return WeightsAsTheyAre(self.total * share)


RowStrength = WithOwnWeight | WeightsAsTheyAre
