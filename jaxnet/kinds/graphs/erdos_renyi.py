import numpy as np
from pydantic import Field

from jaxnet.kinds.graphs import Random


class ErdosRenyi(Random):
    """An Erdős–Rényi digraph: every directed link between two vehicles exists with the same
    probability.
    """

    kind = "erdos_renyi"
    words = "Erdős–Rényi"

    probability: float = Field(default=0.3, gt=0, le=1, description="of each directed link")

    def heard(self, vehicles, random):
        return (random.random((vehicles, vehicles)) < self.probability) & ~np.eye(
            vehicles, dtype=bool
        )
