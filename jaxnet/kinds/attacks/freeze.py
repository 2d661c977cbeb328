"""The freeze: denial of service, where the last word heard is stepwise."""

from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack, constant_basis
from jaxnet.kinds.fields import NotNegative
from jaxnet.model.plane import length


class Freeze(Attack):
    """An attacked link carries for good where its source was at t = 0, at rest."""

    kind = "freeze"
    bounded: ClassVar[bool] = False

    magnitude: NotNegative = Field(
        default=5.0, description="[m], what recovery is judged by; nothing is scaled to it"
    )
    threat: Literal["replaces"] = Field(  # pyright: ignore[reportIncompatibleVariableOverride]
        default="replaces", description="what is sent is replaced"
    )

    def told(self, navigator: Any, start: np.ndarray) -> tuple[Any, np.ndarray | None]:
        """`y_j(0) - y_0(t)`: a constant, and the navigator's two coordinates.

        The constant is as great as any `y_j(0)`, so that no vector is much longer than another.
        """
        far = np.maximum(1.0, length(start).max(axis=0))
        axes = np.broadcast_to(-np.eye(2)[:, None, :, None], (*start.shape[:2], 2, start.shape[2]))
        return FixedPosition(navigator, far), np.concatenate([(start / far)[:, :, None], axes], axis=2)

    def reach(self, navigator: Any, signal: Any, horizon: float) -> np.ndarray:
        """The constant and the navigator's path."""
        return navigator.sizes(0.0, horizon)[:, None] + np.eye(4, 1) * signal.far


class FixedPosition(NamedTuple):
    """A constant, and where the navigator is."""

    navigator: Any
    far: Any  # (lanes,) [m]

    def basis(self, time: Any) -> Any:
        """Three functions."""
        xp = time.__array_namespace__()
        return xp.concatenate(
            [self.far[None, None] * constant_basis(time), self.navigator.jets(time)], axis=1
        )
