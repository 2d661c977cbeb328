from pydantic import Field

from jaxnet.kinds.graphs import Random, too_many
from jaxnet.kinds.graphs.lattice import Nearest
from jaxnet.model import patterns


class SmallWorld(Random):
    """A small world (Watts and Strogatz): a ring lattice of mutual links, some of them rewired at
    random.
    """

    kind = "small_world"

    neighbours: Nearest = 4
    rewired: float = Field(
        default=0.1, ge=0, le=1, description="probability that a link is joined to another"
    )

    def heard(self, vehicles, random):
        return patterns.small_world(vehicles, self.neighbours, self.rewired, random)

    def impossible(self, vehicles):
        return too_many("topology.neighbours", self.neighbours, vehicles)
