"""Constants that do not belong together."""

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack, unit_vectors
from jaxnet.kinds.fields import Angle


class Spoof(Attack):
    """A constant offset along each vehicle's direction in each of the `orders`, so a path with derivatives
    that are not its own.

    With all orders it drives the fleet as far as any disturbance of this size: it attains the peak gain where
    ‖h‖₁ = 1/k0 (SCIENCE O5).
    """

    kind = "spoof"
    derived: ClassVar[bool] = False

    direction: Angle = Field(default=0.0, description="[rad], of the offset")

    def fastest(self) -> float:
        """A constant's."""
        return 0.0

    def basis(self, time: Any) -> Any:
        """One function, 1 in every order."""
        xp = time.__array_namespace__()
        return xp.ones((4, 1, *time.shape))

    def vectors(self) -> np.ndarray:
        """The direction."""
        return unit_vectors(self.direction)[:, :, None]

    def sizes(self, horizon: float) -> np.ndarray:
        """1 in every order."""
        return np.ones((4, 1))
