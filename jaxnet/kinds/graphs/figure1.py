from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.kind import Fault
from jaxnet.model import graph

FIGURE1_LINKS = ((1, 0), (4, 0), (5, 0), (2, 1), (3, 2), (4, 5), (5, 4))


class Figure1(Graph):
    """The paper's Fig. 1: 1, 4 and 5 hear 0; 2 hears 1; 3 hears 2; 4 and 5 hear each other."""

    words = "Figure 1"

    def size(self):
        return 5

    def weights(self, vehicles):
        return graph.weighted(vehicles, [(*link, 1.0) for link in FIGURE1_LINKS])

    def faults(self, scenario):
        if scenario.vehicles != 5:
            message = f"figure1 has 5 vehicles (got {scenario.vehicles})"
            yield Fault(("vehicles", "topology"), message)
