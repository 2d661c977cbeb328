"""The navigator's path `y_0(t)` with its derivatives.

Written against the array API standard, so that a config is checked in NumPy and simulated in JAX by the
same formula.
"""

from typing import Any, NamedTuple

import numpy as np

from jaxnet.model.circle import circle


class Lissajous(NamedTuple):
    """`y_0 = amplitude * sin(frequency * t + phase)`, axis by axis; arrays (2, …) in [m, rad/s, rad]."""

    amplitude: Any
    frequency: Any
    phase: Any

    def jets(self, t: Any) -> tuple[Any, Any, Any, Any]:
        """Position and its first three derivatives, each (2, …) for times t [s] of shape (…)."""
        return self.at(*self.angle(t))

    def angle(self, t: Any) -> tuple[Any, Any]:
        """Cosine and sine of `frequency * t + phase`."""
        _, frequency, phase = self._for(t.ndim)
        return circle(frequency * t[None] + phase)

    def at(self, cosine: Any, sine: Any) -> tuple[Any, Any, Any, Any]:
        """Jets where the angle's cosine and sine are known."""
        amplitude, w, _ = self._for(cosine.ndim - 1)
        now, ahead = amplitude * sine, w * amplitude * cosine
        return now, ahead, -(w**2) * now, -(w**2) * ahead

    def _for(self, dimensions: int) -> tuple[Any, Any, Any]:
        """The numbers, with room for as many dimensions of times."""
        amplitude, frequency, phase = (
            each.reshape(2, *[1] * (dimensions + 1 - each.ndim), *each.shape[1:]) for each in self
        )
        return amplitude, frequency, phase

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
            square, slope = (jets[1] ** 2).sum(axis=0), 2 * (jets[1] * jets[2]).sum(axis=0)
            lowest = int(square.argmin())
            if square[lowest] < best**2:
                best, when = float(np.sqrt(square[lowest])), float(middle[lowest])
            within = square - np.abs(slope) * half - curvature * half**2 / 2
            middle = middle[within < max(0.0, best - 1e-4 * greatest[0]) ** 2]
            half /= 2
            middle = np.concatenate([middle - half, middle + half])
        return best, when
