"""W-MSR, the weighted mean-subsequence-reduced rule, axis by axis."""

from pydantic import Field

from jaxnet.kinds.defences import Sparing
from jaxnet.kinds.shapes import AxisSlotMask
from jaxnet.model import ties
from jaxnet.model.retained import any_untrusted


class WMSR(Sparing):
    """Drop, axis by axis, up to F values above the vehicle's own and up to F below, the most
    extreme first.

    Trusted sources, among them the navigator, are spared. Source: LeBlanc, Zhang, Koutsoukos and
    Sundaram, Resilient asymptotic consensus in robust networks, 2013.
    """

    kind = "w_msr"
    words = "W-MSR"
    guarantee = (
        "none where derivatives drive vehicles, which this rule does not check; with law local, "
        "vehicles of order 1, k0 below 1/tick and no navigator, honest vehicles agree axis by axis "
        "inside the range of their starts if F are attacked in all and the graph is (F + 1, F + "
        "1)-robust, or if each hears F at most and the graph is (2F + 1)-robust"
    )

    F: int = Field(
        default=1, ge=0, le=10_000, description="most attacked sources that a vehicle reckons with"
    )

    def decide(self, own, received, last, memory, around):
        """Drop a source if fewer than F sources are farther out on the same side.

        Of equal values (`ties`) the lower slot is dropped first. The vehicle's own value is kept.
        """
        xp = own[0].__array_namespace__()
        above = received[0] - own[0][:, None]
        candidate = ((around.weights > 0) & ~self.spared(around))[None]
        size, mine = xp.abs(above), own[0][:, None]
        sides = ties.apart(received[0], mine).astype(float) - ties.apart(mine, received[0]).astype(
            float
        )
        side = xp.where(candidate, sides, 0.0)
        order = xp.arange(above.shape[1])[None, :, None, None]

        def beyond(k: int) -> AxisSlotMask:
            """The sources that slot k exceeds on the same side."""
            other = slice(k, k + 1)
            first = ~ties.over(size, size[:, other]) & (k < order)
            return (side[:, other] == side) & (ties.over(size[:, other], size) | first)

        before = sum(xp.where(beyond(k), 1, 0) for k in range(above.shape[1]))
        return ~((side != 0) & (before < self.F)), memory

    def may_drop(self, graph, trusted):
        return any_untrusted(graph, self.spares(trusted), 2 * self.F)

    def describe(self, graph, attacked, trusted):
        return {
            "defence": f"W-MSR, F = {self.F}; "
            "whom it retains is not bounded here, so no bound is told"
        }
