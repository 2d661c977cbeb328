import numpy as np

from jaxnet.kinds.attacks import Harmonics, unit_vectors
from jaxnet.kinds.fields import FULL_TURN, Several, setting


class Multisine(Harmonics):
    """`Σ_l u(direction_l) cos(l · frequency · t + phase_l)`, l = 1 … harmonics, scaled to ā."""

    numbers = (("phase", 1), ("direction", 1))

    phase: Several = setting(FULL_TURN, "[rad], of each harmonic of each attacker")
    direction: Several = setting(FULL_TURN, "[rad], likewise")

    def pairs(self):
        """The vectors of cosine and sine by the addition theorem."""
        unit, phase = unit_vectors(np.asarray(self.direction)), np.asarray(self.phase)
        pairs = np.stack([unit * np.cos(phase), -unit * np.sin(phase)], axis=2)
        return np.moveaxis(pairs.reshape(2, -1, *pairs.shape[3:]), 1, 2)  # from (2, n, 2, m, lanes)
