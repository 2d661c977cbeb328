"""The double integrator, a point with velocity and a force on it."""

from typing import ClassVar

from jaxnet.kinds.shapes import VehicleInput, VehicleNumbers, VehicleState, VehicleVectors
from jaxnet.kinds.vehicles import Integrators
from jaxnet.model.circle import circle
from jaxnet.model.plane import length


class DoubleIntegrator(Integrators):
    """An agent of order 2, `ÿ = u`: state `[x, y, ẋ, ẏ]`, the input is the acceleration; never
    singular.

    The initial velocity has the speed `initial.speed` along `initial.heading`.
    """

    kind = "double_integrator"
    order: ClassVar[int] = 2
    words = "double integrators"
    states = ("x", "y", "velocity_x", "velocity_y")
    units = ("m", "m", "m/s", "m/s")
    inputs = ("acceleration_x", "acceleration_y")
    input_units = ("m/s²", "m/s²")

    def start(
        self, position: VehicleVectors, heading: VehicleNumbers, speed: VehicleNumbers
    ) -> VehicleState:
        """Return positions and velocities, along the heading."""
        xp, (cosine, sine) = position.__array_namespace__(), circle(heading)
        return xp.stack([position[0], position[1], speed * cosine, speed * sine])

    def pace(
        self, state: VehicleState, inputs: VehicleInput
    ) -> tuple[VehicleNumbers, VehicleNumbers]:
        """Return the speed, and 0 for the turn rate, as there is no heading."""
        return length(state[2:]), 0.0 * state[0]
