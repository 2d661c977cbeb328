from jaxnet.kinds.fields import Positive, setting
from jaxnet.kinds.vehicles.look_ahead import LookAhead


class Robotarium(LookAhead):
    """A robot of the Robotarium: `look_ahead` with two wheels whose rates saturate.

    A saturated wheel changes the curvature of the path. Source: the arena's public simulator,
    robotarium_python_simulator 2.1.0, rps/robotarium_abc.py.
    """

    words = "Robotarium robots"
    limitable = ("wheel_rate",)

    ahead: Positive = setting(0.05, "[m], l, from the axle to the output point")
    wheel_radius: Positive = setting(0.016, "[m]")
    base: Positive = setting(0.11, "[m], from wheel to wheel")
    limits: dict[str, Positive] = setting({"wheel_rate": 12.5}, "`wheel_rate` [rad/s], of a wheel")

    def within_limits(self, inputs):
        """The speed and turn rate of wheels with saturated rates."""
        xp, most = inputs.__array_namespace__(), self.limits["wheel_rate"][None]
        radius, half = self.wheel_radius[None], self.base[None] / 2
        left, right = ((inputs[0] + side * half * inputs[1]) / radius for side in (-1.0, 1.0))
        fast = xp.maximum(abs(left), abs(right)) > most
        left, right = (radius * xp.clip(each, -most, most) for each in (left, right))
        clipped = xp.stack([(left + right) / 2, (right - left) / (2 * half)])
        return xp.where(fast[None], clipped, inputs)
