"""Erdős–Rényi digraphs."""

import numpy as np
from pydantic import Field

from jaxnet.kinds.graphs import Random
from jaxnet.model.patterns import Neighbours


class ErdosRenyi(Random):
    """Erdős–Rényi digraph: every vehicle hears every other with the same probability, link by link."""

    kind = "erdos_renyi"

    probability: float = Field(default=0.3, gt=0, le=1, description="of each directed link")

    def heard(self, vehicles: int, random: np.random.Generator) -> Neighbours:
        """Links need not be mutual."""
        return (random.random((vehicles, vehicles)) < self.probability) & ~np.eye(vehicles, dtype=bool)
