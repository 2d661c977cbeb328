from jaxnet.kinds.defences import AnyDefence
from jaxnet.model.retained import everybody


class NoDefence(AnyDefence):
    """Vehicles believe every source."""

    kind = "none"
    guarantee = "none: everybody is believed"

    def decide(self, own, received, last, memory, around):
        return last, memory

    def retained(self, graph, trusted):
        return everybody(graph)

    def describe(self, graph, attacked, trusted):
        return {"defence": "none"}
