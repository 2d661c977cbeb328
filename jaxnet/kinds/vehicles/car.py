"""A car: the kinematic bicycle with front steering. The output is the position of the rear axle.

With the curvature κ = tan δ / L of the path: `ẏ = v h`, `ÿ = a h + v² κ n`, `y‴ = (ȧ - v³ κ²) h +
(3 v a κ + v² δ̇ / (L cos² δ)) n`.
"""

from jaxnet.kinds.fields import Positive, setting
from jaxnet.kinds.shapes import VehicleNumbers, VehicleState
from jaxnet.kinds.vehicles import SPEED, Wheeled, directions
from jaxnet.model.circle import angle
from jaxnet.model.plane import cross, dot, pace

STEERING, ACCELERATION = 4, 5


class Car(Wheeled):
    """State `[x, y, θ, v, δ, a]`, steering angle |δ| < π/2, input `u = [ȧ, δ̇]`; singular at
    v = 0.
    """

    states = ("x", "y", "heading", "speed", "steering", "acceleration")
    units = ("m", "m", "rad", "m/s", "rad", "m/s²")
    inputs = ("acceleration_rate", "steering_rate")
    input_units = ("m/s³", "rad/s")

    wheelbase: Positive = setting(0.5, "[m], from axle to axle")

    def curvature(self, state: VehicleState) -> VehicleNumbers:
        """The curvature `κ = tan δ / L` [1/m]."""
        return state.__array_namespace__().tan(state[STEERING]) / self.wheelbase[None]

    def output_jets(self, state):
        """Position, velocity `v h` and acceleration `a h + v² κ n`."""
        along, left = directions(state)
        v, bend = state[SPEED], self.curvature(state)
        second = state[ACCELERATION][None] * along + (v**2 * bend)[None] * left
        return state[:2], v[None] * along, second

    def drift(self, state):
        """`σ = 3 v a κ n - v³ κ² h`."""
        along, left = directions(state)
        v, bend = state[SPEED], self.curvature(state)
        return (3 * v * state[ACCELERATION] * bend)[None] * left - (v**3 * bend**2)[None] * along

    def sideways(self, state):
        """`v² / (L cos² δ)`, the factor from the steering rate to the jerk to the left."""
        tangent = state.__array_namespace__().tan(state[STEERING])
        return state[SPEED] ** 2 * (1 + tangent**2) / self.wheelbase[None]

    def motion(self, state, inputs):
        """`[v cos θ, v sin θ, v κ, a, δ̇, ȧ]`."""
        speed, turn_rate = self.pace(state, inputs)
        return self.moving(state, speed, turn_rate, state[ACCELERATION], inputs[1], inputs[0])

    def state_of(self, jets):
        """`v = ‖ẏ‖`, `θ = atan2(ẏ)`, `δ = atan(L κ)` with `κ = ẏ × ÿ / v³`, `a = ẏ·ÿ / v`."""
        position, velocity, acceleration = jets
        xp = position.__array_namespace__()
        speed, _ = pace(jets)
        heading = angle(velocity[0], velocity[1])
        steering = xp.arctan(self.wheelbase[None] * cross(velocity, acceleration) / speed**3)
        along = dot(velocity, acceleration) / speed
        return xp.stack([position[0], position[1], heading, speed, steering, along])

    def pace(self, state, inputs):
        """The speed, and the turn rate `θ̇ = v κ`."""
        return state[SPEED], state[SPEED] * self.curvature(state)
