from jaxnet.kinds.vehicles import SPEED, Wheeled, directions
from jaxnet.model.circle import angle
from jaxnet.model.plane import dot, pace

TURN_RATE, FORCE = 4, 5


class TwoWheeled(Wheeled):
    """The paper's robot (section 4.1; O4): state `[x, y, θ, v, ω, F]`, input `[Ḟ, ω̇]`.

    It is singular at v = 0.
    """

    words = "two-wheeled"
    states = ("x", "y", "heading", "speed", "turn_rate", "force")
    units = ("m", "m", "rad", "m/s", "rad/s", "m/s²")
    inputs = ("force_rate", "angular_acceleration")
    input_units = ("m/s³", "rad/s²")

    def output_jets(self, state):
        """Position, velocity `v h` and acceleration `F h + v ω n`."""
        along, left = directions(state)
        v, turn_rate, force = state[SPEED][None], state[TURN_RATE][None], state[FORCE][None]
        return state[:2], v * along, force * along + v * turn_rate * left

    def drift(self, state):
        """`σ = 2 F ω n - v ω² h`."""
        along, left = directions(state)
        v, turn_rate, force = state[SPEED][None], state[TURN_RATE][None], state[FORCE][None]
        return 2 * force * turn_rate * left - v * turn_rate**2 * along

    def motion(self, state, inputs):
        """`[v cos θ, v sin θ, ω, F, ω̇, Ḟ]`."""
        rates = state[TURN_RATE], state[FORCE], inputs[1], inputs[0]
        return self.moving(state, state[SPEED], *rates)

    def state_of(self, jets):
        """The state with `v = ‖ẏ‖`, `θ = atan2(ẏ)`, `F = ÿ·h`, `ω = ÿ·n / v`."""
        position, velocity, acceleration = jets
        xp = position.__array_namespace__()
        speed, turn_rate = pace(jets)
        heading = angle(velocity[0], velocity[1])
        force = dot(velocity, acceleration) / speed
        return xp.stack([position[0], position[1], heading, speed, turn_rate, force])

    def pace(self, state, inputs):
        return state[SPEED], state[TURN_RATE]
