"""Any weighted digraph, edge by edge."""

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Len
from pydantic import Field

from jaxnet.kinds.fields import Number, Within, median
from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.kind import Fault
from jaxnet.model import graph
from jaxnet.model.graph import Digraph

GREATEST = 1e9  # weight of an edge
Edge = Annotated[
    tuple[int, int, Annotated[Number, Within(gt=0.0, le=GREATEST)]],
    Field(strict=False),
]


class Edges(Graph):
    """Any weighted digraph; the weights of each listener are normalised to sum 1."""

    kind = "edges"
    linked_by: ClassVar[str] = "topology.edges"

    edges: Annotated[
        list[Edge], Len(1), Field(description="entries i, j, w: i hears j (0 is the navigator) with weight w")
    ]

    def weights(self, vehicles: int) -> Digraph:
        """The edges with their weights' medians."""
        return graph.weighted(vehicles, [(i, j, median(weight)) for i, j, weight in self.edges])

    def lane_weights(self, draw: Any, vehicles: int, sources: Any) -> Any:
        """The number of edge (i, j) is component j of vehicle i."""
        links, numbers = [(i, j) for i, j, _ in self.edges], [number for *_, number in self.edges]
        listeners, heard = np.array(links).T
        rows = listeners - 1
        slots = (sources[:, rows] == heard).argmax(axis=0)
        weights = np.zeros((len(draw.samples), *sources.shape))
        weights[:, slots, rows] = draw.placed(numbers, "topology.edges", links)
        return weights / weights.sum(axis=1, keepdims=True)

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """Every edge joins two that exist and differ, once; then the navigator must reach everybody."""
        found = list(edge_faults(self.edges, scenario.vehicles))
        yield from found or super().faults(scenario)

    @classmethod
    def adopted(cls, value: Any) -> "Edges | None":
        """Of a networkx graph, as `edges_of` says."""
        if not (hasattr(value, "edges") and hasattr(value, "is_directed")):
            return None
        return cls(edges=edges_of(value))


def edges_of(network: Any) -> list[Any]:
    """The edges of a networkx graph: (i, j) is "i hears j", 0 the navigator, weight 1 if it says none."""
    given = [(int(i), int(j), float(weight)) for i, j, weight in network.edges(data="weight", default=1.0)]
    back = [] if network.is_directed() else [(j, i, weight) for i, j, weight in given]
    return [edge for edge in [*given, *back] if edge[0] > 0]


def edge_faults(edges: list[Any], vehicles: int) -> Iterator[Fault]:
    """What is wrong with single edges."""
    seen: set[tuple[int, int]] = set()
    for number, (listener, source, _) in enumerate(edges):
        key = f"topology.edges.{number}"
        if not (1 <= listener <= vehicles and 0 <= source <= vehicles):
            yield Fault(
                (key, "topology.edges", "vehicles"),
                f"i is 1 to {vehicles} and j 0 to {vehicles} (got [{listener}, {source}])",
            )
        elif listener == source:
            yield Fault((key, "topology.edges"), f"{listener} hears itself")
        elif (listener, source) in seen:
            yield Fault((key, "topology.edges"), f"[{listener}, {source}] is given twice")
        seen.add((listener, source))
