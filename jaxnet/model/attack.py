"""What the liars add to what is heard: one smooth signal per attacked vehicle.

    a_j(t) = cosine_j cos ωt + sine_j sin ωt

holds a constant offset (ω = 0), a sinusoid along a direction and a rotating vector; `bias`, `sinusoid` and
`rotating` make it from the numbers of a config. `‖a^(k)(t)‖ ≤ ā` for k = 0..3 is certified by construction:
a signal of angular frequency ω has amplitude `ā / max(1, |ω|³)`.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

from jaxnet.model.circle import circle

Time = Float[Array, "*lanes"]
Plane = Float[Array, "2 m *lanes"]
Jets = tuple[Plane, Plane, Plane, Plane]
Number = Float[np.ndarray, "*lanes"]
Angles = Float[np.ndarray, "m *lanes"]


class Harmonic(NamedTuple):
    """A signal of one angular frequency [rad/s], its vectors [m] zero where a vehicle is not attacked."""

    frequency: Float[Array, "*lanes"]
    cosine: Float[Array, "2 m *lanes"]
    sine: Float[Array, "2 m *lanes"]

    def jets(self, t: Time) -> Jets:
        """Signal and its first three derivatives [m, m/s, m/s², m/s³]."""
        return self.at(*circle(self.frequency * t))

    def at(self, cosine: Float[Array, "*lanes"], sine: Float[Array, "*lanes"]) -> Jets:
        """Jets where `cos ωt` and `sin ωt` are known."""
        w, cosine, sine = (each[None, None] for each in (self.frequency, cosine, sine))
        now = cosine * self.cosine + sine * self.sine
        ahead = w * (cosine * self.sine - sine * self.cosine)
        return now, ahead, -(w**2) * now, -(w**2) * ahead


def bias(magnitude: Number, direction: Angles) -> Harmonic:
    """A constant offset of length `magnitude` [m] along each vehicle's direction [rad]."""
    cosine = magnitude * np.stack([np.cos(direction), np.sin(direction)])
    return _harmonic(np.zeros_like(magnitude), cosine, np.zeros_like(cosine))


def sinusoid(magnitude: Number, frequency: Number, phase: Angles, direction: Angles) -> Harmonic:
    """`amplitude · sin(ωt + φ_j)` along each vehicle's direction [rad]."""
    along = amplitude(magnitude, frequency) * np.stack([np.cos(direction), np.sin(direction)])
    return _harmonic(frequency, np.sin(phase) * along, np.cos(phase) * along)


def rotating(magnitude: Number, frequency: Number, phase: Angles) -> Harmonic:
    """`amplitude · [cos(ωt + φ_j), sin(ωt + φ_j)]`."""
    size, cosine, sine = amplitude(magnitude, frequency), np.cos(phase), np.sin(phase)
    return _harmonic(frequency, size * np.stack([cosine, sine]), size * np.stack([-sine, cosine]))


def amplitude(magnitude: Number, frequency: Number) -> Number:
    """`ā / max(1, |ω|³)`: the greatest with which no derivative exceeds ā."""
    size = magnitude / np.maximum(1.0, np.abs(frequency) ** 3)
    return np.asarray(size)  # of one lane alone NumPy makes a scalar, which is no array


def _harmonic(frequency: Number, cosine: np.ndarray, sine: np.ndarray) -> Harmonic:
    return Harmonic(frequency, cosine, sine)  # pyright: ignore[reportArgumentType]
