"""The star."""

import numpy as np

from jaxnet.kinds.graphs import Graph
from jaxnet.model import graph
from jaxnet.model.graph import Digraph


class Star(Graph):
    """Every vehicle hears the navigator alone."""

    kind = "star"

    def weights(self, vehicles: int) -> Digraph:
        """Return one link to the navigator for each vehicle, with weight 1."""
        return graph.of_links(vehicles, np.arange(vehicles), np.zeros(vehicles))
