import numpy as np

from jaxnet.kinds.attacks import Attack, unit_vectors
from jaxnet.kinds.fields import Angle, setting
from jaxnet.model.signal import Harmonic


class Bias(Attack):
    """A constant offset along a direction of each vehicle."""

    highest = 4
    constant = True

    direction: Angle = setting(0.0, "[rad], along which it acts")

    def signal(self):
        return Harmonic(0.0)

    def vectors(self):
        unit = unit_vectors(self.direction)
        return np.stack([unit, np.zeros_like(unit)], axis=2)  # of cos 0 and of sin 0

    def sizes(self, horizon):
        return np.eye(5, 1)
