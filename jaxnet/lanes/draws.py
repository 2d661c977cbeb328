"""Draws for lanes: numbers of a kind for all samples at once.

A source gives uniform numbers, and the inverse CDF of each distribution transforms them.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Float, Int

from jaxnet.kinds import fields
from jaxnet.kinds.fields import is_drawn
from jaxnet.lanes.uniforms import Drawn, Entry, Source


class Draw:
    """Draws of numbers for samples, as NumPy arrays with a first axis over samples.

    `listed` holds the vehicles in the order in which the lists of a config give numbers.
    """

    def __init__(
        self, source: Source, samples: Sequence[int], vehicles: int, listed: Sequence[int] = ()
    ):
        self.source, self.samples, self.everyone = source, samples, range(1, vehicles + 1)
        self.listed = listed

    def same(self, value: Any) -> Any:
        array = np.asarray(value)
        return np.broadcast_to(array, (len(self.samples), *array.shape))

    def one(self, number: Any, name: str) -> Any:
        number = number.shared if isinstance(number, fields.Shared) else number
        return self.placed([number], name, [(0, 0)])[:, 0]

    def each(self, number: Any, name: str, components: int = 1) -> Any:
        """Numbers for each vehicle: (samples, m, components).

        A shared number is equal for all vehicles, and each vehicle has a position of its own. A
        list gives numbers to the vehicles in `listed`; other vehicles get its first entry.
        """
        shape = len(self.samples), len(self.everyone), components
        places = [(vehicle, each) for vehicle in self.everyone for each in range(components)]
        match number:
            case fields.Shared():
                return np.broadcast_to(self.one(number, name)[:, None, None], shape)
            case fields.EachPosition(root=rows) | fields.EachVehicle(root=rows):
                given = dict(zip(self.everyone, rows, strict=True))
            case fields.Listed(root=rows) | fields.Table(root=rows):
                given = dict(zip(self.listed, rows, strict=True))
            case _:
                given, rows = {}, [number.each if isinstance(number, fields.Apiece) else number]
        chosen = ((given.get(vehicle, rows[0]), component) for vehicle, component in places)
        numbers = [row[at] if isinstance(row, list | tuple) else row for row, at in chosen]
        return self.placed(numbers, name, places).reshape(shape)

    def several(self, numbers: Sequence[Any], name: str) -> Any:
        return self.placed(numbers, name, [(0, component) for component in range(len(numbers))])

    def placed(self, numbers: Sequence[Any], name: str, places: Sequence[Entry]) -> Drawn:
        found = np.empty((len(self.samples), len(numbers)))
        drawn = [column for column, number in enumerate(numbers) if is_drawn(number)]
        if drawn:
            found[:, drawn] = self.source.uniforms(
                name, self.samples, [places[column] for column in drawn]
            )
        alike: dict[int, list[int]] = {}
        for column, number in enumerate(numbers):
            alike.setdefault(id(number), []).append(column)
        for columns in alike.values():
            number = numbers[columns[0]]
            found[:, columns] = quantile(number, found[:, columns]) if is_drawn(number) else number
        return found

    def generators(self, name: str) -> Iterator[np.random.Generator]:
        """A random generator for each sample, for quantities without a fixed number of draws."""
        return (self.source.generator(name, sample) for sample in self.samples)


class EachLink(Draw):
    """Draws for each slot of each listener, in place of draws for each vehicle."""

    def __init__(self, draw: Draw, slots: int):
        super().__init__(draw.source, draw.samples, len(draw.everyone), draw.listed)
        self.slots = slots

    def each(self, number: Any, name: str, components: int = 1) -> Any:
        """Numbers for each link, sorted by listener: (samples, m · slots, components)."""
        by_vehicle = super().each(number, name, self.slots * components)
        return by_vehicle.reshape(len(by_vehicle), -1, components)


class Alone(Draw):
    """Draws for each attacked vehicle of each lane, as if it were alone in a lane of its own.

    `attacked` (n, lanes) holds the indices of the attacked vehicles, from 0. The first attacked
    vehicles of all lanes come first, then the second ones.
    """

    def __init__(self, draw: Draw, attacked: Int[np.ndarray, "n lanes"]):
        super().__init__(draw.source, [*draw.samples] * len(attacked), 1)
        self.draw, self.attacked = draw, attacked

    def one(self, number: Any, name: str) -> Any:
        """One number for each lane, or for its vehicle if vehicles differ: (n · samples,)."""
        own = fields.differs(number)
        return self.each(number, name)[:, 0, 0] if own else super().one(number, name)

    def each(self, number: Any, name: str, components: int = 1) -> Any:
        """Numbers for each attacked vehicle: (n · samples, 1, components)."""
        everybody = self.draw.each(number, name, components)
        picked = np.take_along_axis(everybody, self.attacked.T[:, :, None], axis=1)
        return picked.swapaxes(0, 1).reshape(-1, 1, components)


def quantile(number: Any, u: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """The inverse CDF of a distribution at u; raises TypeError for anything else."""
    match number:
        case fields.Uniform(uniform=[low, high]):
            return low + (high - low) * u
        case fields.Normal(normal=[mean, deviation]):
            with jax.enable_x64(True):
                return mean + deviation * np.asarray(jax.scipy.special.ndtri(u))
        case fields.DiscreteChoice(choice=values):
            return np.array(values)[(u * len(values)).astype(int)]
    raise TypeError(f"not a distribution: {number!r}")


def share_up_to(number: Any, values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The probability that a bounded distribution draws at most each of these values."""
    if isinstance(number, fields.Uniform):
        low, high = number.uniform
        spread = np.interp(values, [low, high], [0.0, 1.0])
        return spread if high > low else (values >= low).astype(float)
    return (np.array(number.choice)[:, None] <= values[None]).mean(axis=0)
