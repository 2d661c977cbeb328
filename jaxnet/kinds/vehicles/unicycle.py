"""The unicycle with an acceleration as input (Oriolo, De Luca and Vendittelli, IEEE Trans. CST 10,
2002).
"""

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
from jaxnet.kinds.vehicles import SPEED, Vehicle, directions
from jaxnet.model.circle import angle
from jaxnet.model.plane import dot, length


class Unicycle(Vehicle):
    """A unicycle: state `[x, y, θ, v]`, input `u = [v̇, θ̇]`, order 2; singular at v = 0."""

    kind = "unicycle"
    flat: ClassVar[bool] = True
    words = "unicycles"
    order: ClassVar[int] = 2
    states = ("x", "y", "heading", "speed")
    units = ("m", "m", "rad", "m/s")
    inputs = ("acceleration", "turn_rate")
    input_units = ("m/s²", "rad/s")

    def output_jets(self, state: VehicleState) -> VehicleJets:
        """Return position and velocity `v h`."""
        along, _ = directions(state)
        return state[:2], state[SPEED][None] * along

    def drift(self, state: VehicleState) -> VehicleVectors:
        """Return σ = 0."""
        return 0.0 * state[:2]

    def decoupling(self, state: VehicleState) -> AxisMatrices:
        """Return `ψ = [h, v n]`, with `det ψ = v`."""
        along, left = directions(state)
        return state.__array_namespace__().stack([along, state[SPEED][None] * left], axis=1)

    def inputs_for(self, state: VehicleState, jerk: VehicleVectors) -> VehicleInput:
        """Return `[h' q, n' q / v]` for an acceleration q; infinite at v = 0."""
        along, left = directions(state)
        return state.__array_namespace__().stack([dot(along, jerk), dot(left, jerk) / state[SPEED]])

    def motion(self, state: VehicleState, inputs: VehicleInput) -> VehicleState:
        """Return `[v cos θ, v sin θ, θ̇, v̇]`."""
        along, _ = directions(state)
        velocity = state[SPEED][None] * along
        return state.__array_namespace__().stack([velocity[0], velocity[1], inputs[1], inputs[0]])

    def state_of(self, jets: VehicleJets | StackedJets) -> VehicleState:
        """Return the state with `v = ‖ẏ‖` and `θ = atan2(ẏ)`."""
        position, velocity = jets
        heading = angle(velocity[0], velocity[1])
        return position.__array_namespace__().stack(
            [position[0], position[1], heading, length(velocity)]
        )

    def pace(
        self, state: VehicleState, inputs: VehicleInput
    ) -> tuple[VehicleNumbers, VehicleNumbers]:
        """Return the speed, a state, and the turn rate, an input."""
        return state[SPEED], inputs[1]
