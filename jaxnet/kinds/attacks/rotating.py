"""The rotating attack."""

from typing import Any

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack, harmonic_sizes, unit_vectors
from jaxnet.kinds.fields import FULL_TURN, Angle, PerVehicle, value_range
from jaxnet.model.signal import Harmonic


class Rotating(Attack):
    """`[cos, sin](frequency · t + phase)`."""

    kind = "rotating"

    frequency: PerVehicle = Field(default=0.7, description="[rad/s], of the turning")
    phase: Angle = Field(default=FULL_TURN, description="[rad], at t = 0")

    def fastest(self) -> float:
        """Its frequency, the greatest that may be drawn."""
        return max(map(abs, value_range(self.frequency)))

    def signal(self) -> Any:
        """Its harmonic."""
        return Harmonic(self.frequency)

    def vectors(self) -> np.ndarray:
        """`[cos φ, sin φ]` times cos ωt, and the same a quarter turn on times sin ωt."""
        return turned(self.phase)

    def sizes(self, horizon: float) -> np.ndarray:
        """`|ω|^k`."""
        return harmonic_sizes(self.frequency)  # pyright: ignore[reportArgumentType]


def turned(phase: Any) -> np.ndarray:
    """Vectors (2, m, 2, lanes) with which cos and sin of an angle turn to that angle plus the phase."""
    cosine, sine = unit_vectors(phase)
    return np.stack([np.stack([cosine, sine]), np.stack([-sine, cosine])], axis=2)
