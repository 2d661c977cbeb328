import numpy as np
from pydantic import Field

from jaxnet.kinds.graphs import Random


class ErdosRenyi(Random):
    """An Erdős–Rényi digraph: each directed link of two vehicles exists with one probability."""

    words = "Erdős–Rényi"

    probability: float = Field(default=0.3, gt=0, le=1, description="of each directed link")

    def heard(self, vehicles, random):
        drawn = random.random((vehicles, vehicles)) < self.probability
        return drawn & ~np.eye(vehicles, dtype=bool)
