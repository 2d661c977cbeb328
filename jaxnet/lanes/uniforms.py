"""Uniform numbers that belong to what they are for, and to nothing else.

One belongs to (seed, the quantity's dotted name, sample, vehicle, component): it does not change with the
number of samples, the order in which lanes run, or any other key. Every distribution is its inverse CDF of
that number, so cells that differ in anything share their draws (common random numbers).
"""

import functools
import zlib
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import numpy as np
from jaxtyping import Float, Int, UInt32

COMPONENTS = 4  # of a vehicle whose slots are side by side
PAGE = 2**16  # slots from these components of all vehicles to the next ones; vehicles are at most 10,000
UNIFORMS_BLOCK = (
    256,
    32,
)  # samples and slots drawn by one call, wanted or not, so that one compiled program does all

BITS = 32  # of a point's coordinates: with more SciPy cannot go on from the middle
MOST_DIMENSIONS = 21_201  # that Joe and Kuo (2008) have direction numbers for

Entry = tuple[int, int]  # vehicle (0: the lane's own) and component
Drawn = Float[np.ndarray, "samples places"]


class Place(NamedTuple):
    """What one uniform number of a sample is for."""

    name: str
    vehicle: int = 0  # the lane's own
    component: int = 0


@runtime_checkable
class Source(Protocol):
    """Where the numbers of samples come from."""

    def uniforms(self, name: str, samples: Sequence[int], places: Sequence[Entry]) -> Drawn:
        """Numbers inside (0, 1) of a quantity."""
        ...

    def generator(self, name: str, sample: int) -> np.random.Generator:
        """For what no fixed number of draws can make."""
        ...


class Keyed(NamedTuple):
    """Random numbers of a seed."""

    seed: int

    def uniforms(self, name: str, samples: Sequence[int], places: Sequence[Entry]) -> Drawn:
        """In steps of 2⁻⁵³."""
        rows, columns = (
            draw_in_blocks(samples, UNIFORMS_BLOCK[0]),
            draw_in_blocks([slot(*place) for place in places], UNIFORMS_BLOCK[1]),
        )
        with jax.enable_x64(True):
            key = jax.random.fold_in(jax.random.key(self.seed), zlib.crc32(name.encode()))
            drawn = np.block([[np.asarray(bits(key, row, column)) for column in columns] for row in rows])
        return ((drawn[: len(samples), : len(places)] >> 11) + 0.5) * 2.0**-53

    def generator(self, name: str, sample: int) -> np.random.Generator:
        """Of the seed, the name and the sample."""
        return np.random.default_rng([self.seed, zlib.crc32(name.encode()), sample])


class Scrambled(NamedTuple):
    """Numbers of Sobol's sequences, one of so many points after the other, each scrambled independently.

    A number's dimension is its column; what has none is random.
    """

    seed: int
    points: int
    columns: dict[Place, int]

    def uniforms(self, name: str, samples: Sequence[int], places: Sequence[Entry]) -> Drawn:
        """In steps of 2⁻³²."""
        given = sobol(self.seed, self.points, len(self.columns), tuple(samples))
        lanes = Given(given, self.columns, np.asarray(samples), Keyed(self.seed))
        return lanes.uniforms(name, range(len(samples)), places)

    def generator(self, name: str, sample: int) -> np.random.Generator:
        """A random one."""
        return Keyed(self.seed).generator(name, sample)


class Recorded:
    """A source, and which of its numbers were asked for, in the order in which they first were."""

    def __init__(self, source: Source):
        self.source, self.places, self.names = source, dict[Place, None](), dict[str, None]()

    def uniforms(self, name: str, samples: Sequence[int], places: Sequence[Entry]) -> Drawn:
        """The source's."""
        self.places.update({Place(name, *place): None for place in places})
        self.names[name] = None
        return self.source.uniforms(name, samples, places)

    def generator(self, name: str, sample: int) -> np.random.Generator:
        """The source's."""
        self.names[name] = None
        return self.source.generator(name, sample)


class Later(NamedTuple):
    """A source's numbers, those of some names so many samples later, so that they are other ones."""

    source: Source
    by: int
    names: Collection[str]

    def uniforms(self, name: str, samples: Sequence[int], places: Sequence[Entry]) -> Drawn:
        """Those of the samples, or of later ones."""
        return self.source.uniforms(name, [sample + self.lag(name) for sample in samples], places)

    def generator(self, name: str, sample: int) -> np.random.Generator:
        """That of the sample, or of a later one."""
        return self.source.generator(name, sample + self.lag(name))

    def lag(self, name: str) -> int:
        """Samples by which a quantity's numbers are later."""
        return self.by if name in self.names else 0


class Given(NamedTuple):
    """Numbers given for some places, lane by lane; all others are those that a source has for a sample.

    What is asked for by sample is asked for by the number of a lane here, from 0.
    """

    given: Drawn
    columns: dict[Place, int]
    samples: Int[np.ndarray, " lanes"]
    source: Source

    def uniforms(self, name: str, samples: Sequence[int], places: Sequence[Entry]) -> Drawn:
        """Those given, and others."""
        lanes = np.asarray(samples)
        columns = [self.columns.get(Place(name, *place)) for place in places]
        found = np.empty((len(lanes), len(places)))
        rest = [number for number, column in enumerate(columns) if column is None]
        if rest:
            theirs, where = np.unique(self.samples[lanes], return_inverse=True)
            drawn = self.source.uniforms(name, theirs.tolist(), [places[number] for number in rest])
            found[:, rest] = drawn[where]
        for number, column in enumerate(columns):
            if column is not None:
                found[:, number] = self.given[lanes, column]
        return found

    def generator(self, name: str, sample: int) -> np.random.Generator:
        """Of the lane's sample."""
        return self.source.generator(name, int(self.samples[sample]))


@functools.lru_cache(maxsize=4)  # for each name asks for the same samples
def sobol(seed: int, points: int, dimensions: int, samples: tuple[int, ...]) -> Drawn:
    """Sample s is point s mod `points` of sequence s // `points`."""
    from scipy.stats import qmc  # takes its time

    found, (sequences, numbers) = np.empty((len(samples), dimensions)), np.divmod(samples, points)
    for sequence in np.unique(sequences):
        mine = sequences == sequence
        first, last = int(numbers[mine].min()), int(numbers[mine].max())
        drawn = qmc.Sobol(dimensions, bits=BITS, rng=np.random.default_rng([seed, int(sequence)]))
        if first:
            drawn.fast_forward(first)
        whole = 2 ** (last - first).bit_length()  # or it warns
        found[mine] = drawn.random(whole)[numbers[mine] - first]
    return found + 2.0 ** -(BITS + 1)


def slot(vehicle: int, component: int) -> int:
    """The number below 2³² that a place has to itself."""
    page, component = divmod(component, COMPONENTS)
    return page * PAGE + vehicle * COMPONENTS + component


def draw_in_blocks(numbers: Sequence[int], size: int) -> UInt32[np.ndarray, "blocks size"]:
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
