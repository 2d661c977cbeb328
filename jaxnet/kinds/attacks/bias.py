"""The constant attack."""

from typing import Any

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack, unit_vectors
from jaxnet.kinds.fields import Angle
from jaxnet.model.signal import Harmonic


class Bias(Attack):
    """A constant offset along each vehicle's direction."""

    kind = "bias"

    direction: Angle = Field(default=0.0, description="[rad], along which it acts")

    def fastest(self) -> float:
        """A constant's."""
        return 0.0

    def signal(self) -> Any:
        """A harmonic of no frequency."""
        return Harmonic(0.0)

    def vectors(self) -> np.ndarray:
        """The direction, times cos 0."""
        unit = unit_vectors(self.direction)
        return np.stack([unit, np.zeros_like(unit)], axis=2)

    def sizes(self, horizon: float) -> np.ndarray:
        """1, and no derivatives."""
        return np.eye(4, 1)
