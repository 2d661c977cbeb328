from typing import Annotated

from pydantic import Field

from jaxnet.kinds.graphs import Unweighted, too_many
from jaxnet.model import patterns

Nearest = Annotated[
    int, Field(ge=2, multiple_of=2, description="vehicles that each one hears, half on each side")
]


class Lattice(Unweighted):
    """A ring on which every vehicle hears the nearest `neighbours` vehicles."""

    neighbours: Nearest = 4

    def heard(self, vehicles, random):
        return patterns.lattice(vehicles, self.neighbours)

    def impossible(self, vehicles):
        return too_many("topology.neighbours", self.neighbours, vehicles)
