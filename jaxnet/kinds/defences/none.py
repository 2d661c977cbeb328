"""No defence: every source is believed."""

from jaxnet.kinds.defences import AnyDefence, Neighbourhood
from jaxnet.kinds.shapes import Decision, Memory, SlotJets, VehicleJets
from jaxnet.model.graph import Digraph, Links
from jaxnet.model.retained import DropPolicy, everybody


class NoDefence(AnyDefence):
    """Vehicles believe every source."""

    kind = "none"
    guarantee = "none: everybody is believed"

    def decide(
        self,
        own: VehicleJets,
        received: SlotJets,
        last: Decision,
        memory: Memory,
        around: Neighbourhood,
    ) -> tuple[Decision, Memory]:
        """Return the last decision, which retains every source."""
        return last, memory

    def retained(self, graph: Digraph, trusted: Links) -> DropPolicy | None:
        """Return that every source is retained."""
        return everybody(graph)

    def describe(self, graph: Digraph, attacked: Links, trusted: Links) -> dict[str, str]:
        """Return that there is no defence."""
        return {"defence": "none"}
