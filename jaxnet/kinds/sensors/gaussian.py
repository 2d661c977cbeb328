"""Gaussian noise in what vehicles sense of themselves."""

from typing import TYPE_CHECKING

from jaxnet.kinds.noise import NormalErrors
from jaxnet.kinds.sensors import Sensor
from jaxnet.kinds.shapes import LaneNumbers, LaneTimes, VehicleJets
from jaxnet.lazy import LazyModule

if TYPE_CHECKING:
    import jax
else:
    jax = LazyModule("jax")


class Gaussian(NormalErrors, Sensor):
    """Normal errors of each vehicle, independent by axis and order.

    The errors drive the vehicle by `-P(n) = -(k0 n⁰ + k1 n¹ + k2 n²)` until the next tick (theorems.md O13).
    """

    kind = "gaussian"
    words = "Gaussian"

    def next_errors(self, last: VehicleJets, time: LaneTimes, interval: LaneNumbers) -> VehicleJets:
        """Return normal errors of all three orders, with outliers."""
        shape = last[0].shape[:2]
        white = self.white(
            last,
            lambda order: self.random(time, order, jax.random.normal, shape),
            lambda: self.random(time, "outliers", jax.random.uniform, shape[1:]),
        )
        return self.after(last, white, time, interval)
