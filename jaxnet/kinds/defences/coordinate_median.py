"""The median of what is received, axis by axis."""

from typing import Any

from jaxnet.kinds.defences import Neighbourhood, Sparing
from jaxnet.model import ties

HALF = 0.5 + 1e-12  # of the weight, and what adding it up may be off


class CoordinateMedian(Sparing):
    """Retain, axis by axis, the sources at the weighted median of the positions received, and trusted ones.

    No more than half of the weight is below it, and no more than half above. What is equal but for rounding
    is neither. Without the trusted ones a vehicle would soon hear nobody by whom the navigator reaches it.
    Source of the median: Yin, Chen, Ramchandran and Bartlett, Byzantine-robust distributed learning, 2018.
    """

    kind = "coordinate_median"
    guarantee = (
        "none of the motion: the median of the positions lies among the honest ones, axis by axis, where they"
        " have more than half of the weight, but derivatives are believed unseen"
    )

    def decide(
        self, own: Any, received: Any, last: Any, memory: Any, around: Neighbourhood
    ) -> tuple[Any, Any]:
        """By adding up the weight on either side, slot by slot, for XLA adds up over an axis one by one."""
        xp, weights, position = own[0].__array_namespace__(), around.weights, received[0]
        below, above = (
            sum(
                xp.where(beside(position[:, k : k + 1], position), weight[None, None], 0.0)
                for k, weight in enumerate(weights)
            )
            for beside in (lambda a, b: ties.apart(b, a), ties.apart)
        )
        most = (HALF * weights.sum(axis=0))[None, None]
        median = (below <= most) & (above <= most) & (weights > 0)[None]
        return median | self.spared(around)[None], memory
