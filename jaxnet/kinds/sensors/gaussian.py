from typing import Annotated

from jaxnet.kinds.fields import Number, Within, setting
from jaxnet.kinds.sensors import Sensor
from jaxnet.kinds.shapes import VehicleNumbers, VehicleVectors
from jaxnet.kinds.ticks import NormalErrors


class Gaussian(NormalErrors, Sensor):
    """Normal errors of each vehicle, independent by axis and order.

    The errors drive the vehicle by `-P(n) = -(k0 n⁰ + k1 n¹ + k2 n²)` until the next tick
    (theorems.md O13).
    """

    words = "Gaussian"

    dropout: Annotated[Number, Within(ge=0.0, lt=1.0)] = setting(
        0.0, "probability that a vehicle senses what it sensed at the last tick"
    )

    def exact(self):
        return super().exact() and self.dropout == 0

    def strength(self, gain):
        """The variance of P of the errors; None with dropout, whose errors depend on the motion."""
        return super().strength(gain) if self.dropout == 0 else None

    def tells_deviations(self):
        return self.dropout == 0

    def stays(self, time, vehicles):
        if self.dropout is None:
            return None
        drawn = self.random(time, "dropout", "uniform", (vehicles,))
        return (drawn < self.dropout[None]) & (time > 0)[None]

    def next_errors(self, last, time, interval):
        shape = last[0].shape[:2]

        def draw(order: str) -> VehicleVectors:
            return self.random(time, order, "normal", shape)

        def uniform() -> VehicleNumbers:
            return self.random(time, "outliers", "uniform", shape[1:])

        return self.normal_errors(last, time, interval, draw, uniform)
