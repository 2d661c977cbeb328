"""The sinusoidal attack: an oscillation along a line."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack, harmonic_sizes, unit_vectors
from jaxnet.kinds.fields import FULL_TURN, Angle, PerVehicle, value_range
from jaxnet.model.signal import Harmonic


class Sinusoid(Attack):
    """An oscillation `sin(frequency · t + phase)` along a direction of each vehicle."""

    kind = "sinusoid"
    highest: ClassVar[int] = 4

    direction: Angle = Field(default=0.0, description="[rad], along which it acts")
    frequency: PerVehicle = Field(default=0.7, description="[rad/s], of the oscillation")
    phase: Angle = Field(default=FULL_TURN, description="[rad], at t = 0")

    def fastest(self):
        return max(map(abs, value_range(self.frequency)))

    def signal(self):
        return Harmonic(self.frequency)

    def vectors(self):
        unit, phase = unit_vectors(self.direction), np.asarray(self.phase)
        return np.stack([np.sin(phase) * unit, np.cos(phase) * unit], axis=2)

    def sizes(self, horizon):
        return harmonic_sizes(self.frequency)  # pyright: ignore[reportArgumentType]
