from pydantic import Field

from jaxnet.kinds.graphs import Unweighted
from jaxnet.kinds.kind import Fault
from jaxnet.model import patterns


class Grid(Unweighted):
    """Rows and columns of vehicles, numbered row by row; each hears those beside, before and behind
    it.
    """

    kind = "grid"

    rows: int = Field(ge=1, description="how many")
    columns: int = Field(ge=1, description="vehicles in a row")
    torus: bool = Field(
        default=False, description="whether the last of a row or column hears the first"
    )

    def size(self):
        return self.rows * self.columns

    def heard(self, vehicles, random):
        return patterns.grid(self.rows, self.columns, self.torus)

    def impossible(self, vehicles):
        if self.rows * self.columns != vehicles:
            message = (
                f"times columns must be the {vehicles} vehicles (got {self.rows} × {self.columns})"
            )
            yield Fault(("topology.rows", "topology", "vehicles"), message)
