"""The navigator's path `y_0(t)` with its derivatives.

Written against the array API standard, so that a config is checked in NumPy and simulated in JAX by the
same formula.
"""

from typing import Any, NamedTuple

import numpy as np


class Lissajous(NamedTuple):
    """`y_0 = amplitude * sin(frequency * t + phase)`, axis by axis; three arrays (2,) in [m, rad/s, rad]."""

    amplitude: Any
    frequency: Any
    phase: Any

    def jets(self, t: Any) -> Any:
        """Position and its first three derivatives at time t [s]: (4, 2), or (times, 4, 2) of NumPy's t."""
        xp = t.__array_namespace__()
        angle = self.frequency * t[..., None] + self.phase
        sine, cosine = self.amplitude * xp.sin(angle), self.amplitude * xp.cos(angle)
        w = self.frequency
        return xp.stack([sine, w * cosine, -(w**2) * sine, -(w**3) * cosine], axis=-2)

    def slowest(self, horizon: float) -> tuple[float, float]:
        """Least speed [m/s] within [0, horizon], to 1e-4 of the greatest it could have, and when [s].

        Branch and bound on v²: from an interval's middle it falls by no more than its slope and the bound
        on its second derivative allow, so an interval that stays above the least speed found is left.
        """
        greatest = [float(np.hypot(*(self.amplitude * self.frequency**k))) for k in (1, 2, 3)]
        curvature = 2 * (greatest[1] ** 2 + greatest[0] * greatest[2])
        half, middle = horizon / 2, np.array([horizon / 2])
        best, when = np.inf, 0.0
        while middle.size:
            jets = self.jets(middle)
            square, slope = (jets[:, 1] ** 2).sum(axis=1), 2 * (jets[:, 1] * jets[:, 2]).sum(axis=1)
            lowest = int(square.argmin())
            if square[lowest] < best**2:
                best, when = float(np.sqrt(square[lowest])), float(middle[lowest])
            within = square - np.abs(slope) * half - curvature * half**2 / 2
            middle = middle[within < max(0.0, best - 1e-4 * greatest[0]) ** 2]
            half /= 2
            middle = np.concatenate([middle - half, middle + half])
        return best, when
