from typing import Annotated

from annotated_types import Len

from jaxnet.kinds.fields import setting
from jaxnet.kinds.graphs import Unweighted
from jaxnet.kinds.kind import Fault
from jaxnet.model import patterns


class Circulant(Unweighted):
    """A ring on which vehicle i hears vehicle i + o for each offset o; links need not be mutual."""

    offsets: Annotated[list[int], Len(1)] = setting(..., "from a listener to sources on the ring")

    def heard(self, vehicles, random):
        return patterns.circulant(vehicles, self.offsets)

    def impossible(self, vehicles):
        around = [offset % vehicles for offset in self.offsets]
        if 0 in around or len(set(around)) < len(around):
            message = f"must lead to other vehicles, each to one of its own, around {vehicles}"
            yield Fault(("topology.offsets", "vehicles"), f"{message} (got {self.offsets})")
