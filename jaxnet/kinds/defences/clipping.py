from pydantic import Field

from jaxnet.kinds.defences import Sparing
from jaxnet.kinds.fields import Positive
from jaxnet.model.plane import length
from jaxnet.model.retained import everybody


class Clipping(Sparing):
    """Weigh a source by `min(1, radius / ‖y_j - y_i‖)`, so that no source pulls farther than the
    radius.

    Trusted sources keep their weight. Source: He, Karimireddy and Jaggi, Byzantine-robust
    decentralized learning via ClippedGossip, 2022.
    """

    kind = "clipping"
    guarantee = (
        "none: within the radius everything is believed, and of derivatives nothing is clipped"
    )

    radius: Positive = Field(default=20.0, description="[m]")

    def decide(self, own, received, last, memory, around):
        xp = own[0].__array_namespace__()
        radius = self.radius[None, None]
        share = radius / xp.maximum(length(received[0] - own[0][:, None]), radius)
        return around.weights * xp.where(self.spared(around), 1.0, share), memory

    def may_drop(self, graph, trusted):
        """That no source is dropped, because no weight becomes 0."""
        return everybody(graph)
