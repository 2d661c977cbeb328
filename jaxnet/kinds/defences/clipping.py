from jaxnet.kinds.defences import Sparing
from jaxnet.kinds.fields import Positive, setting
from jaxnet.model.plane import length
from jaxnet.model.retained import everybody


class Clipping(Sparing):
    """Weigh a source by `min(1, radius / ‖y_j - y_i‖)`: no source pulls farther than the radius.

    Trusted sources keep their weight. Source: He, Karimireddy and Jaggi, Byzantine-robust
    decentralized learning via ClippedGossip, 2022.
    """

    guarantee = (
        "none: within the radius everything is believed, and of derivatives nothing is clipped"
    )

    radius: Positive = setting(20.0, "[m]")

    def decide(self, own, received, last, memory, around):
        xp, radius = own[0].__array_namespace__(), self.radius[None, None]
        share = radius / xp.maximum(length(received[0] - own[0][:, None]), radius)
        return around.weights * xp.where(self.spared(around), 1.0, share), memory

    def may_drop(self, graph, trusted):
        """No source is dropped, because no weight becomes 0."""
        return everybody(graph)
