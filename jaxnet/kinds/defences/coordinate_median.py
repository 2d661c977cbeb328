from jaxnet.kinds.defences import Sparing
from jaxnet.model import ties

HALF = 0.5 + 1e-12  # half of the weight, plus the rounding of its sum


class CoordinateMedian(Sparing):
    """Retain trusted sources, and axis by axis those at the weighted median of the positions.

    At the median at most half of the weight is below and at most half above. Positions that are
    equal except for rounding count as neither below nor above. Without trusted sources a vehicle
    would soon hear no source through which the navigator reaches it.

    Source of the median: Yin, Chen, Ramchandran and Bartlett, Byzantine-robust distributed
    learning, 2018.
    """

    guarantee = (
        "none of the motion: the median of the positions lies among the honest ones, axis by axis, "
        "where they have more than half of the weight, but derivatives are believed unchecked"
    )

    def decide(self, own, received, last, memory, around):
        """The sources at the median. A loop over slots sums: XLA sums an axis one by one."""
        xp, weights, position = own[0].__array_namespace__(), around.weights, received[0]
        below = above = 0.0
        for k, weight in enumerate(weights):
            other = position[:, k : k + 1]
            below += xp.where(ties.apart(position, other), weight[None, None], 0.0)
            above += xp.where(ties.apart(other, position), weight[None, None], 0.0)
        most = (HALF * weights.sum(axis=0))[None, None]
        median = (below <= most) & (above <= most) & (weights > 0)[None]
        return median | self.spared(around)[None], memory
