"""White Gaussian noise in what vehicles sense of themselves."""

from typing import TYPE_CHECKING, Any

from pydantic import Field

from jaxnet.kinds.fields import NotNegative
from jaxnet.kinds.protocols import LaneDraw
from jaxnet.kinds.sensors import Sensor
from jaxnet.kinds.shapes import LaneTimes, VehicleJets, VehicleVectors
from jaxnet.lazy import LazyModule

if TYPE_CHECKING:
    import jax
    import jax.numpy as jnp
else:
    jax = LazyModule("jax")
    jnp = LazyModule("jax.numpy")


class Gaussian(Sensor):
    """Independent normal errors of each vehicle, axis, order and tick.

    The errors drive the vehicle by `-P(n) = -(k0 n⁰ + k1 n¹ + k2 n²)` until the next tick (theorems.md O13).
    """

    kind = "gaussian"
    words = "Gaussian"

    position: NotNegative = Field(default=0.0, description="[m], standard deviation on each axis")
    velocity: NotNegative = Field(default=0.0, description="[m/s], standard deviation on each axis")
    acceleration: NotNegative = Field(default=0.0, description="[m/s²], standard deviation on each axis")

    def sizes(self) -> dict[str, Any]:
        """Return the standard deviations, by order of derivative."""
        return {order: getattr(self, order) for order in ("position", "velocity", "acceleration")}

    def exact(self) -> bool:
        """Return whether all standard deviations are 0."""
        return all(size == 0 for size in self.sizes().values())

    def draws(self) -> bool:
        """Return whether a standard deviation is not 0."""
        return not self.exact()

    def drawn(self, draw: LaneDraw, name: str) -> "Gaussian":
        """Return the sensor with drawn numbers; a standard deviation of 0 is None, and draws nothing."""
        unused = {order: None for order, size in self.sizes().items() if size == 0}
        return self.filled({**vars(super().drawn(draw, name)), **unused})

    def errors(self, time: LaneTimes, vehicles: int) -> VehicleJets:
        """Return normal errors of all three orders."""
        shape = (2, vehicles)

        def of_order(order: str, size: Any) -> VehicleVectors:
            if size is None:
                return jnp.zeros((*shape, *time.shape))
            return size[None, None] * self.random(time, order, jax.random.normal, shape)

        position, velocity, acceleration = (of_order(*each) for each in self.sizes().items())
        return position, velocity, acceleration
