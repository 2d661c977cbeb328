from jaxnet.kinds.metrics import Metric, of_fleet
from jaxnet.kinds.protocols import FleetView
from jaxnet.kinds.shapes import VehicleNumbers


def saturation(seen: FleetView, which: int) -> VehicleNumbers:
    """What was limited until now, (m, lanes): the share of vehicle-steps (0), or the steps (1)."""
    return of_fleet(seen, 0.0 if seen.saturated is None else seen.saturated[which])


SATURATED = Metric(
    "saturated",
    "",
    lambda seen: saturation(seen, 0),
    time="last",
    words="share of vehicle-steps in which the vehicle's inputs were limited",
)
