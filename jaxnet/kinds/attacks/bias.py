import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack, unit_vectors
from jaxnet.kinds.fields import Angle
from jaxnet.kinds.protocols import Signal
from jaxnet.model.signal import Harmonic


class Bias(Attack):
    """A constant offset along a direction of each vehicle."""

    kind = "bias"
    highest = 4
    constant = True

    direction: Angle = Field(default=0.0, description="[rad], along which it acts")

    def signal(self) -> Signal:
        return Harmonic(0.0)

    def vectors(self):
        unit = unit_vectors(self.direction)
        return np.stack([unit, np.zeros_like(unit)], axis=2)  # of cos 0 and of sin 0

    def sizes(self, horizon):
        return np.eye(5, 1)
