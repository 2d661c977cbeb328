"""The ring lattice."""

from collections.abc import Iterator
from typing import Annotated

import numpy as np
from pydantic import Field

from jaxnet.kinds.graphs import Unweighted, too_many
from jaxnet.kinds.kind import Fault
from jaxnet.model import patterns
from jaxnet.model.patterns import Neighbours

Nearest = Annotated[
    int, Field(ge=2, multiple_of=2, description="vehicles that each one hears, half on each side")
]


class Lattice(Unweighted):
    """A ring on which every vehicle hears the nearest `neighbours` vehicles."""

    kind = "lattice"

    neighbours: Nearest = 4

    def heard(self, vehicles: int, random: np.random.Generator) -> Neighbours:
        """Return equally many links to vehicles before and after."""
        return patterns.lattice(vehicles, self.neighbours)

    def impossible(self, vehicles: int) -> Iterator[Fault]:
        """Yield a fault if there are not enough other vehicles."""
        return too_many("topology.neighbours", self.neighbours, vehicles)
