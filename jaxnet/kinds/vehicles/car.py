"""A car: the kinematic bicycle with front steering. The output is the position of the rear axle.

With the curvature κ = tan δ / L of the path: `ẏ = v h`, `ÿ = a h + v² κ n`, `y‴ = (ȧ - v³ κ²) h +
(3 v a κ + v² δ̇ / (L cos² δ)) n`.
"""

from typing import ClassVar

from pydantic import Field

from jaxnet.kinds.fields import Positive
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
from jaxnet.model.plane import cross, dot, pace

STEERING, ACCELERATION = 4, 5


class Car(Vehicle):
    """State `[x, y, θ, v, δ, a]`, steering angle |δ| < π/2, input `u = [ȧ, δ̇]`; singular at v =
    0.
    """

    kind = "car"
    flat: ClassVar[bool] = True
    states = ("x", "y", "heading", "speed", "steering", "acceleration")
    units = ("m", "m", "rad", "m/s", "rad", "m/s²")
    inputs = ("acceleration_rate", "steering_rate")
    input_units = ("m/s³", "rad/s")

    wheelbase: Positive = Field(default=0.5, description="[m], from axle to axle")

    def curvature(self, state: VehicleState) -> VehicleNumbers:
        """Return the curvature `κ = tan δ / L` [1/m]."""
        return state.__array_namespace__().tan(state[STEERING]) / self.wheelbase[None]

    def output_jets(self, state: VehicleState) -> VehicleJets:
        """Return position, velocity `v h` and acceleration `a h + v² κ n`."""
        along, left = directions(state)
        v, bend = state[SPEED], self.curvature(state)
        return (
            state[:2],
            v[None] * along,
            state[ACCELERATION][None] * along + (v**2 * bend)[None] * left,
        )

    def drift(self, state: VehicleState) -> VehicleVectors:
        """Return `σ = 3 v a κ n - v³ κ² h`."""
        along, left = directions(state)
        v, bend = state[SPEED], self.curvature(state)
        return (3 * v * state[ACCELERATION] * bend)[None] * left - (v**3 * bend**2)[None] * along

    def steered(self, state: VehicleState) -> VehicleNumbers:
        """Return `v² / (L cos² δ)`, the factor from the steering rate to the jerk to the left."""
        tangent = state.__array_namespace__().tan(state[STEERING])
        return state[SPEED] ** 2 * (1 + tangent**2) / self.wheelbase[None]

    def decoupling(self, state: VehicleState) -> AxisMatrices:
        """Return `ψ = [h, v² / (L cos² δ) n]`."""
        along, left = directions(state)
        return state.__array_namespace__().stack([along, self.steered(state)[None] * left], axis=1)

    def inputs_for(self, state: VehicleState, jerk: VehicleVectors) -> VehicleInput:
        """Return the input from the demand along and across the heading; infinite at v = 0."""
        along, left = directions(state)
        demand = jerk - self.drift(state)
        xp = state.__array_namespace__()
        return xp.stack([dot(along, demand), dot(left, demand) / self.steered(state)])

    def motion(self, state: VehicleState, inputs: VehicleInput) -> VehicleState:
        """Return `[v cos θ, v sin θ, v κ, a, δ̇, ȧ]`."""
        along, _ = directions(state)
        velocity, (_, turn_rate) = state[SPEED][None] * along, self.pace(state, inputs)
        rates = [velocity[0], velocity[1], turn_rate, state[ACCELERATION], inputs[1], inputs[0]]
        return state.__array_namespace__().stack(rates)

    def state_of(self, jets: VehicleJets | StackedJets) -> VehicleState:
        """`v = ‖ẏ‖`, `θ = atan2(ẏ)`, `δ = atan(L κ)` with `κ = ẏ × ÿ / v³`, `a = ẏ·ÿ / v`."""
        position, velocity, acceleration = jets
        xp = position.__array_namespace__()
        speed, _ = pace(jets)
        heading = angle(velocity[0], velocity[1])
        steering = xp.arctan(self.wheelbase[None] * cross(velocity, acceleration) / speed**3)
        along = dot(velocity, acceleration) / speed
        return xp.stack([position[0], position[1], heading, speed, steering, along])

    def pace(
        self, state: VehicleState, inputs: VehicleInput
    ) -> tuple[VehicleNumbers, VehicleNumbers]:
        """Return the speed, and the turn rate `θ̇ = v κ`."""
        return state[SPEED], state[SPEED] * self.curvature(state)
