"""A quadrotor in a vertical plane: `ÿ = T n - g e_2`, thrust along `n = [-sin φ, cos φ]`."""

from jaxnet.kinds.shapes import VehicleState, VehicleVectors
from jaxnet.kinds.vehicles import Framed
from jaxnet.model.circle import angle, circle
from jaxnet.model.plane import dot, length

GRAVITY = 9.81  # [m/s²]
PITCH, PITCH_RATE, THRUST, THRUST_RATE = 4, 5, 6, 7


class PlanarQuadrotor(Framed):
    """A quadrotor of order 4 in a vertical plane, whose second axis points up; singular at thrust
    0.

    The state is `[x, y, ẋ, ẏ, φ, φ̇, T, Ṫ]` with the pitch φ and the thrust T over the mass. The
    input is `u = [T̈, φ̈]`. A quadrotor starts at rest and hovers; `initial.heading` and
    `initial.speed` have no effect.
    """

    words = "quadrotors"
    order = 4
    singular = 2
    states = ("x", "y", "velocity_x", "velocity_y", "pitch", "pitch_rate", "thrust", "thrust_rate")
    units = ("m", "m", "m/s", "m/s", "rad", "rad/s", "m/s²", "m/s³")
    inputs = ("thrust_acceleration", "pitch_acceleration")
    input_units = ("m/s⁴", "rad/s²")

    def start(self, position, heading, speed):
        rest = 0.0 * position[0]
        return position.__array_namespace__().stack([*position, *[rest] * 4, rest + GRAVITY, rest])

    def output_jets(self, state):
        """Position, velocity, `T n - g e_2` and `Ṫ n - T φ̇ h`."""
        along, thrust_axis = axes(state)
        thrust, turning = state[THRUST][None], (state[THRUST] * state[PITCH_RATE])[None]
        jerk = state[THRUST_RATE][None] * thrust_axis - turning * along
        return state[:2], state[2:4], lifted(thrust * thrust_axis, -GRAVITY), jerk

    def drift(self, state):
        """`σ = -2 Ṫ φ̇ h - T φ̇² n`."""
        along, thrust_axis = axes(state)
        rate, thrust = state[PITCH_RATE][None], state[THRUST][None]
        return -2 * state[THRUST_RATE][None] * rate * along - thrust * rate**2 * thrust_axis

    def frame(self, state):
        """`ψ = [n, -T h]`, with `det ψ = T`."""
        along, thrust_axis = axes(state)
        return thrust_axis, -along

    def sideways(self, state):
        return state[THRUST]

    def motion(self, state, inputs):
        """The velocity, the acceleration, `φ̇`, `φ̈`, `Ṫ` and `T̈`."""
        _, velocity, acceleration, _ = self.output_jets(state)
        rates = [state[PITCH_RATE], inputs[1], state[THRUST_RATE], inputs[0]]
        return state.__array_namespace__().stack([*velocity, *acceleration, *rates])

    def state_of(self, jets):
        """The state with `T n = ÿ + g e_2`, `Ṫ = n·y‴` and `φ̇ = -h·y‴ / T`."""
        position, velocity, acceleration, jerk = jets
        xp, force = position.__array_namespace__(), self.lead(acceleration)
        thrust = length(force)
        thrust_axis = force / thrust[None]
        along = xp.stack([thrust_axis[1], -thrust_axis[0]])
        turning = [angle(force[1], -force[0]), -dot(along, jerk) / thrust]
        return xp.stack([*position, *velocity, *turning, thrust, dot(thrust_axis, jerk)])

    def pace(self, state, inputs):
        return length(state[2:4]), state[PITCH_RATE]

    def margin(self, state):
        """The thrust over the mass [m/s²]."""
        return state[THRUST]

    def lead(self, derivative):
        """`ÿ + g e_2`."""
        return lifted(derivative, GRAVITY)


def axes(state: VehicleState) -> tuple[VehicleVectors, VehicleVectors]:
    """Unit vectors across and along the thrust, `h = [cos φ, sin φ]` and `n = [-sin φ, cos φ]`."""
    xp, (cosine, sine) = state.__array_namespace__(), circle(state[PITCH])
    return xp.stack([cosine, sine]), xp.stack([-sine, cosine])


def lifted(vectors: VehicleVectors, height: float) -> VehicleVectors:
    """Vectors with a number added to the second component."""
    return vectors.__array_namespace__().stack([vectors[0], vectors[1] + height])
