"""The star."""

import numpy as np

from jaxnet.kinds.graphs import Graph
from jaxnet.model.graph import Weights


class Star(Graph):
    """Every vehicle hears the navigator alone."""

    kind = "star"

    def weights(self, vehicles: int) -> Weights:
        """`a0 = 1`, no link between vehicles."""
        return np.eye(1, vehicles + 1).repeat(vehicles, axis=0)
