from jaxnet.kinds.graphs import Unweighted
from jaxnet.kinds.kind import Fault
from jaxnet.model import patterns


class Cyclic(Unweighted):
    """A ring on which every vehicle hears both its neighbours."""

    def heard(self, vehicles, random):
        return patterns.circulant(vehicles, (-1, 1))

    def impossible(self, vehicles):
        if vehicles < 3:
            message = f"a ring has at least 3 vehicles (got {vehicles})"
            yield Fault(("vehicles", "topology"), message)
