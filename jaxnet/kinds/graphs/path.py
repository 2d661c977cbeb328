"""The path."""

import numpy as np

from jaxnet.kinds.graphs import Graph
from jaxnet.model.graph import Weights


class Path(Graph):
    """Vehicle 1 hears the navigator, vehicle i hears i - 1."""

    kind = "path"

    def weights(self, vehicles: int) -> Weights:
        """One source each."""
        return np.eye(vehicles, vehicles + 1)
