from typing import Any

from jaxnet.kinds.defences import Defence
from jaxnet.kinds.fields import Positive, setting
from jaxnet.kinds.shapes import SlotNumbers, VehicleVectors
from jaxnet.model.plane import length
from jaxnet.model.retained import everybody


class GeometricMedian(Defence):
    """Weigh sources so that their mean is close to the geometric median of their positions.

    The rule starts from the graph's weights and iterates `rounds` times `w_j / max(smoothing, ‖z -
    y_j‖)`, where z is the mean by the last weights. This is Weiszfeld's iteration, smoothed.

    Source: Pillutla, Kakade and Harchaoui, Robust aggregation for federated learning, 2022.
    """

    guarantee = (
        "none of the motion: the mean of the positions stays near the honest ones where they have "
        "more than half of the weight, but derivatives are weighed unchecked"
    )

    smoothing: Positive = setting(1.0, "[m], least distance that counts")
    rounds: int = setting(8, "of the iteration, at every tick", ge=1, le=1000)

    def decide(self, own, received, last, memory, around):
        from jax import lax

        position = received[0]

        def weighed(middle: VehicleVectors) -> SlotNumbers:
            apart = length(position - middle[:, None])
            return around.weights / apart.__array_namespace__().maximum(apart, smoothing)

        def mean(weights: SlotNumbers) -> VehicleVectors:
            moment: Any = sum(weight[None] * position[:, k] for k, weight in enumerate(weights))
            return moment / weights.sum(axis=0)[None]

        smoothing = self.smoothing[None, None]
        middle = lax.fori_loop(1, self.rounds, lambda _, z: mean(weighed(z)), mean(around.weights))
        return weighed(middle), memory

    def retained(self, graph, trusted):
        """Every source where each vehicle hears one, whose weight is 1; else not known."""
        return everybody(graph) if graph.heard.sum(axis=1).max() < 2 else None

    def may_drop(self, graph, trusted):
        """No source is dropped, because no weight becomes 0."""
        return everybody(graph)
