"""The freeze: denial of service, after which listeners hold the first position received."""

from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack, constant_basis
from jaxnet.kinds.fields import NotNegative
from jaxnet.kinds.navigators import sizes_up_to
from jaxnet.kinds.protocols import NavigatorPath
from jaxnet.kinds.shapes import AnyTimes, SignalBasis
from jaxnet.model.plane import length


class Freeze(Attack):
    """An attacked link carries the position of its source at t = 0, at rest, for the whole lane."""

    kind = "freeze"
    highest = 4
    bounded = False

    magnitude: NotNegative = Field(
        default=5.0, description="[m], what recovery is judged by; nothing is scaled to it"
    )
    threat: Literal["replaces"] = Field(  # pyright: ignore[reportIncompatibleVariableOverride]
        default="replaces", description="what is sent is replaced"
    )

    def told(self, navigator, start):
        """Signal and vectors of `y_j(0) - y_0(t)`: a constant, and the navigator's two coordinates.

        The constant is as great as the greatest `y_j(0)`, so that the vectors have similar lengths.
        """
        far = np.maximum(1.0, length(start).max(axis=0))
        axes = np.broadcast_to(-np.eye(2)[:, None, :, None], (*start.shape[:2], 2, start.shape[2]))
        return FixedPosition(navigator, far), np.concatenate(
            [(start / far)[:, :, None], axes], axis=2
        )

    def reach(self, navigator, signal: Any, horizon):
        """The sizes of the constant plus the sizes of the navigator's path."""
        path = sizes_up_to(self.told_order, navigator, 0.0, horizon)
        return path[:, None] + np.eye(len(path), 1) * signal.far


class FixedPosition(NamedTuple):
    """A constant function, and the two coordinates of the navigator."""

    navigator: NavigatorPath
    far: Any  # (lanes,) [m]

    def basis(self, time: AnyTimes) -> SignalBasis:
        """Three functions: the constant and the navigator's two coordinates."""
        xp = time.__array_namespace__()
        return xp.concatenate(
            [self.far[None, None] * constant_basis(time), self.navigator.jets(time)], axis=1
        )
