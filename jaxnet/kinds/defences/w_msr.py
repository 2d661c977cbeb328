"""W-MSR, the weighted mean-subsequence-reduced rule, axis by axis."""

from typing import Any

from pydantic import Field

from jaxnet.kinds.defences import Neighbourhood, Sparing
from jaxnet.model import ties
from jaxnet.model.graph import Digraph, Links
from jaxnet.model.retained import AnySubset, any_untrusted


class WMSR(Sparing):
    """Drop, axis by axis, up to F values above one's own and up to F below, the most extreme first.

    Trusted sources, the navigator, are spared. Source: LeBlanc, Zhang, Koutsoukos and Sundaram,
    Resilient asymptotic consensus in robust networks, 2013.
    """

    kind = "w_msr"
    guarantee = (
        "none under this law: what is known of W-MSR is of vehicles that move to the values retained; here"
        " derivatives drive them, and are believed unseen"
    )

    F: int = Field(
        default=1, ge=0, le=10_000, description="most attacked sources that a vehicle reckons with"
    )

    def decide(
        self, own: Any, received: Any, last: Any, memory: Any, around: Neighbourhood
    ) -> tuple[Any, Any]:
        """By counting, of those who are farther out on the same side, whether they are less than F.

        Of equal values (`ties`) the one in the lower slot is dropped first; one equal to one's own is kept.
        """
        xp = own[0].__array_namespace__()
        above = received[0] - own[0][:, None]
        candidate = ((around.weights > 0) & ~self.spared(around))[None]
        size, mine = xp.abs(above), own[0][:, None]
        sides = ties.apart(received[0], mine).astype(float) - ties.apart(mine, received[0]).astype(float)
        side = xp.where(candidate, sides, 0.0)
        order = xp.arange(above.shape[1])[None, :, None, None]

        def beyond(k: int) -> Any:
            """Who has the one in this slot farther out on the same side."""
            other = slice(k, k + 1)
            first = ~ties.over(size, size[:, other]) & (k < order)
            return (side[:, other] == side) & (ties.over(size[:, other], size) | first)

        before = sum(xp.where(beyond(k), 1, 0) for k in range(above.shape[1]))
        return ~((side != 0) & (before < self.F)), memory

    def may_drop(self, graph: Digraph, trusted: Links) -> AnySubset:
        """F on either side."""
        return any_untrusted(graph, self.spares(trusted), 2 * self.F)

    def describe(self, graph: Digraph, attacked: Links, trusted: Links) -> dict[str, str]:
        """What is known of it."""
        return {"defence": f"W-MSR, F = {self.F}; whom it retains is not bounded here, so no bound is told"}
