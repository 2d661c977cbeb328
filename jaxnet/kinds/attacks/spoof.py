"""The spoof: a constant in each received derivative."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack, unit_vectors
from jaxnet.kinds.fields import Angle
from jaxnet.kinds.shapes import AnyTimes, SignalBasis


class Spoof(Attack):
    """A constant offset along a direction of each vehicle in each of the `orders`.

    The received derivatives are then not those of the received path. With all orders no other disturbance of
    this size drives the fleet farther: the attack attains the peak gain where ‖h‖₁ = 1/k0 (theorems.md O5).
    """

    kind = "spoof"
    highest: ClassVar[int] = 4
    derived: ClassVar[bool] = False

    direction: Angle = Field(default=0.0, description="[rad], of the offset")

    def fastest(self) -> float:
        """Return 0, the frequency of a constant."""
        return 0.0

    def basis(self, time: AnyTimes) -> SignalBasis:
        """Return one function, which is 1 in every order."""
        xp = time.__array_namespace__()
        return xp.ones((5, 1, *time.shape))

    def vectors(self) -> np.ndarray:
        """Return the unit vectors of the directions."""
        return unit_vectors(self.direction)[:, :, None]

    def sizes(self, horizon: float) -> np.ndarray:
        """Return 1 for every order."""
        return np.ones((5, 1))
