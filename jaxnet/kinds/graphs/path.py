"""The path."""

import numpy as np

from jaxnet.kinds.graphs import Graph
from jaxnet.model import graph
from jaxnet.model.graph import Digraph


class Path(Graph):
    """Vehicle 1 hears the navigator, vehicle i hears i - 1."""

    kind = "path"

    def weights(self, vehicles: int) -> Digraph:
        """One source each."""
        return graph.of_links(vehicles, np.arange(vehicles), np.arange(vehicles))
