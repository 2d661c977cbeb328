import numpy as np

from jaxnet.kinds.graphs import Unweighted


class Complete(Unweighted):
    """Every vehicle hears every other vehicle."""

    def heard(self, vehicles, random):
        return ~np.eye(vehicles, dtype=bool)
