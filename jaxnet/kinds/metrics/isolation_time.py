from jaxnet.kinds.metrics import Metric, of_fleet
from jaxnet.kinds.protocols import FleetView
from jaxnet.kinds.shapes import VehicleNumbers


def isolated_at(seen: FleetView) -> VehicleNumbers:
    """Time [s] of the first tick at which alarms have cut all attacked links, (m, lanes)."""
    xp = seen.error.__array_namespace__()
    return of_fleet(seen, xp.inf if seen.links is None else seen.links.isolated)


ISOLATION_TIME = Metric(
    "isolation_time",
    "s",
    isolated_at,
    time="last",
    words="time until all attacked links are cut",
    undefined="infinite",
)
