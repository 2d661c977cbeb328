"""Small worlds."""

from collections.abc import Iterator

import numpy as np
from pydantic import Field

from jaxnet.kinds.graphs import Random, too_many
from jaxnet.kinds.graphs.lattice import Nearest
from jaxnet.kinds.kind import Fault
from jaxnet.model import patterns
from jaxnet.model.patterns import Neighbours


class SmallWorld(Random):
    """Watts and Strogatz: a ring lattice of mutual links, each joined elsewhere with a probability."""

    kind = "small_world"

    neighbours: Nearest = 4
    rewired: float = Field(
        default=0.1, ge=0, le=1, description="probability that a link is joined to another"
    )

    def heard(self, vehicles: int, random: np.random.Generator) -> Neighbours:
        """As drawn; nobody is joined to itself, or twice to another."""
        return patterns.small_world(vehicles, self.neighbours, self.rewired, random)

    def impossible(self, vehicles: int) -> Iterator[Fault]:
        """There must be as many others."""
        return too_many("topology.neighbours", self.neighbours, vehicles)
