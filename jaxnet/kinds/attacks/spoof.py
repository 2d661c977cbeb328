import numpy as np

from jaxnet.kinds.attacks import Attack, unit_vectors
from jaxnet.kinds.fields import Angle, setting


class Spoof(Attack):
    """A constant offset along a direction of each vehicle in each of the `orders`.

    The received derivatives are then not those of the received path. With all orders no other
    disturbance of this size drives the fleet farther: the attack attains the peak gain where ‖H‖₁ =
    1/k0 (theorems.md O5).
    """

    highest = 4
    derived = False

    direction: Angle = setting(0.0, "[rad], of the offset")

    def fastest(self):
        return 0.0

    def basis(self, time):
        return time.__array_namespace__().ones((5, 1, *time.shape))

    def vectors(self):
        return unit_vectors(self.direction)[:, :, None]

    def sizes(self, horizon):
        return np.ones((5, 1))
