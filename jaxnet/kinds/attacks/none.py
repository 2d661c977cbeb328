import numpy as np
from pydantic import ConfigDict

from jaxnet.kinds.announcements.consistent import Consistent
from jaxnet.kinds.attacks import AnyAttack
from jaxnet.model.signal import ORDERS, Harmonic


class NoAttack(AnyAttack):
    """No vehicle is attacked."""

    model_config = ConfigDict(ignored_types=(object,))  # class attributes are no keys
    magnitude, vehicles, links, threat, moves = 0.0, [], "auto", "adds", "by_law"
    orders, listeners, sybils, announces = ORDERS, "same", 0, Consistent()

    def fastest(self):
        return 0.0

    def signal(self):
        return Harmonic(0.0)

    def vectors(self):
        return np.zeros((2, 1, 2, 1))

    def sizes(self, horizon):
        return np.ones((5, 1))
