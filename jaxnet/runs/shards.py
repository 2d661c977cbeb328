"""Shards: simulated into the folder, and looked over when a run goes on.

A shard holds consecutive samples of one cell. Whoever simulates it, this process or another, is given the
`Assignment` and the shard, writes its arrays and then its rows, and answers with a few numbers. A shard
whose row file is there is therefore complete, unless something has happened to its files since.

Shards whose lanes can share a compiled program follow each other without a pause, drawn while others are
simulated.
"""

import io
import threading
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
import pyarrow as pa

from jaxnet.config.keys import Config
from jaxnet.engine import batch
from jaxnet.engine.batch import Job, Machine
from jaxnet.engine.plan import Outcome
from jaxnet.kinds.provenance import Provenance
from jaxnet.lanes.jobs import job, source_of
from jaxnet.runs.tally import Done, sums_of
from jaxnet.store import arrays, layout, rows
from jaxnet.store.folder import Folder
from jaxnet.store.layout import Shard, Variable
from jaxnet.store.rows import Stamp, TornError
from jaxnet.version import __version__

BESIDE = "npz"  # of the stamp's checksums that of the file of arrays beside the rows
TAKING = threading.Semaphore(2)  # who hold a shard's arrays in memory at a time


class Assignment(NamedTuple):
    """What it takes to simulate any shard of a study, besides the shard."""

    folder: Folder
    study: str  # hash
    config: Config  # of the study
    size: int  # samples of a whole shard
    types: dict[str, pa.DataType]  # of the swept keys' columns
    stores: dict[str, dict[str, Variable]]  # variables to be stored over time, by the stores' names
    filled: dict[str, str] | None  # identities of those stores; None: arrays are put beside the rows
    modules: dict[str, Provenance]  # that kinds from outside came from
    tau: float | None  # of the study's recovery

    @property
    def variables(self) -> dict[str, Variable]:
        """What is saved over time, of all stores."""
        return {name: each for variables in self.stores.values() for name, each in variables.items()}

    @property
    def series(self) -> tuple[str, ...]:
        """What an engine is asked for to be saved over time."""
        return layout.series_of(self.variables)

    def stamp(self, shard: Shard, checksums: dict[str, int]) -> Stamp:
        """What the shard's row file is to say of itself."""
        place = shard.cell.number, self.first(shard), self.size
        return Stamp(__version__, self.study, *place, self.filled or {}, checksums)

    def first(self, shard: Shard) -> int:
        """First sample of the shard's file."""
        return shard.samples.start // self.size * self.size

    def rows_of(self, shard: Shard) -> int:
        """How many rows the shard's file has once it is whole."""
        return shard.samples.stop - self.first(shard)

    def missing(self, shard: Shard, done: Done | None) -> Shard | None:
        """The shard's samples that are not there; None if all are."""
        first = shard.samples.start if done is None else self.first(shard) + done.sums.lanes
        return (
            shard._replace(samples=range(first, shard.samples.stop)) if first < shard.samples.stop else None
        )

    def done(self, shard: Shard, rows: pa.Table) -> Done:
        """What is told of a shard that has these rows."""
        wanted = rows.select(["status", "tail_mean"]).to_pandas()
        return Done(shard.number, shard.cell.number, sums_of(shard.cell, wanted, self.tau))


def simulate_shards(
    work: Assignment,
    shards: Sequence[Shard],
    machine: Machine,
    load_done: Callable[[int], None] = lambda lanes: None,
) -> Iterator[Done]:
    """Simulate and store shards, behind what is there of them; each is told of when it is whole.

    `load_done` is told of lanes before.
    """
    stores = {name: arrays.opened(work.folder.path / name) for name in work.filled or {}}
    for shard, outcome in outcomes(work, shards, machine, load_done):
        values = arrays.stored(work.variables, outcome.series)
        if work.filled is None:
            checksums = put_beside(work, shard, values)
        else:
            checksums = fill(work, shard, values, stores)
        table, stamp = rows.table_of(shard, outcome, work.types), work.stamp(shard, checksums)
        if before := shard.samples.start - work.first(shard):
            there, _ = rows.read_rows(work.folder.path / rows.name_of(shard.number))
            table = pa.concat_tables([there.slice(0, before), table])
        rows.write_rows(work.folder, shard.number, table, stamp)
        yield work.done(shard, table)


def outcomes(
    work: Assignment, shards: Sequence[Shard], machine: Machine, load_done: Callable[[int], None]
) -> Iterator[tuple[Shard, Outcome]]:
    """Outcome of each shard, those that fit one program in one go."""
    some = {shard.cell.number: shard for shard in shards}  # one of each cell
    sources = {number: source_of(work.config, shard.cell.scenario) for number, shard in some.items()}

    def drawn(shard: Shard, samples: Sequence[int]) -> Job:
        return job(shard.cell.scenario, sources[shard.cell.number], samples, work.series)

    programs = {number: program_of(drawn(shard, [0])) for number, shard in some.items()}
    kinds: dict[Any, list[Shard]] = {}
    for shard in shards:
        kinds.setdefault(programs[shard.cell.number], []).append(shard)
    for alike in kinds.values():
        one = drawn(alike[0], [0])
        inputs = (drawn(shard, shard.samples).inputs for shard in alike)
        lanes = sum(len(shard.samples) for shard in alike)
        ends = batch.simulate_each(inputs, lanes, one.network, one.clock, one.plan, machine, load_done)
        yield from zip(alike, ends, strict=True)


