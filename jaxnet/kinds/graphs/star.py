import numpy as np

from jaxnet.kinds.graphs import Graph
from jaxnet.model import graph


class Star(Graph):
    """Every vehicle hears the navigator alone."""

    def weights(self, vehicles):
        return graph.of_links(vehicles, np.arange(vehicles), np.zeros(vehicles))
