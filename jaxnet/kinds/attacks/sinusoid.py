import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Harmonious, unit_vectors
from jaxnet.kinds.fields import FULL_TURN, Angle, PerVehicle


class Sinusoid(Harmonious):
    """An oscillation `sin(frequency · t + phase)` along a direction of each vehicle."""

    kind = "sinusoid"

    direction: Angle = Field(default=0.0, description="[rad], along which it acts")
    frequency: PerVehicle = Field(default=0.7, description="[rad/s], of the oscillation")
    phase: Angle = Field(default=FULL_TURN, description="[rad], at t = 0")

    def vectors(self):
        unit, phase = unit_vectors(self.direction), np.asarray(self.phase)
        return np.stack([np.sin(phase) * unit, np.cos(phase) * unit], axis=2)
