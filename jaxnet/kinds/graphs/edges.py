"""Any weighted digraph, given by its edges."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Len
from jaxtyping import Float, Int
from pydantic import Field, PrivateAttr

from jaxnet.kinds.fields import Number, Within, median
from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.kind import Fault, KindError
from jaxnet.kinds.protocols import LaneDraw, ScenarioView
from jaxnet.model import graph
from jaxnet.model.graph import Digraph
from jaxnet.networks import GREATEST_EDGE_WEIGHT, NumberedNetwork, check_names, number_nodes
from jaxnet.networks.objects import object_network

NORMALISED = "whether the weights of a row are divided by their sum; false: law: local takes them as they are"

Edge = Annotated[
    tuple[int, int, Annotated[Number, Within(gt=0.0, le=GREATEST_EDGE_WEIGHT)]],
    Field(strict=False),
]


class Edges(Graph):
    """Any weighted digraph as a list of edges; the weights of each listener are normalised to sum 1.

    Under the law `local`, an edge [i, i, w] is the weight of vehicle i on itself. With `normalised: false`
    that law takes the weights as they are, `q_i = -Σ_j w_ij P(y_i - y_j)`, as a Laplacian does.
    """

    kind = "edges"
    linked_by: ClassVar[str] = "topology.edges"

    edges: Annotated[
        list[Edge],
        Len(1),
        Field(description="entries i, j, w: i hears j (0 is the navigator) with weight w"),
    ]
    normalised: bool = Field(default=True, description=NORMALISED)
    names: list[str] = Field(default=[], description="of the vehicles 1 … m, or none")

    _led: bool | None = PrivateAttr(
        default=None
    )  # whether a node of an object led; None: from no object

    @property
    def led(self) -> bool:
        """Whether these edges are of an object, one of whose nodes became the navigator."""
        return bool(self._led)

    def weights(self, vehicles: int) -> Digraph:
        """Return the edges with the medians of their weights."""
        return graph.weighted(
            vehicles, [(i, j, median(weight)) for i, j, weight in self.edges if i != j]
        )

    def normalises(self) -> bool:
        """Return the key `normalised`."""
        return self.normalised

    def rows_with_loops(self, vehicles: int) -> Digraph:
        """Return the edges with the medians of their weights, as they are given."""
        return as_given(vehicles, [(i, j, median(weight)) for i, j, weight in self.edges])

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

    def size(self) -> int:
        """Return the greatest number of a vehicle in the edges."""
        return last_vehicle(self.edges)

    def vehicle_names(self) -> Sequence[str]:
        """Return the names of the vehicles, none if only numbers name them."""
        return self.names

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Yield faults of unknown or repeated edges, loops, names and the size, or else of unreached
        vehicles.
        """
        found = list(edge_faults(self.edges, scenario))
        if self.drawn_keys() and (not self.normalised or any(i == j for i, j, _ in self.edges)):
            keys = ("topology.normalised", "topology.edges")
            found.append(
                Fault(keys, "weights on oneself, and weights as they are, are numbers, not drawn")
            )
        found = (
            found or size_faults(self.edges, scenario.vehicles) or name_faults(self.names, scenario)
        )
        yield from found or super().faults(scenario)


def name_faults(names: Sequence[str], scenario: ScenarioView) -> list[Fault]:
    """Return a fault unless there are no names, or one of its own for each vehicle."""
    try:
        check_names(names, scenario.vehicles)
    except KindError as error:
        return [Fault(("topology.names",), str(error))]
    return []


def adopt_network(given: object, leads: bool | None = True) -> Edges | None:
    """Return the graph that a networkx graph or a matrix means, None for another object.

    `leads` says whether a node is the navigator, None if in some cells only. Raises KindError if the object
    means no network.
    """
    found = object_network(given)
    if found is None:
        return None
    if leads is None:
        raise KindError(
            "navigator is none in some cells only: say by jaxnet.network(…, leads=…) who leads"
        )
    return edges_of_network(number_nodes(found, leads=leads), network_label(given), leads)


def edges_of_network(network: NumberedNetwork, label: str | None, leads: bool) -> Edges:
    """Return the graph of a network with numbers; raise KindError if the network has no edge."""
    if not network.edges:
        raise KindError("the network has no edge (i, j) with i > 0, which means i hears j")
    found = Edges(edges=network.edges, names=list(network.names), label=label)
    found._led = leads
    return found


def network_label(given: object) -> str | None:
    """Return the name of a networkx graph, None if it has none."""
    attributes = getattr(given, "graph", None)
    return str(attributes.get("name") or "") or None if isinstance(attributes, Mapping) else None


def last_vehicle(edges: Sequence[tuple[int, int, Number]]) -> int:
    """Return the greatest number of a vehicle in edges."""
    return max(max(listener, source) for listener, source, _ in edges)


def size_faults(edges: Sequence[tuple[int, int, Number]], vehicles: int) -> list[Fault]:
    """Return a fault if the edges name fewer vehicles than the scenario has."""
    last = last_vehicle(edges)
    if last >= vehicles:
        return []
    noun = "vehicle" if last == 1 else "vehicles"
    return [Fault(("vehicles", "topology"), f"the graph has {last} {noun} (got {vehicles})")]


def as_given(vehicles: int, edges: Sequence[tuple[int, int, float]]) -> Digraph:
    """Return the graph of edges (i, j, w), which may be loops, without normalisation."""
    listeners, sources, weights = np.array([*edges], float).reshape(-1, 3).T
    return graph.of_links(vehicles, listeners - 1, sources, weights)


def edge_faults(
    edges: Sequence[tuple[int, int, Number]], scenario: ScenarioView
) -> Iterator[Fault]:
    """Yield faults of single edges: unknown ends, a repetition, or a loop unless the law is local."""
    vehicles, seen = scenario.vehicles, set[tuple[int, int]]()
    for number, (listener, source, _) in enumerate(edges):
        key = f"topology.edges.{number}"
        if not (1 <= listener <= vehicles and 0 <= source <= vehicles):
            yield Fault(
                (key, "topology.edges", "vehicles"),
                f"i is 1 to {vehicles} and j 0 to {vehicles} (got [{listener}, {source}])",
            )
        elif listener == source and scenario.law.couples():
            yield Fault(
                (key, "topology.edges"), f"{listener} hears itself, which law: local alone allows"
            )
        elif (listener, source) in seen:
            yield Fault((key, "topology.edges"), f"[{listener}, {source}] is given twice")
        seen.add((listener, source))
