"""The unicycle driven by acceleration (Oriolo, De Luca, Vendittelli, IEEE Trans. CST 10, 2002)."""

from jaxnet.kinds.vehicles import SPEED, Wheeled, directions
from jaxnet.model.circle import angle
from jaxnet.model.plane import length


class Unicycle(Wheeled):
    """A unicycle: state `[x, y, θ, v]`, input `u = [v̇, θ̇]`, order 2; singular at v = 0."""

    words = "unicycles"
    order = 2
    states = ("x", "y", "heading", "speed")
    units = ("m", "m", "rad", "m/s")
    inputs = ("acceleration", "turn_rate")
    input_units = ("m/s²", "rad/s")

    def output_jets(self, state):
        """Position and velocity `v h`."""
        along, _ = directions(state)
        return state[:2], state[SPEED][None] * along

    def motion(self, state, inputs):
        """`[v cos θ, v sin θ, θ̇, v̇]`."""
        return self.moving(state, state[SPEED], inputs[1], inputs[0])

    def state_of(self, jets):
        """The state with `v = ‖ẏ‖` and `θ = atan2(ẏ)`."""
        position, velocity = jets
        pose = [*position, angle(velocity[0], velocity[1])]
        return position.__array_namespace__().stack([*pose, length(velocity)])

    def pace(self, state, inputs):
        return state[SPEED], inputs[1]
