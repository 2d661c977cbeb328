from typing import Any

from pydantic import Field

from jaxnet.kinds.defences import Defence
from jaxnet.kinds.fields import Positive
from jaxnet.kinds.shapes import SlotNumbers, VehicleVectors
from jaxnet.model.plane import length
from jaxnet.model.retained import everybody


class GeometricMedian(Defence):
    """Weigh sources so that their mean is close to the geometric median of their positions.

    The rule starts from the graph's weights and iterates `rounds` times `w_j / max(smoothing, ‖z -
    y_j‖)`, where z is the mean by the last weights. This is Weiszfeld's iteration, smoothed.

    Source: Pillutla, Kakade and Harchaoui, Robust aggregation for federated learning, 2022.
    """

    kind = "geometric_median"
    guarantee = (
        "none of the motion: the mean of the positions stays near the honest ones where they have "
        "more than half of the weight, but derivatives are weighed unseen"
    )

    smoothing: Positive = Field(default=1.0, description="[m], least distance that counts")
    rounds: int = Field(default=8, ge=1, le=1000, description="of the iteration, at every tick")

    def decide(self, own, received, last, memory, around):
        from jax import lax

        position = received[0]

        def weighed(middle: VehicleVectors) -> SlotNumbers:
            apart = length(position - middle[:, None])
            least = apart.__array_namespace__().maximum(apart, self.smoothing[None, None])
            return around.weights / least

        def mean(weights: SlotNumbers) -> VehicleVectors:
            moment: Any = sum(
                weight[None] * position[:, slot] for slot, weight in enumerate(weights)
            )
            return moment / weights.sum(axis=0)[None]

        middle = lax.fori_loop(1, self.rounds, lambda _, z: mean(weighed(z)), mean(around.weights))
        return weighed(middle), memory

    def may_drop(self, graph, trusted):
        """That no source is dropped, because no weight becomes 0."""
        return everybody(graph)
