from jaxnet.kinds.fields import setting
from jaxnet.kinds.graphs import Random, too_many
from jaxnet.kinds.graphs.lattice import Nearest
from jaxnet.model import patterns


class SmallWorld(Random):
    """A small world (Watts and Strogatz): a ring lattice of mutual links, some of them rewired."""

    neighbours: Nearest = 4
    rewired: float = setting(0.1, "probability that a link is joined to another", ge=0, le=1)

    def heard(self, vehicles, random):
        return patterns.small_world(vehicles, self.neighbours, self.rewired, random)

    def impossible(self, vehicles):
        return too_many("topology.neighbours", self.neighbours, vehicles)
