import numpy as np

from jaxnet.kinds.graphs import Graph
from jaxnet.model import graph


class Path(Graph):
    """A line: vehicle 1 hears the navigator, vehicle i hears vehicle i - 1."""

    def weights(self, vehicles):
        return graph.of_links(vehicles, np.arange(vehicles), np.arange(vehicles))
