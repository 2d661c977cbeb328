"""The median of what is received, axis by axis."""

from typing import Any

from jaxnet.kinds.defences import Defence, Neighbourhood

HALF = 0.5 + 1e-12  # of the weight, and what adding it up may be off


class CoordinateMedian(Defence):
    """Retain, axis by axis, the sources at the weighted median of the positions received.

    No more than half of the weight is below it, and no more than half above. Source: Yin, Chen, Ramchandran
    and Bartlett, Byzantine-robust distributed learning, 2018.
    """

    kind = "coordinate_median"

    def decide(
        self, own: Any, received: Any, last: Any, memory: Any, around: Neighbourhood
    ) -> tuple[Any, Any]:
        """By adding up the weight on either side."""
        other, this, weights = received[0][:, :, None], received[0][:, None], around.weights
        most = HALF * weights.sum(axis=0)
        below = ((other < this) * weights[None, :, None]).sum(axis=1)
        above = ((other > this) * weights[None, :, None]).sum(axis=1)
        return (below <= most) & (above <= most) & (weights > 0), memory
