"""The rotating attack, the paper's."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack, harmonic_sizes, unit_vectors
from jaxnet.kinds.fields import FULL_TURN, Angle, PerVehicle, value_range
from jaxnet.kinds.shapes import AnyNumbers
from jaxnet.model.signal import Harmonic


class Rotating(Attack):
    """A unit vector that turns, `[cos, sin](frequency · t + phase)`."""

    kind = "rotating"
    highest: ClassVar[int] = 4

    frequency: PerVehicle = Field(default=0.7, description="[rad/s], of the turning")
    phase: Angle = Field(default=FULL_TURN, description="[rad], at t = 0")

    def fastest(self):
        return max(map(abs, value_range(self.frequency)))

    def signal(self):
        return Harmonic(self.frequency)

    def vectors(self):
        """`[cos φ, sin φ]` for cos ωt and `[-sin φ, cos φ]` for sin ωt."""
        return turned(self.phase)

    def sizes(self, horizon):
        return harmonic_sizes(self.frequency)  # pyright: ignore[reportArgumentType]


def turned(phase: AnyNumbers) -> np.ndarray:
    """Vectors (2, m, 2, lanes) that turn cos and sin of an angle to the angle plus a phase [rad]."""
    cosine, sine = unit_vectors(phase)
    return np.stack([np.stack([cosine, sine]), np.stack([-sine, cosine])], axis=2)
