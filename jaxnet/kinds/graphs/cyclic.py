"""The ring."""

from collections.abc import Iterator

import numpy as np

from jaxnet.kinds.graphs import Unweighted
from jaxnet.kinds.kind import Fault
from jaxnet.model import patterns
from jaxnet.model.patterns import Neighbours


class Cyclic(Unweighted):
    """A ring on which every vehicle hears both its neighbours."""

    kind = "cyclic"

    def heard(self, vehicles: int, random: np.random.Generator) -> Neighbours:
        """Return the links to the vehicle before and the vehicle after."""
        return patterns.circulant(vehicles, (-1, 1))

    def impossible(self, vehicles: int) -> Iterator[Fault]:
        """Yield a fault for fewer than three vehicles."""
        if vehicles < 3:
            yield Fault(
                ("vehicles", "topology"), f"a ring has at least 3 vehicles (got {vehicles})"
            )
