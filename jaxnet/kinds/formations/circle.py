import math

import numpy as np

from jaxnet.kinds.fields import Number, Positive, setting
from jaxnet.kinds.formations import Formation
from jaxnet.model.circle import circle


class CircleFormation(Formation):
    """Vehicles at equal angles on a circle, in the order of their numbers; the circle may turn."""

    radius: Positive = setting(..., "[m]")
    turn_rate: Number = setting(0.0, "[rad/s], above 0 to the left")
    phase: Number = setting(0.0, "[rad], the angle of vehicle 1 at t = 0")

    @property
    def moves(self):
        return self.turn_rate != 0.0

    def greatest(self, order):
        return self.radius * abs(self.turn_rate) ** order

    def jets(self, time, vehicles):
        xp = time.__array_namespace__()
        first = (self.phase + self.turn_rate * time)[None]
        apart = 2 * math.pi / vehicles * np.arange(vehicles)
        cosine, sine = circle(first + xp.asarray(apart)[:, None])
        radius, rate = self.radius[None, None], self.turn_rate[None, None]
        along, left = radius * xp.stack([cosine, sine]), radius * xp.stack([-sine, cosine])
        return xp.stack([along, rate * left, -(rate**2) * along, -(rate**3) * left])
