import numpy as np

from jaxnet.kinds.attacks import Harmonious, unit_vectors
from jaxnet.kinds.fields import FULL_TURN, Angle, PerVehicle, setting


class Sinusoid(Harmonious):
    """An oscillation `sin(frequency · t + phase)` along a direction of each vehicle."""

    direction: Angle = setting(0.0, "[rad], along which it acts")
    frequency: PerVehicle = setting(0.7, "[rad/s], of the oscillation")
    phase: Angle = setting(FULL_TURN, "[rad], at t = 0")

    def vectors(self):
        unit, phase = unit_vectors(self.direction), np.asarray(self.phase)
        return np.stack([np.sin(phase) * unit, np.cos(phase) * unit], axis=2)
