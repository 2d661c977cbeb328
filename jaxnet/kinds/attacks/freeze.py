from typing import Any

from jaxnet.kinds.attacks import PathInstead
from jaxnet.kinds.attacks.own_path import path_about
from jaxnet.kinds.navigators import sizes_up_to


class Freeze(PathInstead):
    """Denial of service: listeners hold the position of the source at t = 0, at rest."""

    def told(self, navigator, start):
        return path_about(navigator, start, harmonic=None)

    def reach(self, navigator, signal: Any, horizon):
        return signal.sizes(sizes_up_to(self.told_order, navigator, 0.0, horizon))
