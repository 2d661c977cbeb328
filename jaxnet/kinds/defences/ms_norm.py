"""The mean-subsequence rule by distance in the plane."""

from typing import Any

from pydantic import Field

from jaxnet.kinds.defences import Neighbourhood, Sparing
from jaxnet.model import ties
from jaxnet.model.graph import Digraph, Links
from jaxnet.model.plane import length
from jaxnet.model.retained import AnySubset, any_untrusted


class MSNorm(Sparing):
    """Drop the F sources that are farthest from one's own position; trusted ones are never dropped.

    The mean-subsequence rule of W-MSR's kin, with distances in place of numbers on a line.
    """

    kind = "ms_norm"
    guarantee = (
        "none where anybody untrusted is retained, whose derivatives are believed unseen; by trust where at"
        " most F untrusted sources are heard, who are all dropped"
    )

    F: int = Field(
        default=1, ge=0, le=10_000, description="most attacked sources that a vehicle reckons with"
    )

    def decide(
        self, own: Any, received: Any, last: Any, memory: Any, around: Neighbourhood
    ) -> tuple[Any, Any]:
        """By counting who is farther out; of equal ones (`ties`) the one in the lower slot goes first."""
        xp = own[0].__array_namespace__()
        candidate = (around.weights > 0) & ~self.spared(around)
        distance = length(received[0] - own[0][:, None])
        order = xp.arange(len(distance))
        first = (order[:, None] < order[None])[:, :, None, None]  # the other slot before this one
        other, this = distance[:, None], distance[None]
        beyond = candidate[:, None] & (ties.over(other, this) | (~ties.over(this, other) & first))
        return ~(candidate & (beyond.sum(axis=0) < self.F)), memory

    def retained(self, graph: Digraph, trusted: Links) -> AnySubset:
        """It drops F sources that it does not spare, or all where it hears fewer."""
        return any_untrusted(graph, self.spares(trusted), self.F)

    def describe(self, graph: Digraph, attacked: Links, trusted: Links) -> dict[str, str]:
        """How many it drops."""
        return {"defence": f"the {self.F} farthest from one's own position are dropped"}
