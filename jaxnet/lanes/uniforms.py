"""Uniform numbers, each with a fixed purpose.

A number depends only on the seed, the dotted name of the quantity, the sample, the vehicle and the
component. The number of samples, the order of lanes and other keys do not change it. Every
distribution is its inverse CDF of that number. Cells with different distributions therefore share
their draws (common random numbers).
"""

import functools
import zlib
from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import numpy as np
from jaxtyping import Float, Int, UInt32, UInt64

from jaxnet.engine import programs

COMPONENTS = 4  # components of a vehicle in adjacent slots
PAGE = 2**16  # slots between groups of components; one group holds all vehicles, at most 10,000
# samples and slots of one call, wanted or not, so that one compiled program serves all draws
UNIFORMS_BLOCK = (256, 32)

MOST_KEPT = 2**17  # numbers of one quantity that are kept for the next cell

BITS = 32  # of each coordinate of a point; with more bits, SciPy cannot start inside a sequence
MOST_DIMENSIONS = 21_201  # dimensions with direction numbers in Joe and Kuo (2008)

Entry = tuple[int, int]  # vehicle (0 for the lane itself) and component
Drawn = Float[np.ndarray, "samples places"]


class Place(NamedTuple):
    """The purpose of one uniform number of a sample: a name, a vehicle and a component."""

    name: str
    vehicle: int = 0  # 0 for the lane itself
    component: int = 0


@runtime_checkable
class Source(Protocol):
    """Protocol of a source of random numbers for samples."""

    def uniforms(self, name: str, samples: Sequence[int], places: Sequence[Entry]) -> Drawn:
        """Numbers inside (0, 1) of a quantity: (samples, places)."""
        ...

    def generator(self, name: str, sample: int) -> np.random.Generator:
        """A random generator for a quantity without a fixed number of draws."""
        ...


def keyed_draws(seed: int, name: str, samples: tuple[int, ...], places: tuple[Entry, ...]) -> Drawn:
    """The pseudorandom numbers of `Keyed.uniforms`, not to be written into."""
    rows = draw_in_blocks(samples, UNIFORMS_BLOCK[0])
    columns = draw_in_blocks([slot(*place) for place in places], UNIFORMS_BLOCK[1])
    key = np.int64(seed), np.uint32(zlib.crc32(name.encode()))
    with jax.enable_x64(True):
        blocks = [[np.asarray(bits()(*key, row, column)) for column in columns] for row in rows]
    drawn = np.block(blocks)
    found = ((drawn[: len(samples), : len(places)] >> 11) + 0.5) * 2.0**-53
    found.flags.writeable = False
    return found


kept_draws = functools.lru_cache(maxsize=16)(keyed_draws)  # cells share the draws of their samples


class Keyed(NamedTuple):
    """A source of pseudorandom numbers from a seed, in steps of 2⁻⁵³."""

    seed: int

    def uniforms(self, name: str, samples: Sequence[int], places: Sequence[Entry]) -> Drawn:
        draw = kept_draws if len(samples) * len(places) <= MOST_KEPT else keyed_draws
        return draw(self.seed, name, tuple(samples), tuple(places))

    def generator(self, name: str, sample: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, zlib.crc32(name.encode()), sample])


class Scrambled(NamedTuple):
    """A source of numbers from scrambled Sobol sequences.

    Each sequence has `points` points, in steps of 2⁻³², and its own independent scrambling.
    `columns` maps a place to its dimension. A place without a dimension, and a quantity without a
    fixed number of draws, gets pseudorandom numbers.
    """

    seed: int
    points: int
    columns: dict[Place, int]

    def uniforms(self, name: str, samples: Sequence[int], places: Sequence[Entry]) -> Drawn:
        given = sobol(self.seed, self.points, len(self.columns), tuple(samples))
        lanes = Given(given, self.columns, np.asarray(samples), Keyed(self.seed))
        return lanes.uniforms(name, range(len(samples)), places)

    def generator(self, name: str, sample: int) -> np.random.Generator:
        return Keyed(self.seed).generator(name, sample)


