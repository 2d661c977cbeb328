"""A quadrotor in a vertical plane: `ÿ = T n - g e_2`, thrust along `n = [-sin φ, cos φ]`."""

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
from jaxnet.model.circle import angle, circle
from jaxnet.model.plane import dot, length

GRAVITY = 9.81  # [m/s²]
PITCH, PITCH_RATE, THRUST, THRUST_RATE = 4, 5, 6, 7


class PlanarQuadrotor(Vehicle):
    """A quadrotor of order 4 in a vertical plane, whose second axis points up; singular at thrust
    0.

    The state is `[x, y, ẋ, ẏ, φ, φ̇, T, Ṫ]` with the pitch φ and the thrust T over the mass. The
    input is `u = [T̈, φ̈]`. A quadrotor starts at rest and hovers; `initial.heading` and
    `initial.speed` have no effect.
    """

    kind = "planar_quadrotor"
    flat: ClassVar[bool] = True
    words = "quadrotors"
    order: ClassVar[int] = 4
    singular: ClassVar[int] = 2
    states = ("x", "y", "velocity_x", "velocity_y", "pitch", "pitch_rate", "thrust", "thrust_rate")
    units = ("m", "m", "m/s", "m/s", "rad", "rad/s", "m/s²", "m/s³")
    inputs = ("thrust_acceleration", "pitch_acceleration")
    input_units = ("m/s⁴", "rad/s²")

    def start(
        self, position: VehicleVectors, heading: VehicleNumbers, speed: VehicleNumbers
    ) -> VehicleState:
        """Return the state of rest at these positions, with the thrust that holds the weight."""
        rest = 0.0 * position[0]
        return position.__array_namespace__().stack([*position, *[rest] * 4, rest + GRAVITY, rest])

    def output_jets(self, state: VehicleState) -> VehicleJets:
        """Return position, velocity, `T n - g e_2` and `Ṫ n - T φ̇ h`."""
        along, thrust_axis = axes(state)
        thrust, turning = state[THRUST][None], (state[THRUST] * state[PITCH_RATE])[None]
        jerk = state[THRUST_RATE][None] * thrust_axis - turning * along
        return state[:2], state[2:4], lifted(thrust * thrust_axis, -GRAVITY), jerk

    def drift(self, state: VehicleState) -> VehicleVectors:
        """Return `σ = -2 Ṫ φ̇ h - T φ̇² n`."""
        along, thrust_axis = axes(state)
        rate = state[PITCH_RATE][None]
        return (
            -2 * state[THRUST_RATE][None] * rate * along
            - state[THRUST][None] * rate**2 * thrust_axis
        )

    def decoupling(self, state: VehicleState) -> AxisMatrices:
        """Return `ψ = [n, -T h]`, with `det ψ = T`."""
        along, thrust_axis = axes(state)
        return state.__array_namespace__().stack(
            [thrust_axis, -state[THRUST][None] * along], axis=1
        )

    def inputs_for(self, state: VehicleState, jerk: VehicleVectors) -> VehicleInput:
        """Return `[n' (q - σ), -h' (q - σ) / T]` for a fourth derivative q; infinite at T = 0."""
        along, thrust_axis = axes(state)
        demand = jerk - self.drift(state)
        xp = state.__array_namespace__()
        return xp.stack([dot(thrust_axis, demand), -dot(along, demand) / state[THRUST]])

    def motion(self, state: VehicleState, inputs: VehicleInput) -> VehicleState:
        """Return the velocity, the acceleration, `φ̇`, `φ̈`, `Ṫ` and `T̈`."""
        _, velocity, acceleration, _ = self.output_jets(state)
        rates = [
            *velocity,
            *acceleration,
            state[PITCH_RATE],
            inputs[1],
            state[THRUST_RATE],
            inputs[0],
        ]
        return state.__array_namespace__().stack(rates)

    def state_of(self, jets: VehicleJets | StackedJets) -> VehicleState:
        """Return the state with `T n = ÿ + g e_2`, `Ṫ = n·y‴` and `φ̇ = -h·y‴ / T`."""
        position, velocity, acceleration, jerk = jets
        xp, force = position.__array_namespace__(), self.lead(acceleration)
        thrust = length(force)
        thrust_axis = force / thrust[None]
        along = xp.stack([thrust_axis[1], -thrust_axis[0]])
        turning = [angle(force[1], -force[0]), -dot(along, jerk) / thrust]
        return xp.stack([*position, *velocity, *turning, thrust, dot(thrust_axis, jerk)])

    def pace(
        self, state: VehicleState, inputs: VehicleInput
    ) -> tuple[VehicleNumbers, VehicleNumbers]:
        """Return the norm of the velocity, and the pitch rate."""
        return length(state[2:4]), state[PITCH_RATE]

    def margin(self, state: VehicleState) -> VehicleNumbers:
        """Return the thrust over the mass [m/s²]."""
        return state[THRUST]

    def lead(self, derivative: VehicleVectors) -> VehicleVectors:
        """Return `ÿ + g e_2`."""
        return lifted(derivative, GRAVITY)


def axes(state: VehicleState) -> tuple[VehicleVectors, VehicleVectors]:
    """Return the unit vectors across and along the thrust, `h = [cos φ, sin φ]` and `n = [-sin φ,
    cos φ]`.
    """
    xp, (cosine, sine) = state.__array_namespace__(), circle(state[PITCH])
    return xp.stack([cosine, sine]), xp.stack([-sine, cosine])


def lifted(vectors: VehicleVectors, height: float) -> VehicleVectors:
    """Return vectors with a number added to the second component."""
    return vectors.__array_namespace__().stack([vectors[0], vectors[1] + height])
