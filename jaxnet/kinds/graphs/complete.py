"""The complete graph."""

import numpy as np

from jaxnet.kinds.graphs import Unweighted
from jaxnet.model.patterns import Neighbours


class Complete(Unweighted):
    """Every vehicle hears every other."""

    kind = "complete"

    def heard(self, vehicles: int, random: np.random.Generator) -> Neighbours:
        """All but oneself."""
        return ~np.eye(vehicles, dtype=bool)
