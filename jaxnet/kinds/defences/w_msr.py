from jaxnet.kinds.defences import ExpectsF
from jaxnet.kinds.shapes import AxisSlotMask
from jaxnet.model import ties
from jaxnet.model.retained import any_untrusted


class WMSR(ExpectsF):
    """Drop, axis by axis, the F values farthest above the vehicle's own, and the F farthest below.

    Trusted sources, among them the navigator, are spared. Source: LeBlanc, Zhang, Koutsoukos and
    Sundaram, Resilient asymptotic consensus in robust networks, 2013.
    """

    words = "W-MSR"
    guarantee = "none is known with a navigator: W-MSR judges positions, derivatives drive too"

    def decide(self, own, received, last, memory, around):
        """Drop a source if fewer than F sources are farther out on the same side.

        Of equal values (`ties`) the lower slot is dropped first. The vehicle's own value is kept.
        """
        xp, mine = own[0].__array_namespace__(), own[0][:, None]
        size = xp.abs(received[0] - mine)
        candidate = ((around.weights > 0) & ~self.spared(around))[None]
        higher, lower = ties.apart(received[0], mine), ties.apart(mine, received[0])
        side = xp.where(candidate, higher.astype(float) - lower.astype(float), 0.0)
        order = xp.arange(size.shape[1])[None, :, None, None]

        def beyond(k: int) -> AxisSlotMask:
            """The sources that slot k exceeds on the same side."""
            other = slice(k, k + 1)
            first = ~ties.over(size, size[:, other]) & (k < order)
            return (side[:, other] == side) & (ties.over(size[:, other], size) | first)

        before = sum(xp.where(beyond(k), 1, 0) for k in range(size.shape[1]))
        return ~((side != 0) & (before < self.F)), memory

    def may_drop(self, graph, trusted):
        return any_untrusted(graph, self.spares(trusted), 2 * self.F)

    def tolerates(self):
        return self.F

    def describe(self, graph, attacked, trusted):
        most = int((attacked & ~self.spares(trusted)).sum(axis=1).max())
        told = f", but a vehicle may hear {most} attacked sources" * (most > self.F)
        any_source = super().describe(graph, attacked, trusted)["defence"]
        return {"defence": f"W-MSR, F = {self.F}{told}; {any_source}"}
