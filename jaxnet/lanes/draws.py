"""Random numbers that belong to what they are for, and to nothing else.

One uniform number belongs to (seed, the quantity's dotted name, sample, vehicle, component): it does not
change with the number of samples, the order in which lanes run, or any other key. Every distribution is its
inverse CDF of that number, so cells that differ in anything share their draws (common random numbers).
"""

import zlib
from collections.abc import Iterator, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Float, Int, UInt32

from jaxnet.kinds import fields
from jaxnet.kinds.fields import is_drawn

COMPONENTS = 4  # of a vehicle whose slots are side by side
PAGE = 2**16  # slots from these components of all vehicles to the next ones; vehicles are at most 10,000
BLOCK = (256, 32)  # samples and slots drawn by one call, wanted or not, so that one compiled program does all

Entry = tuple[int, int]  # vehicle (0: the lane's own) and component
Draws = Float[np.ndarray, "samples places"]


class Draw:
    """Draws numbers of samples: NumPy arrays with a first axis over samples."""

    def __init__(self, seed: int, samples: Sequence[int], vehicles: int, listed: Sequence[int] = ()):
        """`listed` are the vehicles in whose order a list gives numbers."""
        self.seed, self.samples, self.everyone = seed, samples, range(1, vehicles + 1)
        self.listed = listed

    def same(self, value: Any) -> Any:
        """The same value in every lane."""
        array = np.asarray(value)
        return np.broadcast_to(array, (len(self.samples), *array.shape))

    def one(self, number: Any, name: str) -> Any:
        """A number of the lane: (samples,)."""
        number = number.shared if isinstance(number, fields.Shared) else number
        return draw(number, self.seed, name, self.samples, [0])[:, 0, 0]

    def each(self, number: Any, name: str, components: int = 1) -> Any:
        """A number of each vehicle: (samples, m, components)."""
        shape = len(self.samples), len(self.everyone), components
        match number:
            case fields.Shared():
                return np.broadcast_to(self.one(number, name)[:, None, None], shape)
            case fields.Listed(root=numbers):
                given = dict(zip(self.listed, numbers, strict=True))
                places = [
                    (vehicle, component) for vehicle in self.everyone for component in range(components)
                ]
                listed = [given.get(vehicle, numbers[0]) for vehicle, _ in places]
                return self.placed(listed, name, places).reshape(shape)
            case fields.Apiece():
                number = number.each
        return draw(number, self.seed, name, self.samples, self.everyone, components)

    def several(self, numbers: Sequence[Any], name: str) -> Any:
        """Numbers of the lane: (samples, n)."""
        return self.placed(numbers, name, [(0, component) for component in range(len(numbers))])

    def placed(self, numbers: Sequence[Any], name: str, places: Sequence["Entry"]) -> Any:
        """Numbers that have places of their own, vehicle and component: (samples, n)."""
        return draw_each(numbers, self.seed, name, self.samples, places)

    def generators(self, name: str) -> Iterator[np.random.Generator]:
        """A source of random numbers for each sample, for what no fixed number of draws can make."""
        word = zlib.crc32(name.encode())
        return (np.random.default_rng([self.seed, word, sample]) for sample in self.samples)


class EachLink(Draw):
    """Draws for each slot of each listener what is else drawn for each vehicle."""

    def __init__(self, draw: Draw, slots: int):
        super().__init__(draw.seed, draw.samples, len(draw.everyone), draw.listed)
        self.slots = slots

    def each(self, number: Any, name: str, components: int = 1) -> Any:
        """A number of each link, those of a listener after each other: (samples, m · slots, components)."""
        by_vehicle = super().each(number, name, self.slots * components)
        return by_vehicle.reshape(len(by_vehicle), -1, components)


