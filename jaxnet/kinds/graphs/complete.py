"""The complete graph."""

import numpy as np

from jaxnet.kinds.graphs import Unweighted
from jaxnet.model.patterns import Neighbours


class Complete(Unweighted):
    """Every vehicle hears every other vehicle."""

    kind = "complete"

    def heard(self, vehicles: int, random: np.random.Generator) -> Neighbours:
        """Return all links except those from a vehicle to itself."""
        return ~np.eye(vehicles, dtype=bool)
