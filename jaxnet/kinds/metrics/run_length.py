from typing import Literal

from jaxnet.kinds.fields import setting
from jaxnet.kinds.metrics import Metric, MetricKeys, of_fleet
from jaxnet.kinds.protocols import FleetView
from jaxnet.kinds.shapes import VehicleNumbers


class RunLength(MetricKeys):
    """Messages that were tested over alarms among them; infinite without any alarm."""

    of: Literal["honest", "attacked"] = setting("honest", "about which messages")

    def words(self):
        return f"{self.of} messages for each alarm"

    def __call__(self, seen: FleetView) -> VehicleNumbers:
        """The mean run length until now, (m, lanes)."""
        xp = seen.error.__array_namespace__()
        if seen.alarms is None:
            return of_fleet(seen, xp.inf)
        share = seen.alarms[["attacked", "honest"].index(self.of)]
        some = share > 0
        return of_fleet(seen, xp.where(some, 1.0 / xp.where(some, share, 1.0), xp.inf))


RUN_LENGTH = Metric("run_length", "", RunLength(), time="last", undefined="infinite")
