"""Attacks that are sums of harmonics of one frequency, with a certified bound on the sum."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack
from jaxnet.kinds.fields import PositivePerVehicle, Table, value_range
from jaxnet.kinds.kind import Fault, KindError
from jaxnet.model.signal import Harmonic

FINENESS = 32  # points of the grid in a period of the highest harmonic
SIGNALS = 1_024  # signals in one batch of Fourier transforms


class Harmonics(Attack):
    """A trigonometric polynomial for each attacker, scaled to the greatest size that ā allows.

    The polynomial is divided by its greatest norm, and its derivatives' norms, on a grid. Between
    the grid's points a trigonometric polynomial is at most 1/cos(Ωδ/2) times greater, with the
    highest frequency Ω and the grid's step δ (Ehlich and Zeller, 1964). The divisor contains this
    factor.
    """

    highest = 4
    numbers: ClassVar[tuple[tuple[str, int], ...]] = ()  # of each harmonic, by key

    frequency: PositivePerVehicle = Field(default=0.35, description="[rad/s], the lowest")
    harmonics: int = Field(default=4, ge=1, le=100, description="how many")

    def pairs(self) -> np.ndarray:
        """Vectors of cosine and sine of harmonics, of any size: (2, m, 2 · harmonics, lanes)."""
        raise KindError(f"{self.kind}: a sum of harmonics gives pairs(self)")

    def drawn(self, draw, name):
        """The attack with `numbers[key]` numbers of each harmonic in a key: (numbers, m, lanes)."""
        others = self.model_copy(update=dict.fromkeys(dict(self.numbers)))
        values = dict(vars(super(Harmonics, others).drawn(draw, name)))
        for key, number in self.numbers:
            values[key] = draw.each(getattr(self, key), f"{name}.{key}", number * self.harmonics).T
        return self.filled(values)

    def faults(self, scenario):
        yield from super().faults(scenario)
        vehicles = len(self.targets())
        for key, number in self.numbers:
            table, wanted = getattr(self, key), number * self.harmonics
            rows = table.root if isinstance(table, Table) else None
            if rows and (len(rows) != vehicles or any(len(row) != wanted for row in rows)):
                each = f"{vehicles} lists, one for each of attack.vehicles"
                yield Fault((f"attack.{key}", "attack"), f"must be {each}, of {wanted} numbers")

    def fastest(self):
        return self.harmonics * value_range(self.frequency)[1]

    def basis(self, time):
        xp = time.__array_namespace__()
        each = [
            Harmonic(order * self.frequency).basis(time) for order in range(1, self.harmonics + 1)
        ]
        return xp.concatenate(each, axis=1)

    def vectors(self):
        """Vectors of cosine and sine of each harmonic, of size 1 together; 0 without attack."""
        pairs = self.pairs()
        greatest = self.greatest(pairs)
        return pairs / np.where(greatest > 0, greatest, 1.0)

    def greatest(self, vectors: np.ndarray) -> np.ndarray:
        """A bound on the norms of signals and the heard derivatives, (m, 1, lanes), for vectors (2,
        m, B, lanes).

        A signal is `Re Σ_l z_l e^{ilθ}`, its k-th derivative has `(ilω)^k z_l`. A Fourier transform
        evaluates them on the grid.
        """
        m, lanes = vectors.shape[1], vectors.shape[3]
        rate = np.broadcast_to(self.frequency, (m, lanes)).ravel()
        each = vectors.transpose(1, 3, 0, 2).reshape(m * lanes, 2, -1)
        scale, found = np.abs(each).max(axis=(1, 2)), np.zeros(m * lanes)
        attacked = np.flatnonzero(scale)
        for start in range(0, len(attacked), SIGNALS):
            some = attacked[start : start + SIGNALS]
            unit = each[some] / scale[some, None, None]
            norms = [
                rate[some] ** order * self.peak(unit, order) for order in range(self.told_order + 1)
            ]
            found[some] = scale[some] * np.maximum.reduce(norms)
        return found.reshape(m, 1, lanes) / np.cos(np.pi / FINENESS)

    def peak(self, vectors: np.ndarray, order: int) -> np.ndarray:
        """Greatest norm on the grid of a derivative by the angle, for vectors (signals, 2, B)."""
        count, number = FINENESS * self.harmonics, np.arange(1, self.harmonics + 1)
        spectrum = (
            (vectors[..., ::2] - 1j * vectors[..., 1::2]) * (1j * number) ** order * (count / 2)
        )
        x, y = np.moveaxis(np.fft.irfft(np.insert(spectrum, 0, 0.0, axis=-1), count), 1, 0)
        return np.sqrt((x**2 + y**2).max(axis=-1))

    def sizes(self, horizon):
        return np.ones((self.told_order + 1, 1))
