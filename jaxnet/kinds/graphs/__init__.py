"""Who hears whom, with what weight.

A graph of m vehicles is one array (m, m + 1), as in `model.graph`: row i - 1 holds what vehicle i hears,
column j the weight of source j, the navigator's first.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from jaxnet.kinds.kind import Fault, Kind, KindError
from jaxnet.model import graph, hearing
from jaxnet.model.graph import Links, Weights


class Graph(Kind):
    """A weighted digraph with a navigator. A graph of one's own gives `weights`."""

    def weights(self, vehicles: int) -> Weights:
        """Weights w_ij, not negative; the rows of listeners are normalised to sum 1.

        Where numbers are drawn, the graph with their medians.
        """
        raise NotImplementedError

    def links(self, vehicles: int) -> Links:
        """Links that some lane may have; the weights of the others are 0 in all lanes."""
        return self.weights(vehicles) > 0

    def differs(self) -> bool:
        """Whether lanes have graphs or weights of their own."""
        return bool(self.drawn_keys())

    def lane_weights(
        self, draw: Any, vehicles: int, sources: Int[np.ndarray, "slots m"]
    ) -> Float[np.ndarray, "samples slots m"]:
        """Weights of each lane by slot; asked for where lanes differ."""
        raise NotImplementedError

    def weights_by_slot(
        self, draw: Any, vehicles: int, sources: Int[np.ndarray, "slots m"]
    ) -> Float[np.ndarray, "samples slots m"]:
        """Weights of each lane by slot, normalised."""
        if self.differs():
            return self.lane_weights(draw, vehicles, sources)
        return draw.same(hearing.by_slot(self.normalised(vehicles), sources))

    def normalised(self, vehicles: int) -> Weights:
        """The weights with rows that sum to 1, or to 0 where a vehicle hears nobody; raises KindError."""
        weights = np.asarray(self.weights(vehicles), float)
        if weights.shape != (vehicles, vehicles + 1) or not (weights >= 0).all():
            raise KindError(
                f"{self.kind}: weights must be ({vehicles}, {vehicles + 1}) numbers, none of them negative"
            )
        return graph.normalised(weights)

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """The navigator must reach everybody, otherwise L is singular."""
        lost = graph.unreachable(self.normalised(scenario.vehicles))
        if lost:
            words = ", ".join(map(str, lost))
            yield Fault(("topology.edges", "topology"), f"the navigator does not reach {words}")

    @classmethod
    def adopted(cls, value: Any) -> "Graph | None":
        """A graph that another library's object means, None if it means none (`edges` knows networkx's)."""
        return None
