"""A unicycle whose output is a point ahead of its axle, the usual way to steer one as a single integrator."""

from typing import ClassVar

from pydantic import Field

from jaxnet.kinds.fields import Positive
from jaxnet.kinds.shapes import (
    AxisMatrices,
    VehicleInput,
    VehicleJets,
    VehicleNumbers,
    VehicleState,
    VehicleVectors,
)
from jaxnet.kinds.vehicles import Vehicle, directions
from jaxnet.model.plane import dot


class LookAhead(Vehicle):
    """A unicycle of order 1 whose output is the point `y = p + l h`; never singular.

    The state is `[p_x, p_y, θ]` with the position p of the axle, the input is `u = [v, θ̇]`. The output does
    not determine the heading, which follows `θ̇ = n·ẏ / l`. A vehicle that is pushed back turns round.
    `initial.speed` has no effect.
    """

    kind = "look_ahead"
    order: ClassVar[int] = 1
    singular: ClassVar[int] = 0
    internal: ClassVar[bool] = True
    states = ("x", "y", "heading")
    units = ("m", "m", "rad")
    inputs = ("speed", "turn_rate")
    input_units = ("m/s", "rad/s")

    ahead: Positive = Field(default=0.1, description="[m], l, from the axle to the output point")

    def start(self, position: VehicleVectors, heading: VehicleNumbers, speed: VehicleNumbers) -> VehicleState:
        """Return the axle's positions and the headings."""
        return position.__array_namespace__().stack([position[0], position[1], heading])

    def output_jets(self, state: VehicleState) -> VehicleJets:
        """Return the point `p + l h`."""
        along, _ = directions(state)
        return (state[:2] + self.ahead[None, None] * along,)

    def drift(self, state: VehicleState) -> VehicleVectors:
        """Return σ = 0."""
        return 0.0 * state[:2]

    def decoupling(self, state: VehicleState) -> AxisMatrices:
        """Return `ψ = [h, l n]`, with `det ψ = l`."""
        along, left = directions(state)
        return state.__array_namespace__().stack([along, self.ahead[None, None] * left], axis=1)

    def inputs_for(self, state: VehicleState, jerk: VehicleVectors) -> VehicleInput:
        """Return `[h' q, n' q / l]` for a velocity q of the point."""
        along, left = directions(state)
        return state.__array_namespace__().stack([dot(along, jerk), dot(left, jerk) / self.ahead[None]])

    def motion(self, state: VehicleState, inputs: VehicleInput) -> VehicleState:
        """Return `[v cos θ, v sin θ, θ̇]`."""
        along, _ = directions(state)
        velocity = inputs[0][None] * along
        return state.__array_namespace__().stack([velocity[0], velocity[1], inputs[1]])

    def pace(self, state: VehicleState, inputs: VehicleInput) -> tuple[VehicleNumbers, VehicleNumbers]:
        """Return the absolute speed of the axle, and the turn rate."""
        return abs(inputs[0]), inputs[1]
