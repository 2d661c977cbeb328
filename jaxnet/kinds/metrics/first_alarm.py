from typing import Any, Literal

from jaxnet.kinds.fields import setting
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.metrics import Metric, MetricKeys, of_fleet
from jaxnet.kinds.protocols import FleetView
from jaxnet.kinds.shapes import VehicleNumbers


class FirstAlarm(MetricKeys):
    """The time of the first alarm about a link: of all attacked or honest links, or of one link.

    A link without any alarm has an infinite time. Links on which no message was tested do not
    count.
    """

    of: Literal["attacked", "honest"] | None = setting(
        None, "about which messages: null, attacked ones, or all of one link"
    )
    which: Literal["first", "last"] = setting("first", "of these links the first, or the last")
    listener: int | None = setting(None, "the vehicle that hears the link, with `source`", ge=1)
    source: int | None = setting(None, "the source of the link, 0 is the navigator", ge=0)

    def model_post_init(self, context: Any) -> None:
        if (self.listener is None) != (self.source is None):
            raise ValueError("give listener and source, or neither")

    def words(self):
        link = "" if self.source is None else f" of {self.listener} about {self.source}"
        told = "first alarm" if self.which == "first" else "first alarm on the last link,"
        of = self.of or ("attacked" if self.source is None else "")
        return f"{told} about {f'{of} messages'.lstrip()}{link}"

    def __call__(self, seen: FleetView) -> VehicleNumbers:
        """The time until now, (m, lanes) [s]."""
        xp = seen.error.__array_namespace__()
        if seen.links is None:
            return of_fleet(seen, xp.inf)
        time = seen.links.first[int(self.of == "honest")]
        if self.listener is not None:
            time = xp.fmin(*seen.links.first) if self.of is None else time
            time = time[:, self.listener - 1 : self.listener]
            there = seen.hearing.sources[:, self.listener - 1 : self.listener] == self.source
            time = xp.where(there[..., None], time, xp.nan)
        known = ~xp.isnan(time)
        if self.which == "first":
            return of_fleet(seen, xp.where(known, time, xp.inf).min(axis=(0, 1)))
        last = xp.where(known, time, -xp.inf).max(axis=(0, 1))
        return of_fleet(seen, xp.where(known.any(axis=(0, 1)), last, xp.inf))

    def faults(self, scenario):
        most = scenario.vehicles
        if max(self.listener or 0, self.source or 0) > most:
            told = f"first_alarm: there are {most} vehicles"
            yield Fault(("metrics", "vehicles"), f"{told} (got {self.listener}, {self.source})")


FIRST_ALARM = Metric(
    "first_alarm", "s", FirstAlarm(), time="last", words="first alarm", undefined="infinite"
)
