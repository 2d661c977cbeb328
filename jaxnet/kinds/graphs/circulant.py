"""Circulant graphs."""

from collections.abc import Iterator
from typing import Annotated

import numpy as np
from annotated_types import Len
from pydantic import Field

from jaxnet.kinds.graphs import Unweighted
from jaxnet.kinds.kind import Fault
from jaxnet.model import patterns
from jaxnet.model.patterns import Neighbours


class Circulant(Unweighted):
    """A ring on which vehicle i hears vehicle i + o for each listed offset o; links need not be mutual."""

    kind = "circulant"

    offsets: Annotated[
        list[int], Len(1), Field(description="from a listener to its sources, around the ring")
    ]

    def heard(self, vehicles: int, random: np.random.Generator) -> Neighbours:
        """Return a circulant pattern: all rows are shifts of one row."""
        return patterns.circulant(vehicles, self.offsets)

    def impossible(self, vehicles: int) -> Iterator[Fault]:
        """Yield a fault if an offset leads back to its vehicle, or two offsets lead to one vehicle."""
        around = [offset % vehicles for offset in self.offsets]
        if 0 in around or len(set(around)) < len(around):
            message = f"must lead to other vehicles, each to one of its own, around {vehicles}"
            yield Fault(("topology.offsets", "vehicles"), f"{message} (got {self.offsets})")
