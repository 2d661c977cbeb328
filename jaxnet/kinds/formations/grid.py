import math

from pydantic import Field

from jaxnet.kinds.fields import Positive, setting
from jaxnet.kinds.formations import Still


class GridFormation(Still):
    """Vehicles on a square grid, row by row in the order of their numbers, about its middle."""

    spacing: Positive = setting(..., "[m], from vehicle to vehicle")
    columns: int | None = Field(
        default=None, ge=1, description="null: as many as make the grid square"
    )

    def places(self, vehicles):
        columns = min(self.columns or math.ceil(math.sqrt(vehicles)), vehicles)
        rows = math.ceil(vehicles / columns)
        return tuple(
            [self.spacing * (number - (most - 1) / 2) for number in numbers]
            for most, numbers in (
                (columns, [one % columns for one in range(vehicles)]),
                (rows, [one // columns for one in range(vehicles)]),
            )
        )
