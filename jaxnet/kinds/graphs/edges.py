from collections.abc import Mapping
from typing import Annotated

import numpy as np
from annotated_types import Len
from pydantic import Field, PrivateAttr

from jaxnet.kinds.fields import Number, Within, setting
from jaxnet.kinds.graphs import EdgeGraph
from jaxnet.kinds.kind import Fault, KindError
from jaxnet.networks import GREATEST_EDGE_WEIGHT, NumberedNetwork, check_names, number_nodes
from jaxnet.networks.objects import object_network

Edge = Annotated[
    tuple[int, int, Annotated[Number, Within(gt=0.0, le=GREATEST_EDGE_WEIGHT)]], Field(strict=False)
]


class Edges(EdgeGraph):
    """Any weighted digraph by a list of edges; the weights of a listener are normalised to sum 1.

    Under the law `local`, an edge [i, i, w] is the weight of vehicle i on itself. With `normalised:
    false` that law takes the weights as they are, `q_i = -Σ_j w_ij P(y_i - y_j)`, as a Laplacian
    does.
    """

    linked_by = "topology.edges"

    edges: Annotated[list[Edge], Len(1)] = Field(
        description="entries i, j, w: i hears j (0 is the navigator) with weight w"
    )
    names: list[str] = setting([], "of the vehicles 1 … m, or none")

    # Whether a node of an object led; None: from no object
    _led: bool | None = PrivateAttr(default=None)

    @property
    def led(self) -> bool:
        """Whether the edges come from an object, and one of its nodes became the navigator."""
        return bool(self._led)

    def listed(self):
        return self.edges

    def lane_weights(self, draw, vehicles, sources):
        """The weights of each lane; the draw of edge (i, j) is component j of vehicle i."""
        links, numbers = [(i, j) for i, j, _ in self.edges], [number for *_, number in self.edges]
        listeners, heard = np.array(links).T
        rows = listeners - 1
        slots = (sources[:, rows] == heard).argmax(axis=0)
        weights = np.zeros((len(draw.samples), *sources.shape))
        weights[:, slots, rows] = draw.placed(numbers, "topology.edges", links)
        return weights / weights.sum(axis=1, keepdims=True)

    def vehicle_names(self):
        return self.names

    def faults(self, scenario):
        found = list(self.edge_faults(scenario))
        if self.drawn_keys() and (not self.normalised or any(i == j for i, j, _ in self.edges)):
            message = "weights on oneself, and weights as they are, are numbers, not drawn"
            found.append(Fault(("topology.normalised", "topology.edges"), message))
        if not found and (self.size() or 0) >= scenario.vehicles:
            try:
                check_names(self.names, scenario.vehicles)
            except KindError as error:
                found.append(Fault(("topology.names",), str(error)))
        yield from found or super().faults(scenario)


def adopt_network(given: object, leads: bool | None = True) -> Edges | None:
    """The graph of a networkx graph or a matrix; None for another object.

    `leads` says whether a node is the navigator, None if in some cells only. Raises KindError if
    the object means no network.
    """
    found = object_network(given)
    if found is None:
        return None
    if leads is None:
        told = "say by jaxnet.network(…, leads=…) who leads"
        raise KindError(f"navigator is none in some cells only: {told}")
    return edges_of_network(number_nodes(found, leads=leads), network_label(given), leads)


def edges_of_network(network: NumberedNetwork, label: str | None, leads: bool) -> Edges:
    """The graph of a network with numbers; raise KindError if the network has no edge."""
    if not network.edges:
        raise KindError("the network has no edge (i, j) with i > 0, which means i hears j")
    found = Edges(edges=network.edges, names=list(network.names), label=label)
    found._led = leads
    return found


def network_label(given: object) -> str | None:
    attributes = getattr(given, "graph", None)
    return str(attributes.get("name") or "") or None if isinstance(attributes, Mapping) else None
