"""The multisine: harmonics of one frequency with random phases and directions."""

from typing import Any

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack, along
from jaxnet.kinds.fields import FULL_TURN, Number, PositivePerVehicle
from jaxnet.model.signal import Harmonic

FINENESS = 32  # instants of a grid in a period of the highest harmonic


class Multisine(Attack):
    """`Σ_l u(direction_l) cos(l · frequency · t + phase_l)`, l = 1 … harmonics, as great as ā allows.

    Each attacker has phases and directions of its own. The sum is divided by the greatest of its norm and of
    its derivatives' on a grid, over cos(Ωδ/2) for the highest frequency Ω and the grid's step δ, under which
    a trigonometric polynomial stays between the grid's points (Ehlich and Zeller, 1964).
    """

    kind = "multisine"

    frequency: PositivePerVehicle = Field(default=0.35, description="[rad/s], the lowest")
    harmonics: int = Field(default=4, ge=1, le=100, description="how many")
    phase: Number = Field(default=FULL_TURN, description="[rad], of each harmonic of each attacker")
    direction: Number = Field(default=FULL_TURN, description="[rad], likewise")

    def drawn(self, draw: Any, name: str) -> Any:
        """Phases and directions are drawn for each vehicle and harmonic: (harmonics, m, lanes)."""
        values = dict(vars(super().drawn(draw, name)))
        for key in ("phase", "direction"):
            values[key] = draw.each(getattr(self, key), f"{name}.{key}", self.harmonics).T
        return self.filled(values)

    def basis(self, time: Any) -> Any:
        """Cosines, then sines."""
        xp = time.__array_namespace__()
        each = [Harmonic(order * self.frequency).basis(time) for order in range(1, self.harmonics + 1)]
        return xp.concatenate(each, axis=1)

    def vectors(self) -> np.ndarray:
        """Of cosine and sine of each harmonic, in their order."""
        unit, phase = along(np.asarray(self.direction)), np.asarray(self.phase)
        pairs = np.stack([unit * np.cos(phase), -unit * np.sin(phase)], axis=2)  # (2, n, 2, m, lanes)
        pairs = np.moveaxis(pairs.reshape(2, -1, *pairs.shape[3:]), 1, 2)
        return pairs / self.greatest(pairs)

    def greatest(self, vectors: np.ndarray) -> np.ndarray:
        """What signals of vectors (2, m, B, lanes) and their derivatives do not exceed, (m, 1, lanes)."""
        period, count = 2 * np.pi / np.asarray(self.frequency), FINENESS * self.harmonics
        found = np.zeros((vectors.shape[1], vectors.shape[3]))
        for instant in np.arange(count) / count:
            for order in self.basis(instant * period):
                moved = (vectors * order).sum(axis=2)
                found = np.maximum(found, np.hypot(*moved))
        return found[:, None] / np.cos(np.pi / FINENESS)

    def sizes(self, horizon: float) -> np.ndarray:
        """1, for the vectors are divided by what is greatest."""
        return np.ones((4, 1))
