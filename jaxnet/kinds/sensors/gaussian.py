"""White Gaussian noise in what vehicles sense of themselves."""

from typing import TYPE_CHECKING

from pydantic import Field

from jaxnet.kinds.fields import NotNegative
from jaxnet.kinds.sensors import Sensor
from jaxnet.kinds.shapes import LaneTimes, VehicleJets
from jaxnet.lazy import LazyModule

if TYPE_CHECKING:
    import jax
else:
    jax = LazyModule("jax")


class Gaussian(Sensor):
    """Independent normal errors of each vehicle, axis, order and tick.

    The errors drive the vehicle by `-P(n) = -(k0 n⁰ + k1 n¹ + k2 n²)` until the next tick (SCIENCE O13).
    """

    kind = "gaussian"

    position: NotNegative = Field(default=0.0, description="[m], standard deviation on each axis")
    velocity: NotNegative = Field(default=0.0, description="[m/s], standard deviation on each axis")
    acceleration: NotNegative = Field(default=0.0, description="[m/s²], standard deviation on each axis")

    def exact(self) -> bool:
        """Return whether all standard deviations are 0."""
        return self.position == self.velocity == self.acceleration == 0

    def draws(self) -> bool:
        """Return whether a standard deviation is not 0."""
        return not self.exact()

    def errors(self, time: LaneTimes, vehicles: int) -> VehicleJets:
        """Return normal errors of all three orders."""
        position, velocity, acceleration = (
            size[None, None] * self.random(time, order, jax.random.normal, (2, vehicles))
            for order, size in (
                ("position", self.position),
                ("velocity", self.velocity),
                ("acceleration", self.acceleration),
            )
        )
        return position, velocity, acceleration
