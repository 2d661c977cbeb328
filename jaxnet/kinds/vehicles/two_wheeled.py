"""The paper's two-wheeled robot (section 4.1; theorems.md O4)."""

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
from jaxnet.model.plane import dot, pace

TURN_RATE, FORCE = 4, 5


class TwoWheeled(Vehicle):
    """The paper's two-wheeled robot: state `[x, y, θ, v, ω, F]`, input `u = [Ḟ, ω̇]`; singular at v
    = 0.
    """

    kind = "two_wheeled"
    flat: ClassVar[bool] = True
    words = "two-wheeled"
    states = ("x", "y", "heading", "speed", "turn_rate", "force")
    units = ("m", "m", "rad", "m/s", "rad/s", "m/s²")
    inputs = ("force_rate", "angular_acceleration")
    input_units = ("m/s³", "rad/s²")

    def output_jets(self, state: VehicleState) -> VehicleJets:
        """Return position, velocity `v h` and acceleration `F h + v ω n`."""
        along, left = directions(state)
        v, turn_rate, force = state[SPEED][None], state[TURN_RATE][None], state[FORCE][None]
        return state[:2], v * along, force * along + v * turn_rate * left

    def drift(self, state: VehicleState) -> VehicleVectors:
        """Return `σ = 2 F ω n - v ω² h`."""
        along, left = directions(state)
        v, turn_rate, force = state[SPEED][None], state[TURN_RATE][None], state[FORCE][None]
        return 2 * force * turn_rate * left - v * turn_rate**2 * along

    def decoupling(self, state: VehicleState) -> AxisMatrices:
        """Return `ψ = [h, v n]`, with `det ψ = v`."""
        along, left = directions(state)
        return state.__array_namespace__().stack([along, state[SPEED][None] * left], axis=1)

    def inputs_for(self, state: VehicleState, jerk: VehicleVectors) -> VehicleInput:
        """Return `[h' (jerk - σ), n' (jerk - σ) / v]`; infinite at v = 0."""
        along, left = directions(state)
        demand = jerk - self.drift(state)
        xp = state.__array_namespace__()
        return xp.stack([dot(along, demand), dot(left, demand) / state[SPEED]])

    def motion(self, state: VehicleState, inputs: VehicleInput) -> VehicleState:
        """Return `[v cos θ, v sin θ, ω, F, ω̇, Ḟ]`."""
        along, _ = directions(state)
        velocity = state[SPEED][None] * along
        xp = state.__array_namespace__()
        return xp.stack(
            [velocity[0], velocity[1], state[TURN_RATE], state[FORCE], inputs[1], inputs[0]]
        )

    def state_of(self, jets: VehicleJets | StackedJets) -> VehicleState:
        """Return the state with `v = ‖ẏ‖`, `θ = atan2(ẏ)`, `F = ÿ·h`, `ω = ÿ·n / v`."""
        position, velocity, acceleration = jets
        xp = position.__array_namespace__()
        speed, turn_rate = pace(jets)
        heading = angle(velocity[0], velocity[1])
        force = dot(velocity, acceleration) / speed
        return xp.stack([position[0], position[1], heading, speed, turn_rate, force])

    def pace(
        self, state: VehicleState, inputs: VehicleInput
    ) -> tuple[VehicleNumbers, VehicleNumbers]:
        """Return the speed and the turn rate, which are states."""
        return state[SPEED], state[TURN_RATE]
