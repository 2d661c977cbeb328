import numpy as np

from jaxnet.kinds.attacks import Harmonious, unit_vectors
from jaxnet.kinds.fields import FULL_TURN, Angle, PerVehicle, setting
from jaxnet.kinds.shapes import AnyNumbers


class Rotating(Harmonious):
    """The default: a unit vector that turns, `[cos, sin](frequency · t + phase)`.

    The paper leaves the signal open.
    """

    frequency: PerVehicle = setting(0.7, "[rad/s], of the turning")
    phase: Angle = setting(FULL_TURN, "[rad], at t = 0")

    def vectors(self):
        return turned(self.phase)


def turned(phase: AnyNumbers) -> np.ndarray:
    """Vectors (2, m, 2, lanes) that turn cos and sin of an angle to the angle plus a phase [rad].

    They are `[cos φ, sin φ]` for cos ωt and `[-sin φ, cos φ]` for sin ωt.
    """
    cosine, sine = unit_vectors(phase)
    return np.stack([np.stack([cosine, sine]), np.stack([-sine, cosine])], axis=2)
