"""Sums of harmonics of one frequency, whose size is certified: what some attacks are made of."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack
from jaxnet.kinds.fields import PositivePerVehicle, Table, value_range
from jaxnet.kinds.kind import Fault, KindError
from jaxnet.model.signal import ORDERS, Harmonic

FINENESS = 32  # instants of a grid in a period of the highest harmonic
SIGNALS = 1_024  # signals whose size is found at once


class Harmonics(Attack):
    """A trigonometric polynomial of each attacker's own, as great as ā allows.

    It is divided by the greatest of its norm and of its derivatives' on a grid, over cos(Ωδ/2) for the
    highest frequency Ω and the grid's step δ, under which a trigonometric polynomial stays between the grid's
    points (Ehlich and Zeller, 1964).
    """

    frequency: PositivePerVehicle = Field(default=0.35, description="[rad/s], the lowest")
    harmonics: int = Field(default=4, ge=1, le=100, description="how many")

    def pairs(self) -> np.ndarray:
        """Vectors of cosine and sine of each harmonic, of any size: (2, m, 2 · harmonics, lanes)."""
        raise KindError(f"{self.kind}: a sum of harmonics gives pairs(self)")

    def with_several(self, draw: Any, name: str, **numbers: int) -> Any:
        """The same drawn; of these keys so many numbers for each harmonic: (numbers, m, lanes)."""
        others = self.model_copy(update=dict.fromkeys(numbers))
        values = dict(vars(Attack.drawn(others, draw, name)))
        for key, number in numbers.items():
            values[key] = draw.each(getattr(self, key), f"{name}.{key}", number * self.harmonics).T
        return self.filled(values)

    def tables(self, scenario: Any, **numbers: int) -> Iterator[Fault]:
        """What is wrong with tables of so many numbers for each harmonic."""
        for key, number in numbers.items():
            table = getattr(self, key)
            wanted = len(self.targets()), number * self.harmonics
            if isinstance(table, Table) and {(len(table.root), len(row)) for row in table.root} != {wanted}:
                message = (
                    f"must be {wanted[0]} lists, one for each of attack.vehicles, of {wanted[1]} numbers"
                )
                yield Fault((f"attack.{key}", "attack"), message)

    def fastest(self) -> float:
        """The highest harmonic's."""
        return self.harmonics * value_range(self.frequency)[1]

    def basis(self, time: Any) -> Any:
        """Cosines, then sines."""
        xp = time.__array_namespace__()
        each = [Harmonic(order * self.frequency).basis(time) for order in range(1, self.harmonics + 1)]
        return xp.concatenate(each, axis=1)

    def vectors(self) -> np.ndarray:
        """Of cosine and sine of each harmonic, in their order; 0 of a vehicle that has none."""
        pairs = self.pairs()
        greatest = self.greatest(pairs)
        return pairs / np.where(greatest > 0, greatest, 1.0)

    def greatest(self, vectors: np.ndarray) -> np.ndarray:
        """What signals of vectors (2, m, B, lanes) and their derivatives do not exceed, (m, 1, lanes).

        Each is `Re Σ_l z_l e^{ilθ}`, its derivatives with `(ilω)^k z_l`: on the grid a Fourier transform.
        """
        m, lanes = vectors.shape[1], vectors.shape[3]
        rate = np.broadcast_to(self.frequency, (m, lanes)).ravel()
        each = vectors.transpose(1, 3, 0, 2).reshape(m * lanes, 2, -1)
        scale, found = np.abs(each).max(axis=(1, 2)), np.zeros(m * lanes)
        attacked = np.flatnonzero(scale)
        for start in range(0, len(attacked), SIGNALS):
            some = attacked[start : start + SIGNALS]
            unit = each[some] / scale[some, None, None]
            norms = [rate[some] ** order * self.peak(unit, order) for order in ORDERS]
            found[some] = scale[some] * np.maximum.reduce(norms)
        return found.reshape(m, 1, lanes) / np.cos(np.pi / FINENESS)

    def peak(self, vectors: np.ndarray, order: int) -> np.ndarray:
        """Greatest norm on the grid of a derivative to the angle, of vectors (signals, 2, B)."""
        count, number = FINENESS * self.harmonics, np.arange(1, self.harmonics + 1)
        spectrum = (vectors[..., ::2] - 1j * vectors[..., 1::2]) * (1j * number) ** order * (count / 2)
        x, y = np.moveaxis(np.fft.irfft(np.insert(spectrum, 0, 0.0, axis=-1), count), 1, 0)
        return np.sqrt((x**2 + y**2).max(axis=-1))

    def sizes(self, horizon: float) -> np.ndarray:
        """1, for the vectors are divided by what is greatest."""
        return np.ones((4, 1))
