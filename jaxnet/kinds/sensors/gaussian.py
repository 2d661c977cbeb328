"""Gaussian noise in what vehicles sense of themselves."""

from collections.abc import Sequence
from typing import Annotated

from pydantic import Field

from jaxnet.kinds.fields import Number, Within
from jaxnet.kinds.noise import NormalErrors
from jaxnet.kinds.protocols import LaneDraw
from jaxnet.kinds.sensors import Sensor
from jaxnet.kinds.shapes import LaneNumbers, LaneTimes, VehicleJets, VehicleMask


class Gaussian(NormalErrors, Sensor):
    """Normal errors of each vehicle, independent by axis and order.

    The errors drive the vehicle by `-P(n) = -(k0 n⁰ + k1 n¹ + k2 n²)` until the next tick (theorems.md O13).
    """

    kind = "gaussian"
    words = "Gaussian"

    dropout: Annotated[Number, Within(ge=0.0, lt=1.0)] = Field(
        default=0.0, description="probability that a vehicle senses what it sensed at the last tick"
    )

    def exact(self) -> bool:
        """Return whether all standard deviations are 0 and nothing drops out."""
        return super().exact() and self.dropout == 0

    def strength(self, gain: Sequence[float]) -> tuple[float, float] | None:
        """Return the variance of P of the errors; None with dropout, whose errors depend on the motion."""
        return super().strength(gain) if self.dropout == 0 else None

    def tells_deviations(self) -> bool:
        """Return whether nothing drops out."""
        return self.dropout == 0

    def drawn(self, draw: LaneDraw, name: str) -> "Gaussian":
        """Return the kind with drawn numbers; without dropout it is None."""
        found = super().drawn(draw, name)
        return (
            self.filled({**vars(found), "dropout": None})
            if self.dropout == 0
            else self.filled(vars(found))
        )

    def stays(self, time: LaneTimes, vehicles: int) -> VehicleMask | None:
        """Return the vehicles whose random number is below the probability, nobody at the first tick."""
        if self.dropout is None:
            return None
        drawn = self.random(time, "dropout", "uniform", (vehicles,))
        return (drawn < self.dropout[None]) & (time > 0)[None]

    def next_errors(self, last: VehicleJets, time: LaneTimes, interval: LaneNumbers) -> VehicleJets:
        """Return normal errors of all three orders, with outliers."""
        shape = last[0].shape[:2]
        white = self.white(
            last,
            lambda order: self.random(time, order, "normal", shape),
            lambda: self.random(time, "outliers", "uniform", shape[1:]),
        )
        return self.after(last, white, time, interval)