class Alone(Draw):
    """Draws for each attacked vehicle of each lane as if it were the only one of a lane of its own.

    `attacked` (n, lanes) are their places in what is drawn for each, from 0; of all lanes the first ones
    come first.
    """

    def __init__(self, draw: Draw, attacked: Int[np.ndarray, "n lanes"]):
        super().__init__(draw.seed, [*draw.samples] * len(attacked), 1)
        self.draw, self.attacked = draw, attacked

    def one(self, number: Any, name: str) -> Any:
        """A number of the lane, or of the vehicle: (n · samples,)."""
        return self.each(number, name)[:, 0, 0] if fields.differs(number) else super().one(number, name)

    def each(self, number: Any, name: str, components: int = 1) -> Any:
        """A number of the vehicle: (n · samples, 1, components)."""
        everybody = self.draw.each(number, name, components)
        picked = np.take_along_axis(everybody, self.attacked.T[:, :, None], axis=1)
        return picked.swapaxes(0, 1).reshape(-1, 1, components)


def draw(
    number: Any,
    seed: int,
    name: str,
    samples: Sequence[int],
    vehicles: Sequence[int],
    components: int = 1,
) -> Float[np.ndarray, "samples vehicles components"]:
    """Values of a number or distribution for each sample, vehicle (0: the lane's own) and component."""
    shape = (len(samples), len(vehicles), components)
    if not is_drawn(number):
        return np.full(shape, float(number))
    places = [(vehicle, component) for vehicle in vehicles for component in range(components)]
    return quantile(number, uniforms(seed, name, samples, places)).reshape(shape)


def draw_each(
    numbers: Sequence[Any], seed: int, name: str, samples: Sequence[int], places: Sequence[Entry]
) -> Draws:
    """Values for each sample of several numbers or distributions, each with its own place."""
    if not any(map(is_drawn, numbers)):
        return np.tile(np.array(numbers, float), (len(samples), 1))
    columns = uniforms(seed, name, samples, places).T
    return np.stack([quantile(number, u) for number, u in zip(numbers, columns, strict=True)], axis=1)


def quantile(number: Any, u: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """The inverse CDF of a distribution; a number wherever it is asked."""
    match number:
        case float() | int():
            return np.full(u.shape, float(number))
        case fields.Uniform(uniform=[low, high]):
            return low + (high - low) * u
        case fields.Normal(normal=[mean, deviation]):
            with jax.enable_x64(True):
                return mean + deviation * np.asarray(jax.scipy.special.ndtri(u))
        case fields.Choice(choice=values):
            return np.array(values)[(u * len(values)).astype(int)]
    raise TypeError(f"not a number or distribution: {number!r}")


def uniforms(seed: int, name: str, samples: Sequence[int], places: Sequence[Entry]) -> Draws:
    """Uniform numbers inside (0, 1), in steps of 2⁻⁵³."""
    rows, columns = in_blocks(samples, BLOCK[0]), in_blocks([slot(*place) for place in places], BLOCK[1])
    with jax.enable_x64(True):
        key = jax.random.fold_in(jax.random.key(seed), zlib.crc32(name.encode()))
        drawn = np.block([[np.asarray(bits(key, row, column)) for column in columns] for row in rows])
    return ((drawn[: len(samples), : len(places)] >> 11) + 0.5) * 2.0**-53


def slot(vehicle: int, component: int) -> int:
    """The number below 2³² that a place has to itself."""
    page, component = divmod(component, COMPONENTS)
    return page * PAGE + vehicle * COMPONENTS + component


def in_blocks(numbers: Sequence[int], size: int) -> UInt32[np.ndarray, "blocks size"]:
    """Numbers in rows of this size, the last one filled up with zeros."""
    padded = np.zeros(-(-len(numbers) // size) * size, np.uint32)
    padded[: len(numbers)] = numbers
    return padded.reshape(-1, size)


@jax.jit
def bits(key: Any, samples: Any, slots: Any) -> Any:
    """64 random bits for each sample and slot."""

    def one(sample: Any, slot: Any) -> Any:
        return jax.random.bits(jax.random.fold_in(jax.random.fold_in(key, sample), slot), (), "uint64")

    return jax.vmap(jax.vmap(one, (None, 0)), (0, None))(samples, slots)
