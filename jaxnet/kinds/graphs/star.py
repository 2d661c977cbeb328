"""The star."""

import numpy as np

from jaxnet.kinds.graphs import Graph
from jaxnet.model import graph
from jaxnet.model.graph import Digraph


class Star(Graph):
    """Every vehicle hears the navigator alone."""

    kind = "star"

    def weights(self, vehicles: int) -> Digraph:
        """`a0 = 1`, no link between vehicles."""
        return graph.of_links(vehicles, np.arange(vehicles), np.zeros(vehicles))
