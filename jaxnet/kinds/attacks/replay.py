from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack
from jaxnet.kinds.fields import NotNegative, PositivePerVehicle
from jaxnet.kinds.navigators import sizes_up_to
from jaxnet.kinds.protocols import NavigatorPath
from jaxnet.kinds.shapes import AnyTimes, SignalBasis


class ReplayAttack(Attack):
    """An attacked link carries the navigator's path of `delay` seconds ago, in place of its
    source's message.

    Before t = delay the link carries the path as it would have been before t = 0.
    """

    kind = "replay"
    highest = 4
    bounded = False

    magnitude: NotNegative = Field(
        default=5.0, description="[m], what recovery is judged by; the path is not scaled to it"
    )
    threat: Literal["replaces"] = Field(  # pyright: ignore[reportIncompatibleVariableOverride]
        default="replaces", description="what is sent is replaced"
    )
    delay: PositivePerVehicle = Field(default=5.0, description="[s], how old the path is")

    def told(self, navigator, start):
        return DelayedPath(navigator, self.delay), np.eye(2)[:, None, :, None]

    def reach(self, navigator, signal: Any, horizon):
        """Twice the sizes of the path, a bound on the difference of two of its positions."""
        return (
            2
            * sizes_up_to(self.told_order, navigator, -float(np.max(signal.delay)), horizon)[
                :, None
            ]
        )


class DelayedPath(NamedTuple):
    """The delayed path relative to the present path."""

    navigator: NavigatorPath
    delay: Any  # (lanes,) [s]

    def basis(self, time: AnyTimes) -> SignalBasis:
        """`y_0(t - T) - y_0(t)` for each axis."""
        return self.navigator.jets(time - self.delay) - self.navigator.jets(time)
