"""The freeze: denial of service, where the last word heard is stepwise."""

from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack, stepwise
from jaxnet.kinds.fields import NotNegative


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
        """`y_j(0) - y_0(t)`: a constant, and the navigator's two coordinates."""
        axes = np.broadcast_to(-np.eye(2)[:, None, :, None], (*start.shape[:2], 2, start.shape[2]))
        return Fixed(navigator), np.concatenate([start[:, :, None], axes], axis=2)


class Fixed(NamedTuple):
    """1, and where the navigator is."""

    navigator: Any

    def basis(self, time: Any) -> Any:
        """Three functions."""
        xp = time.__array_namespace__()
        return xp.concatenate([stepwise(time), self.navigator.jets(time)], axis=1)