def program_of(one: Job) -> Any:
    """What jobs must share to run in one go: types, shapes, the plan, the network and the clock."""
    leaves, structure = jax.tree.flatten(one.inputs)
    shared, kind = jax.tree.flatten((one.network, one.clock))
    values = tuple((leaf.shape, leaf.tobytes()) for leaf in map(np.asarray, shared))
    return one.plan, structure, tuple((leaf.shape[1:], leaf.dtype) for leaf in leaves), kind, values


def fill(
    work: Assignment, shard: Shard, values: dict[str, np.ndarray], stores: dict[str, Any]
) -> dict[str, int]:
    """Write a shard's arrays into the stores; the checksums of its chunks."""
    samples, checksums = slice(shard.samples.start, shard.samples.stop), {}
    for name, variables in work.stores.items():
        work.folder.look()
        arrays.write(stores[name], (shard.cell.number, samples), {key: values[key] for key in variables})
        checksums |= arrays.checksums(work.folder.path / name, variables, chunk_of(work, shard))
    return checksums


def chunk_of(work: Assignment, shard: Shard) -> tuple[int, int]:
    """Where a shard's chunks are along cell and sample."""
    return shard.cell.number, shard.samples.start // work.size


def name_beside(number: int) -> str:
    """The file beside a shard's rows that holds its arrays until they are taken into the stores."""
    return rows.name_of(number).replace(".parquet", ".npz")


def put_beside(work: Assignment, shard: Shard, values: dict[str, np.ndarray]) -> dict[str, int]:
    """Write a shard's arrays beside its rows; the checksum of their file."""
    if not values:
        return {}
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **values)
    work.folder.put(name_beside(shard.number), lambda file: file.write(content.getbuffer()))
    return {BESIDE: zlib.crc32(content.getbuffer())}


def there(work: Assignment, shard: Shard) -> Done | None:
    """What is there of a shard, with its arrays; one that is torn is removed, with a warning.

    Arrays that lie beside its rows are taken into the stores.
    """
    path = work.folder.path / rows.name_of(shard.number)
    try:
        table, stamp = rows.read_rows(path)
        if stamp._replace(filled={}, checksums={}) != work.stamp(shard, {})._replace(filled={}):
            raise TornError("holds lanes of another study or version, or is parted otherwise")
        if table.column_names != rows.column_names(shard.cell):
            raise TornError("has other columns")
        table = table.slice(0, work.rows_of(shard))
        if not arrays_there(work, shard, table, stamp):
            return None
    except FileNotFoundError:
        return None
    except TornError as error:
        work.folder.remove(rows.name_of(shard.number))
        work.folder.remove(name_beside(shard.number))
        warnings.warn(f"{path}: {error}; its lanes are simulated again", stacklevel=2)
        return None
    return work.done(shard, table)


def arrays_there(work: Assignment, shard: Shard, table: pa.Table, stamp: Stamp) -> bool:
    """Whether the arrays of a shard whose rows are there are so too; raises TornError."""
    if work.filled is not None and stamp.filled.items() >= work.filled.items():
        check_arrays(work, shard, stamp)
        return True
    if work.stores and table.num_rows < work.rows_of(shard):  # no store to go on in
        return False
    if work.filled is None:
        held = stamp.filled.keys() >= work.stores.keys()
        return held or beside(work, shard, stamp).keys() >= work.variables.keys()
    return take_in(work, shard, table, stamp)


def check_arrays(work: Assignment, shard: Shard, stamp: Stamp) -> None:
    """Raise TornError if the shard's part of a store is not as it was written."""
    for name, variables in work.stores.items():
        store = work.folder.path / name
        if not arrays.intact(store, variables, chunk_of(work, shard), stamp.checksums):
            where = f"cell {shard.cell.number}, samples {shard.samples.start} to {shard.samples.stop - 1}"
            raise TornError(f"{name} is corrupt at {where}")


def take_in(work: Assignment, shard: Shard, table: pa.Table, stamp: Stamp) -> bool:
    """Take the arrays beside a shard's rows into the stores; whether all that are wanted were there."""
    count = len(shard.samples)
    with TAKING:
        values = {key: each[:count] for key, each in beside(work, shard, stamp).items()}
        if not values.keys() >= work.variables.keys():
            return False
        stores = {name: arrays.opened(work.folder.path / name) for name in work.stores}
        checksums = fill(work, shard, values, stores)
    rows.write_rows(work.folder, shard.number, table.slice(0, count), work.stamp(shard, checksums))
    work.folder.remove(name_beside(shard.number))
    return True


def beside(work: Assignment, shard: Shard, stamp: Stamp) -> dict[str, np.ndarray]:
    """The arrays beside a shard's rows, none if there is no file of them; raises TornError."""
    path = work.folder.path / name_beside(shard.number)
    if BESIDE not in stamp.checksums or not path.exists():
        return {}
    content = path.read_bytes()
    if zlib.crc32(content) != stamp.checksums[BESIDE]:
        raise TornError("the arrays beside it are torn or of other lanes")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as held:
            return dict(held)
    except (ValueError, OSError, zipfile.BadZipFile) as error:
        raise TornError(f"the arrays beside it cannot be read ({error})") from error
