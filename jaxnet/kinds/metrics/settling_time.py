from typing import Any, Literal

from jaxnet.kinds.fields import setting
from jaxnet.kinds.metrics import Metric, MetricKeys, of_fleet
from jaxnet.kinds.metrics.spread import farthest_honest
from jaxnet.kinds.protocols import FleetView
from jaxnet.kinds.shapes import LaneNumbers, VehicleNumbers

LEAST_LENGTH = 1e-9  # [m]: shorter ones are rounding


class SettlingTime(MetricKeys):
    """The first output time after which the error stays below a length, or a part of the start.

    Times are those of outputs (`output_step`). Without a navigator the spread counts. A lane that
    is not below at the last output has never settled: its time is infinite.
    """

    below: float | None = setting(None, "[m], the length", gt=0)
    fraction: float | None = setting(
        None, "of the error at the start; 0.01 where `below` is not given", gt=0, lt=1
    )
    of: Literal["mean", "greatest"] = setting("mean", "which error over the vehicles")

    def model_post_init(self, context: Any) -> None:
        if self.below is not None and self.fraction is not None:
            raise ValueError("give below or fraction, not both")

    @property
    def share(self) -> float | None:
        """The fraction of the start; None where a length is asked for."""
        return None if self.below is not None else self.fraction or 0.01

    def words(self):
        limit = (
            f"{self.below:g} m" if self.share is None else f"{100 * self.share:g} % of the start"
        )
        return f"settling time to {limit}{', greatest vehicle' * (self.of == 'greatest')}"

    def size(self, seen: FleetView) -> LaneNumbers:
        """The error [m] that has to settle, (lanes,); without a navigator the spread."""
        if not seen.leads:
            return farthest_honest(seen).max(axis=0)
        errors = seen.errors()
        return errors.max(axis=0) if self.of == "greatest" else errors.mean(axis=0)

    def __call__(self, seen: FleetView) -> VehicleNumbers:
        """The next output time where the error is not below now, else 0: (m, lanes) [s]."""
        xp, limit = seen.error.__array_namespace__(), self.below
        if self.share is not None:
            start = self.size(seen._replace(error=seen.errors_at_start()))
            limit = xp.maximum(self.share * start, LEAST_LENGTH)
        return of_fleet(seen, xp.where(self.size(seen) > limit, seen.next_time, 0.0))


SETTLING_TIME = Metric("settling_time", "s", SettlingTime(), undefined="infinite")
