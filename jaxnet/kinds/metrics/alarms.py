import math

from jaxnet.kinds.metrics import Metric, of_fleet
from jaxnet.kinds.protocols import FleetView
from jaxnet.kinds.shapes import VehicleNumbers


def alarm_share(seen: FleetView, links: int) -> VehicleNumbers:
    """Alarms over messages until now, (m, lanes), of attacked links (0) or of honest links (1).

    The share is not-a-number without a detector, and where no message was judged.
    """
    return of_fleet(seen, math.nan if seen.alarms is None else seen.alarms[links])


ALARMS = Metric(
    "alarms",
    "",
    lambda seen: alarm_share(seen, 0),
    time="last",
    words="share of attacked messages that raise an alarm",
    undefined="blank",
)
