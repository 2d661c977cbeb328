from jaxnet.kinds.metrics import Metric, of_fleet
from jaxnet.kinds.protocols import FleetView
from jaxnet.kinds.shapes import VehicleNumbers


def wrong_share(seen: FleetView) -> VehicleNumbers:
    """Share of the honest links that alarms have cut, (m, lanes)."""
    xp, links = seen.error.__array_namespace__(), seen.links
    if links is None or links.cut is None:
        return of_fleet(seen, 0.0)
    number = xp.maximum(links.honest.sum(axis=(0, 1)), 1)
    return of_fleet(seen, (links.honest & links.cut).sum(axis=(0, 1)) / number)


WRONGLY_CUT = Metric(
    "wrongly_cut", "", wrong_share, "tail", "mean", "mean", "share of honest links that are cut"
)