class Recorded:
    """A source that records the requested places and names, in the order of the first request."""

    def __init__(self, source: Source):
        self.source, self.places, self.names = source, dict[Place, None](), dict[str, None]()

    def uniforms(self, name: str, samples: Sequence[int], places: Sequence[Entry]) -> Drawn:
        self.places.update({Place(name, *place): None for place in places})
        self.names[name] = None
        return self.source.uniforms(name, samples, places)

    def generator(self, name: str, sample: int) -> np.random.Generator:
        self.names[name] = None
        return self.source.generator(name, sample)


class Later(NamedTuple):
    """A source that shifts the samples of some quantities.

    A quantity in `names` takes the numbers of a later sample: sample plus `by`. Its numbers are
    therefore new. Other quantities keep their numbers.
    """

    source: Source
    by: int
    names: Collection[str]

    def uniforms(self, name: str, samples: Sequence[int], places: Sequence[Entry]) -> Drawn:
        return self.source.uniforms(name, [sample + self.lag(name) for sample in samples], places)

    def generator(self, name: str, sample: int) -> np.random.Generator:
        return self.source.generator(name, sample + self.lag(name))

    def lag(self, name: str) -> int:
        return self.by if name in self.names else 0


class Given(NamedTuple):
    """A source with given numbers at some places, lane by lane, and another source's elsewhere.

    Callers pass lane numbers, from 0, in place of sample numbers. `samples` holds the sample of
    each lane in the other source.
    """

    given: Drawn
    columns: dict[Place, int]
    samples: Int[np.ndarray, " lanes"]
    source: Source

    def uniforms(self, name: str, samples: Sequence[int], places: Sequence[Entry]) -> Drawn:
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
        return self.source.generator(name, int(self.samples[sample]))


@functools.lru_cache(maxsize=4)  # each name requests equal samples
def sobol(seed: int, points: int, dimensions: int, samples: tuple[int, ...]) -> Drawn:
    """Numbers of scrambled Sobol sequences: (samples, dimensions).

    Sample s is point `s mod points` of sequence `s // points`.
    """
    from scipy.stats import qmc  # the import is slow

    found, (sequences, numbers) = np.empty((len(samples), dimensions)), np.divmod(samples, points)
    for sequence in np.unique(sequences):
        mine = sequences == sequence
        first, last = int(numbers[mine].min()), int(numbers[mine].max())
        drawn = qmc.Sobol(dimensions, bits=BITS, rng=np.random.default_rng([seed, int(sequence)]))
        if first:
            drawn.fast_forward(first)
        whole = 2 ** (last - first).bit_length()  # SciPy warns if the number is not a power of 2
        found[mine] = drawn.random(whole)[numbers[mine] - first]
    return found + 2.0 ** -(BITS + 1)


def slot(vehicle: int, component: int) -> int:
    """A number below 2³² that is unique to a vehicle and a component."""
    page, component = divmod(component, COMPONENTS)
    return page * PAGE + vehicle * COMPONENTS + component


def draw_in_blocks(numbers: Sequence[int], size: int) -> UInt32[np.ndarray, "blocks size"]:
    """Numbers in rows of a fixed size, with zeros at the end of the last row."""
    padded = np.zeros(-(-len(numbers) // size) * size, np.uint32)
    padded[: len(numbers)] = numbers
    return padded.reshape(-1, size)


@functools.cache
def bits() -> Callable[..., UInt64[jax.Array, "samples slots"]]:
    """64 random bits for each sample and slot, of a seed and the hash of a name."""

    def drawn(seed: Any, name: Any, samples: Any, slots: Any) -> Any:
        key = jax.random.fold_in(jax.random.key(seed), name)

        def one(sample: Any, slot: Any) -> Any:
            own = jax.random.fold_in(jax.random.fold_in(key, sample), slot)
            return jax.random.bits(own, (), "uint64")

        return jax.vmap(jax.vmap(one, (None, 0)), (0, None))(samples, slots)

    shapes = ((), np.int64), ((), np.uint32), *(((size,), np.uint32) for size in UNIFORMS_BLOCK)
    given = [jax.ShapeDtypeStruct(*each) for each in shapes]
    return programs.by_kept_trace(b"bits", jax.jit(drawn), given)
