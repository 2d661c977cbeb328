"""Clipping: no source pulls farther than a radius."""

from pydantic import Field

from jaxnet.kinds.defences import Neighbourhood, Sparing
from jaxnet.kinds.fields import Positive
from jaxnet.kinds.shapes import Decision, Memory, SlotJets, VehicleJets
from jaxnet.model.graph import Digraph, Links
from jaxnet.model.plane import length
from jaxnet.model.retained import DropPolicy, everybody


class Clipping(Sparing):
    """Weigh a source by `min(1, radius / ‖y_j - y_i‖)`, so that no source pulls farther than the radius.

    Trusted sources keep their weight. Source: He, Karimireddy and Jaggi, Byzantine-robust decentralized
    learning via ClippedGossip, 2022.
    """

    kind = "clipping"
    guarantee = (
        "none: within the radius everything is believed, and of derivatives nothing is clipped"
    )

    radius: Positive = Field(default=20.0, description="[m]")

    def decide(
        self,
        own: VehicleJets,
        received: SlotJets,
        last: Decision,
        memory: Memory,
        around: Neighbourhood,
    ) -> tuple[Decision, Memory]:
        """Return weights of the sources, which are normalised afterwards."""
        xp = own[0].__array_namespace__()
        radius = self.radius[None, None]
        share = radius / xp.maximum(length(received[0] - own[0][:, None]), radius)
        return around.weights * xp.where(self.spared(around), 1.0, share), memory

    def may_drop(self, graph: Digraph, trusted: Links) -> DropPolicy:
        """Return that no source is dropped, because no weight becomes 0."""
        return everybody(graph)
