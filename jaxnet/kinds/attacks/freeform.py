import numpy as np

from jaxnet.kinds.attacks import Harmonics
from jaxnet.kinds.fields import Several, Uniform, setting


class Freeform(Harmonics):
    """`Σ_l c_l cos(l · frequency · t) + s_l sin(l · frequency · t)` with vectors c and s, scaled to
    ā.

    Each attacker has vectors of its own.
    """

    numbers = (("coefficients", 4),)

    coefficients: Several = setting(
        Uniform(uniform=[-1.0, 1.0]),
        "by attacker and harmonic: x and y of its cosine, then of its sine; of any size",
    )

    def pairs(self):
        given = np.asarray(self.coefficients)  # (4 · harmonics, m, lanes)
        return given.reshape(-1, 2, *given.shape[1:]).transpose(1, 2, 0, 3)
