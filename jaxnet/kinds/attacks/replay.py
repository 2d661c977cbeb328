from typing import Any, NamedTuple

import numpy as np

from jaxnet.kinds.attacks import PathInstead
from jaxnet.kinds.fields import PositivePerVehicle, setting
from jaxnet.kinds.navigators import sizes_up_to
from jaxnet.kinds.protocols import NavigatorPath
from jaxnet.kinds.shapes import AnyTimes, SignalBasis


class ReplayAttack(PathInstead):
    """An attacked link carries the navigator's path of `delay` seconds ago, in place of its
    source's message.

    Before t = delay the link carries the path as it would have been before t = 0.
    """

    delay: PositivePerVehicle = setting(5.0, "[s], how old the path is")

    def told(self, navigator, start):
        return DelayedPath(navigator, self.delay), np.eye(2)[:, None, :, None]

    def reach(self, navigator, signal: Any, horizon):
        """Twice the sizes of the path, a bound on the difference of two of its positions."""
        earliest = -float(np.max(signal.delay))
        return 2 * sizes_up_to(self.told_order, navigator, earliest, horizon)[:, None]


class DelayedPath(NamedTuple):
    """The delayed path relative to the present path."""

    navigator: NavigatorPath
    delay: Any  # (lanes,) [s]

    def basis(self, time: AnyTimes) -> SignalBasis:
        """`y_0(t - T) - y_0(t)` for each axis."""
        return self.navigator.jets(time - self.delay) - self.navigator.jets(time)
