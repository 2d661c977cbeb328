"""The sinusoidal attack."""

from typing import Any

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack, harmonic_sizes, unit_vectors
from jaxnet.kinds.fields import FULL_TURN, Angle, PerVehicle, value_range
from jaxnet.model.signal import Harmonic


class Sinusoid(Attack):
    """`sin(frequency · t + phase)` along each vehicle's direction."""

    kind = "sinusoid"

    direction: Angle = Field(default=0.0, description="[rad], along which it acts")
    frequency: PerVehicle = Field(default=0.7, description="[rad/s], of the oscillation")
    phase: Angle = Field(default=FULL_TURN, description="[rad], at t = 0")

    def fastest(self) -> float:
        """Its frequency, the greatest that may be drawn."""
        return max(map(abs, value_range(self.frequency)))

    def signal(self) -> Any:
        """Its harmonic."""
        return Harmonic(self.frequency)

    def vectors(self) -> np.ndarray:
        """The direction times sin φ and cos φ."""
        unit, phase = unit_vectors(self.direction), np.asarray(self.phase)
        return np.stack([np.sin(phase) * unit, np.cos(phase) * unit], axis=2)

    def sizes(self, horizon: float) -> np.ndarray:
        """`|ω|^k`."""
        return harmonic_sizes(self.frequency)  # pyright: ignore[reportArgumentType]
