"""The double integrator, a point with velocity and a force on it."""

from typing import ClassVar

from jaxnet.kinds.shapes import (
    AxisMatrices,
    StackedJets,
    VehicleInput,
    VehicleJets,
    VehicleNumbers,
    VehicleState,
    VehicleVectors,
)
from jaxnet.kinds.vehicles import Vehicle
from jaxnet.model.circle import circle
from jaxnet.model.plane import length


class DoubleIntegrator(Vehicle):
    """An agent of order 2, `ÿ = u`: state `[x, y, ẋ, ẏ]`, the input is the acceleration; never singular.

    The initial velocity has the speed `initial.speed` along `initial.heading`.
    """

    kind = "double_integrator"
    order: ClassVar[int] = 2
    singular: ClassVar[bool] = False
    words = "double integrators"
    states = ("x", "y", "velocity_x", "velocity_y")
    units = ("m", "m", "m/s", "m/s")
    inputs = ("acceleration_x", "acceleration_y")
    input_units = ("m/s²", "m/s²")

    def start(self, position: VehicleVectors, heading: VehicleNumbers, speed: VehicleNumbers) -> VehicleState:
        """Return positions and velocities."""
        xp, (cosine, sine) = position.__array_namespace__(), circle(heading)
        return xp.stack([position[0], position[1], speed * cosine, speed * sine])

    def output_jets(self, state: VehicleState) -> VehicleJets:
        """Return position and velocity."""
        return state[:2], state[2:]

    def drift(self, state: VehicleState) -> VehicleVectors:
        """Return 0."""
        return 0.0 * state[:2]

    def decoupling(self, state: VehicleState) -> AxisMatrices:
        """Return the identity."""
        return identity_matrices(state[:2])

    def inputs_for(self, state: VehicleState, jerk: VehicleVectors) -> VehicleInput:
        """Return the acceleration."""
        return jerk

    def motion(self, state: VehicleState, inputs: VehicleInput) -> VehicleState:
        """Return velocity and acceleration."""
        return state.__array_namespace__().concatenate([state[2:], inputs])

    def state_of(self, jets: VehicleJets | StackedJets) -> VehicleState:
        """Return position and velocity in one array."""
        return jets[0].__array_namespace__().concatenate([jets[0], jets[1]])

    def pace(self, state: VehicleState) -> tuple[VehicleNumbers, VehicleNumbers]:
        """Return the speed, and 0 for the turn rate, as there is no heading."""
        return length(state[2:]), 0.0 * state[0]


def identity_matrices(position: VehicleVectors) -> AxisMatrices:
    """Return the identity, (2, 2, m, lanes), of vehicles at these positions."""
    xp = position.__array_namespace__()
    one, zero = xp.ones_like(position[0]), xp.zeros_like(position[0])
    return xp.stack([xp.stack([one, zero]), xp.stack([zero, one])])
