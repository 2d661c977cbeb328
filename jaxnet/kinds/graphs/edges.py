"""Any weighted digraph, given by its edges."""

import math
import numbers
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Annotated, ClassVar, Protocol, SupportsIndex, runtime_checkable

import numpy as np
from annotated_types import Len
from jaxtyping import Float, Int
from pydantic import Field

from jaxnet.kinds.fields import Number, Within, median
from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.kind import Fault, KindError
from jaxnet.kinds.protocols import LaneDraw, ScenarioView
from jaxnet.model import graph
from jaxnet.model.graph import Digraph

GREATEST_EDGE_WEIGHT = 1e9  # weight of an edge
Edge = Annotated[
    tuple[int, int, Annotated[Number, Within(gt=0.0, le=GREATEST_EDGE_WEIGHT)]],
    Field(strict=False),
]


@runtime_checkable
class EdgeView(Protocol):
    """What is read of a networkx graph."""

    @property
    def graph(self) -> Mapping[str, object]:
        """Attributes of the graph."""
        ...

    @property
    def nodes(self) -> Iterable[SupportsIndex]:
        """Nodes of the graph, numbers."""
        ...

    @property
    def degree(self) -> Mapping[SupportsIndex, int]:
        """Number of edges by node."""
        ...

    @property
    def edges(self) -> Callable[..., Iterable[tuple[SupportsIndex, SupportsIndex, Mapping[str, object]]]]:
        """Ends and attributes of each edge, with `data=True`."""
        ...

    def is_directed(self) -> bool:
        """Return whether an edge has a direction."""
        ...


class Edges(Graph):
    """Any weighted digraph as a list of edges; the weights of each listener are normalised to sum 1."""

    kind = "edges"
    linked_by: ClassVar[str] = "topology.edges"

    edges: Annotated[
        list[Edge], Len(1), Field(description="entries i, j, w: i hears j (0 is the navigator) with weight w")
    ]

    def weights(self, vehicles: int) -> Digraph:
        """Return the edges with the medians of their weights."""
        return graph.weighted(vehicles, [(i, j, median(weight)) for i, j, weight in self.edges])

    def lane_weights(
        self, draw: LaneDraw, vehicles: int, sources: Int[np.ndarray, "slots m"]
    ) -> Float[np.ndarray, "samples slots m"]:
        """Return the weights of each lane; the draw of edge (i, j) is component j of vehicle i."""
        links, numbers = [(i, j) for i, j, _ in self.edges], [number for *_, number in self.edges]
        listeners, heard = np.array(links).T
        rows = listeners - 1
        slots = (sources[:, rows] == heard).argmax(axis=0)
        weights = np.zeros((len(draw.samples), *sources.shape))
        weights[:, slots, rows] = draw.placed(numbers, "topology.edges", links)
        return weights / weights.sum(axis=1, keepdims=True)

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Yield faults of unknown or repeated edges, loops and the size, or else of unreached vehicles."""
        found = list(edge_faults(self.edges, scenario.vehicles))
        yield from found or size_faults(self.edges, scenario.vehicles) or super().faults(scenario)

    @classmethod
    def adopted(cls, value: object) -> "Edges | None":
        """Return the edges of a networkx graph, with its name as the label; raise KindError as `edges_of`
        does.
        """
        if not isinstance(value, EdgeView):
            return None
        edges = edges_of(value)
        if not edges:
            raise KindError("the network has no edge (i, j) with i > 0, which means i hears j")
        return cls(edges=edges, label=str(value.graph.get("name") or "") or None)


def edges_of(
    network: EdgeView, unread: tuple[str, ...] = (), weight: object = 1.0
) -> list[tuple[int, int, float]]:
    """Return the edges (i, j, w) of a networkx graph: i hears j, and 0 is the navigator.

    `weight` is that of edges without one.

    Raises KindError for an edge attribute other than `weight` and those in `unread`, and for a node that has
    no number or no edge.
    """
    for node in network.nodes:
        if isinstance(node, bool | np.bool_) or not hasattr(node, "__index__") or operator.index(node) < 0:
            raise KindError(f"nodes are whole numbers, 0 the navigator (got {node!r})")
        if not network.degree[node]:
            raise KindError(f"node {node} has no edge")
    given = []
    for listener, source, data in network.edges(data=True):
        ends = operator.index(listener), operator.index(source)
        if other := [name for name in data if name not in ("weight", *unread)]:
            raise KindError(f"edge {ends} has the attribute {other[0]!r}; only 'weight' is read")
        given.append((*ends, weight_of(data.get("weight", weight), ends)))
    back = [] if network.is_directed() else [(j, i, w) for i, j, w in given if i != j]
    return [edge for edge in [*given, *back] if edge[0] > 0]


def weight_of(given: object, ends: tuple[int, int]) -> float:
    """Return the weight of an edge; raise KindError."""
    number = given if isinstance(given, numbers.Real) and not isinstance(given, bool) else math.nan
    if not number <= GREATEST_EDGE_WEIGHT or not float(number) > 0:
        raise KindError(
            f"edge {ends}: a weight is a number > 0, at most {GREATEST_EDGE_WEIGHT:g} (got {given!r})"
        )
    return float(number)


def size_faults(edges: Sequence[tuple[int, int, Number]], vehicles: int) -> list[Fault]:
    """Return a fault if the edges name fewer vehicles than the scenario has."""
    last = max(max(listener, source) for listener, source, _ in edges)
    if last >= vehicles:
        return []
    noun = "vehicle" if last == 1 else "vehicles"
    return [Fault(("vehicles", "topology"), f"the graph has {last} {noun} (got {vehicles})")]


def edge_faults(edges: Sequence[tuple[int, int, Number]], vehicles: int) -> Iterator[Fault]:
    """Yield faults of single edges: unknown ends, a loop, or a repetition."""
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
