from jaxnet.kinds.vehicles import Integrators
from jaxnet.model.circle import circle
from jaxnet.model.plane import length


class DoubleIntegrator(Integrators):
    """An agent of order 2, `ÿ = u`: state `[x, y, ẋ, ẏ]`, the input is the acceleration; never
    singular.

    The initial velocity has the speed `initial.speed` along `initial.heading`.
    """

    order = 2
    words = "double integrators"
    states = ("x", "y", "velocity_x", "velocity_y")
    units = ("m", "m", "m/s", "m/s")
    inputs = ("acceleration_x", "acceleration_y")
    input_units = ("m/s²", "m/s²")

    def start(self, position, heading, speed):
        xp, (cosine, sine) = position.__array_namespace__(), circle(heading)
        return xp.stack([position[0], position[1], speed * cosine, speed * sine])

    def pace(self, state, inputs):
        return length(state[2:]), 0.0 * state[0]
