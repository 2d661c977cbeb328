"""The ring."""

from collections.abc import Iterator

import numpy as np

from jaxnet.kinds.graphs import Unweighted
from jaxnet.kinds.kind import Fault
from jaxnet.model import patterns
from jaxnet.model.patterns import Neighbours


class Cyclic(Unweighted):
    """A ring; every vehicle hears both its neighbours."""

    kind = "cyclic"

    def heard(self, vehicles: int, random: np.random.Generator) -> Neighbours:
        """The one before and the one after."""
        return patterns.circulant(vehicles, (-1, 1))

    def impossible(self, vehicles: int) -> Iterator[Fault]:
        """Two vehicles are no ring."""
        if vehicles < 3:
            yield Fault(("vehicles", "topology"), f"a ring has at least 3 vehicles (got {vehicles})")
