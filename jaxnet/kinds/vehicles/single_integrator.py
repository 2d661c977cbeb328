"""The single integrator, the agent of most studies of consensus."""

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
from jaxnet.kinds.vehicles.double_integrator import identity_matrices


class SingleIntegrator(Vehicle):
    """An agent of order 1, `ẏ = u`: state `[x, y]`, the input is the velocity; never singular.

    `initial.heading` and `initial.speed` have no effect.
    """

    kind = "single_integrator"
    order: ClassVar[int] = 1
    singular: ClassVar[bool] = False
    words = "single integrators"
    states = ("x", "y")
    units = ("m", "m")
    inputs = ("velocity_x", "velocity_y")
    input_units = ("m/s", "m/s")

    def start(self, position: VehicleVectors, heading: VehicleNumbers, speed: VehicleNumbers) -> VehicleState:
        """Return the positions."""
        return position

    def output_jets(self, state: VehicleState) -> VehicleJets:
        """Return the position alone."""
        return (state,)

    def drift(self, state: VehicleState) -> VehicleVectors:
        """Return 0."""
        return 0.0 * state

    def decoupling(self, state: VehicleState) -> AxisMatrices:
        """Return the identity."""
        return identity_matrices(state[:2])

    def inputs_for(self, state: VehicleState, jerk: VehicleVectors) -> VehicleInput:
        """Return the velocity."""
        return jerk

    def motion(self, state: VehicleState, inputs: VehicleInput) -> VehicleState:
        """Return the velocity."""
        return inputs

    def state_of(self, jets: VehicleJets | StackedJets) -> VehicleState:
        """Return the position."""
        return jets[0]

    def pace(self, state: VehicleState) -> tuple[VehicleNumbers, VehicleNumbers]:
        """Return 0 for the speed, which is an input, and 0 for the turn rate, as there is no heading."""
        return 0.0 * state[0], 0.0 * state[0]
