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
        """Position and its first three derivatives at time t [s]: (..., 4, 2) for t of shape (...)."""
        xp = t.__array_namespace__()
        angle = self.frequency * t[..., None] + self.phase
        sine, cosine = self.amplitude * xp.sin(angle), self.amplitude * xp.cos(angle)
        w = self.frequency
        return xp.stack([sine, w * cosine, -(w**2) * sine, -(w**3) * cosine], axis=-2)

    def slowest(self, horizon: float) -> tuple[float, float]:
        """Least speed [m/s] within [0, horizon], to 1e-4 of the greatest, and when [s].

        Branch and bound: speed changes no faster than the greatest acceleration, so an interval whose
        middle is fast enough cannot hide a slower moment.
        """
        steepest = float(np.hypot(*(self.amplitude * self.frequency**2)))
        tolerance = 1e-4 * float(np.hypot(*(self.amplitude * self.frequency)))
        half = horizon / 2
        middle = np.array([half])
        best, when = np.inf, 0.0
        while middle.size and half > 0:
            speed = np.linalg.norm(self.jets(middle)[:, 1], axis=-1)
            lowest = int(speed.argmin())
            if speed[lowest] < best:
                best, when = float(speed[lowest]), float(middle[lowest])
            middle = middle[speed - steepest * half < best - tolerance]
            half /= 2
            middle = np.concatenate([middle - half, middle + half])
        return best, when
