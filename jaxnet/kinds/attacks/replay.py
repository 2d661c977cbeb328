"""The replay: the navigator's path of some time ago."""

from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack
from jaxnet.kinds.fields import NotNegative, PositivePerVehicle


class ReplayAttack(Attack):
    """An attacked link carries the navigator's path of `delay` seconds ago, in place of its source's word.

    Before t = delay it carries the path as it would have been before t = 0.
    """

    kind = "replay"
    bounded: ClassVar[bool] = False

    magnitude: NotNegative = Field(
        default=5.0, description="[m], what recovery is judged by; the path is not scaled to it"
    )
    threat: Literal["replaces"] = Field(  # pyright: ignore[reportIncompatibleVariableOverride]
        default="replaces", description="what is sent is replaced"
    )
    delay: PositivePerVehicle = Field(default=5.0, description="[s], how old the path is")

    def told(self, navigator: Any, start: np.ndarray) -> tuple[Any, np.ndarray | None]:
        """One function for each axis."""
        return DelayedPath(navigator, self.delay), np.eye(2)[:, None, :, None]

    def reach(self, navigator: Any, signal: Any, horizon: float) -> np.ndarray:
        """The difference of two positions of the path."""
        return 2 * navigator.sizes(-float(np.max(signal.delay)), horizon)[:, None]


class DelayedPath(NamedTuple):
    """A path of some time ago, relative to where it is now."""

    navigator: Any
    delay: Any  # (lanes,) [s]

    def basis(self, time: Any) -> Any:
        """`y_0(t - T) - y_0(t)` by axis."""
        return self.navigator.jets(time - self.delay) - self.navigator.jets(time)
