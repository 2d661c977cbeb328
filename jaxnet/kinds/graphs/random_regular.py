from jaxnet.kinds.fields import setting
from jaxnet.kinds.graphs import Random, too_many
from jaxnet.kinds.kind import Fault
from jaxnet.model import patterns


class RandomRegular(Random):
    """A random regular graph: every vehicle hears `degree` others, and each of them hears it."""

    degree: int = setting(4, "vehicles that each one hears", ge=1)

    def heard(self, vehicles, random):
        return patterns.drawn_regular(vehicles, self.degree, random)

    def impossible(self, vehicles):
        yield from too_many("topology.degree", self.degree, vehicles)
        if self.degree < vehicles and self.degree * vehicles % 2:
            message = f"times {vehicles} vehicles must be even, for links are mutual"
            keys = ("topology.degree", "topology", "vehicles")
            yield Fault(keys, f"{message} (got {self.degree})")
