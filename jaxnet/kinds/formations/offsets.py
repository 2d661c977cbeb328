from typing import Annotated

from annotated_types import Len

from jaxnet.kinds.fields import Vector, setting
from jaxnet.kinds.formations import Still
from jaxnet.kinds.kind import Fault


class PlacedFormation(Still):
    """A given place of each vehicle."""

    offsets: Annotated[list[Vector], Len(1)] = setting(
        ..., "[m], [x, y] of each vehicle, in the order of their numbers"
    )

    def places(self, vehicles):
        return [x for x, _ in self.offsets], [y for _, y in self.offsets]

    def faults(self, scenario):
        yield from super().faults(scenario)
        if len(self.offsets) != scenario.vehicles:
            message = f"must be {scenario.vehicles}, one for each vehicle"
            keys = ("formation.offsets", "vehicles")
            yield Fault(keys, f"{message} (got {len(self.offsets)})")
