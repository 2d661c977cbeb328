from pydantic import ConfigDict

from jaxnet.kinds.defences import AnyDefence
from jaxnet.model.retained import everybody


class NoDefence(AnyDefence):
    """Vehicles believe every source."""

    guarantee = "none: vehicles believe every source"
    model_config = ConfigDict(ignored_types=(object,))  # class attributes are no keys
    trusted, noise, isolated = {}, None, "fail"

    def decide(self, own, received, last, memory, around):
        return last, memory

    def retained(self, graph, trusted):
        return everybody(graph)

    def describe(self, graph, attacked, trusted):
        return {"defence": "none"}
