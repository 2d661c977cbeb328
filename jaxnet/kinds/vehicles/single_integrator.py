from jaxnet.kinds.vehicles import Integrators
from jaxnet.model.plane import length


class SingleIntegrator(Integrators):
    """An agent of order 1, `ẏ = u`: state `[x, y]`, the input is the velocity; never singular.

    `initial.heading` and `initial.speed` have no effect.
    """

    order = 1
    words = "single integrators"
    states = ("x", "y")
    units = ("m", "m")
    inputs = ("velocity_x", "velocity_y")
    input_units = ("m/s", "m/s")

    def start(self, position, heading, speed):
        return position

    def pace(self, state, inputs):
        return length(self.drift(state) + inputs), 0.0 * state[0]
