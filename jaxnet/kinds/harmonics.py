"""Sums of harmonics of one frequency, whose size is certified: what some attacks are made of."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack
from jaxnet.kinds.fields import PositivePerVehicle, Table
from jaxnet.kinds.kind import Fault, KindError
from jaxnet.model.signal import Harmonic

FINENESS = 32  # instants of a grid in a period of the highest harmonic


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
