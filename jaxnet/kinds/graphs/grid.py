from pydantic import Field

from jaxnet.kinds.fields import setting
from jaxnet.kinds.graphs import Unweighted
from jaxnet.kinds.kind import Fault
from jaxnet.model import patterns


class Grid(Unweighted):
    """A grid, numbered row by row. A vehicle hears the vehicles beside, before and behind it."""

    rows: int = Field(ge=1, description="how many")
    columns: int = Field(ge=1, description="vehicles in a row")
    torus: bool = setting(False, "whether the last of a row or column hears the first")

    def size(self):
        return self.rows * self.columns

    def heard(self, vehicles, random):
        return patterns.grid(self.rows, self.columns, self.torus)

    def impossible(self, vehicles):
        if self.size() != vehicles:
            got = f"(got {self.rows} × {self.columns})"
            message = f"times columns must be the {vehicles} vehicles {got}"
            yield Fault(("topology.rows", "topology", "vehicles"), message)
