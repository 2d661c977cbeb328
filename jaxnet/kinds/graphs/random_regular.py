"""Random regular graphs."""

from collections.abc import Iterator

import numpy as np
from pydantic import Field

from jaxnet.kinds.graphs import Random, too_many
from jaxnet.kinds.kind import Fault
from jaxnet.model import patterns
from jaxnet.model.patterns import Neighbours


class RandomRegular(Random):
    """A random regular graph: every vehicle hears `degree` others, and each of them hears it too."""

    kind = "random_regular"

    degree: int = Field(default=4, ge=1, description="vehicles that each one hears")

    def heard(self, vehicles: int, random: np.random.Generator) -> Neighbours:
        """Draw a regular graph with mutual links."""
        return patterns.drawn_regular(vehicles, self.degree, random)

    def impossible(self, vehicles: int) -> Iterator[Fault]:
        """Yield a fault if the degree is too great, or if degree times vehicles is odd."""
        yield from too_many("topology.degree", self.degree, vehicles)
        if self.degree < vehicles and self.degree * vehicles % 2:
            message = (
                f"times {vehicles} vehicles must be even, for links are mutual (got {self.degree})"
            )
            yield Fault(("topology.degree", "topology", "vehicles"), message)
