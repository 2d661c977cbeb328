import functools

import numpy as np

from jaxnet.kinds.fields import Amplitude, Frequency, Vector, setting
from jaxnet.kinds.navigators import Navigator
from jaxnet.model.circle import circle


class Lissajous(Navigator):
    """A Lissajous figure, `amplitude · sin(frequency · t + phase)` on each axis."""

    words = "Lissajous curve"

    amplitude: Amplitude = setting([100.0, 50.0], "[m], of each axis")
    frequency: Frequency = setting([0.2, 0.4], "[rad/s], of each axis")
    phase: Vector = setting([0.0, 0.0], "[rad], of each axis")

    def jets(self, time):
        xp = time.__array_namespace__()
        numbers = (xp.asarray(each) for each in (self.amplitude, self.frequency, self.phase))
        amplitude, w, phase = (
            each.reshape(2, *[1] * (time.ndim + 1 - each.ndim), *each.shape[1:]) for each in numbers
        )
        cosine, sine = circle(w * time[None] + phase)
        now, ahead = amplitude * sine, w * amplitude * cosine
        return xp.stack([now, ahead, -(w**2) * now, -(w**2) * ahead])

    def slowest(self, horizon):
        """The least speed [m/s] in [0, horizon], to 1e-4 of the greatest, and its time [s]."""
        return slowest_instant(*map(tuple, (self.amplitude, self.frequency, self.phase)), horizon)

    def sizes(self, start, end):
        amplitude, frequency = np.asarray(self.amplitude), np.asarray(self.frequency)
        return np.stack([np.linalg.norm(amplitude * frequency**k, axis=0) for k in range(4)])


AxisPair = tuple[float, float]


@functools.lru_cache  # the cells of a study mostly share one navigator
def slowest_instant(
    amplitude: AxisPair, frequency: AxisPair, phase: AxisPair, horizon: float
) -> tuple[float, float]:
    """The least speed [m/s] of a Lissajous figure in [0, horizon], and its time [s].

    Branch and bound on v²: the slope in an interval's middle and a bound on the second derivative
    limit how far v² falls. An interval whose limit is above the least speed found is dropped.
    """
    path = Lissajous(amplitude=list(amplitude), frequency=list(frequency), phase=list(phase))
    greatest = path.sizes(0.0, horizon)[1:].tolist()
    curvature = 2 * (greatest[1] ** 2 + greatest[0] * greatest[2])
    half, middle = horizon / 2, np.array([horizon / 2])
    best, when = np.inf, 0.0
    while middle.size:
        jets = path.jets(middle)
        square, slope = (jets[1] ** 2).sum(axis=0), 2 * (jets[1] * jets[2]).sum(axis=0)
        lowest = int(square.argmin())
        if square[lowest] < best**2:
            best, when = float(np.sqrt(square[lowest])), float(middle[lowest])
        within = square - np.abs(slope) * half - curvature * half**2 / 2
        middle = middle[within < max(0.0, best - 1e-4 * greatest[0]) ** 2]
        half /= 2
        middle = np.concatenate([middle - half, middle + half])
    return best, when
