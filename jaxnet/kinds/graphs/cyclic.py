"""The ring."""

from collections.abc import Iterator
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from jaxnet.kinds.fields import Number, Within, bounds, is_drawn, median
from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.kind import Fault
from jaxnet.model.graph import Weights


def leaves_neighbours(weight: Any) -> Any:
    """The navigator's weight, if everybody hears the same sources whatever is drawn."""
    if is_drawn(weight) and bounds(weight)[1] >= 1:
        raise ValueError("must be less than 1 where it is drawn: at 1 nobody hears a neighbour")
    return weight


class Cyclic(Graph):
    """A ring; every vehicle hears both its neighbours, with equal weights, and the navigator."""

    kind = "cyclic"

    navigator_weight: Annotated[Number, Within(gt=0.0, le=1.0), AfterValidator(leaves_neighbours)] = Field(
        default=0.1, description="of the navigator's word, the neighbours share the rest"
    )

    def weights(self, vehicles: int) -> Weights:
        """`w_i0`, and `(1 - w_i0) / 2` for each neighbour."""
        weights = np.zeros((vehicles, vehicles + 1))
        weights[:, 0] = median(self.navigator_weight)
        rows = np.arange(vehicles)
        for step in (-1, 1):
            weights[rows, (rows + step) % vehicles + 1] += beside(weights[:, 0])
        return weights

    def lane_weights(self, draw: Any, vehicles: int, sources: Any) -> Any:
        """The same with each lane's own weight."""
        navigator = draw.one(self.navigator_weight, "topology.navigator_weight")[:, None, None]
        return np.where(sources == 0, navigator, beside(navigator))

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """Two vehicles are no ring."""
        if scenario.vehicles < 3:
            got = f"(got {scenario.vehicles})"
            yield Fault(("vehicles", "topology"), f"a ring has at least 3 vehicles {got}")


def beside(navigator: np.ndarray) -> np.ndarray:
    """A neighbour's weight beside the navigator's."""
    return (1.0 - navigator) / 2
