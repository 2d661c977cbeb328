"""Shards: their simulation into the folder, and the check of stored shards when a run resumes.

A shard holds consecutive samples of one cell. A process, this or another, receives the `Assignment`
and the shard. It writes the shard's arrays and then its rows, and returns a few numbers. A shard
with a row file is therefore complete, unless its files were damaged since.

Shards that share a compiled program run one after the other without a pause. The lanes of the next
shard are drawn meanwhile.
"""

import io
import threading
import warnings
import zipfile
import zlib
from collections import deque
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np
import pyarrow as pa

from jaxnet.config.cells import Cell, to_plain
from jaxnet.config.keys import Config
from jaxnet.engine import batch
from jaxnet.engine.batch import Job, Machine
from jaxnet.engine.plan import Inputs, Outcome
from jaxnet.lanes import proofs
from jaxnet.lanes.jobs import job, source_of
from jaxnet.runs.tally import Done, sums_of
from jaxnet.store import arrays, layout, rows
from jaxnet.store.folder import Folder
from jaxnet.store.layout import Shard, Variable
from jaxnet.store.rows import Stamp, TornError
from jaxnet.version import __version__

if TYPE_CHECKING:
    import zarr

Program = tuple[Hashable, ...]  # equal for jobs that can run in one compiled program
BESIDE_ROWS = "npz"  # of the stamp's checksums that of the file of arrays beside the rows
MOST_UNWRITTEN = 8  # shards whose rows wait to be written
MOST_HELD = 2**26  # bytes of drawn lanes that are kept from the search for their programs
STORING = threading.Semaphore(2)  # threads that hold a shard's arrays in memory at a time


class Assignment(NamedTuple):
    """All that a process needs to simulate any shard of a study."""

    folder: Folder
    study: str  # hash
    config: Config  # of the study
    size: int  # samples of a whole shard
    columns: rows.RowColumns
    stores: dict[str, dict[str, Variable]]  # variables to be stored over time, by the stores' names
    filled: dict[str, str] | None  # identities of those stores; None: arrays go beside the rows

    @property
    def variables(self) -> dict[str, Variable]:
        stores = self.stores.values()
        return {name: each for variables in stores for name, each in variables.items()}

    @property
    def series(self) -> tuple[str, ...]:
        return layout.series_of(self.variables)

    def stamp(self, shard: Shard, checksums: dict[str, int]) -> Stamp:
        place = shard.cell.number, self.first(shard), self.size
        return Stamp(__version__, self.study, *place, self.filled or {}, checksums)

    def first(self, shard: Shard) -> int:
        return shard.samples.start // self.size * self.size

    def chunk(self, shard: Shard) -> tuple[int, int]:
        """Place of the shard's chunks along cell and sample."""
        return shard.cell.number, shard.samples.start // self.size

    def rows_of(self, shard: Shard) -> int:
        return shard.samples.stop - self.first(shard)

    def missing(self, shard: Shard, done: Done | None) -> Shard | None:
        """The shard with its missing samples alone; None if it is complete."""
        first = shard.samples.start if done is None else self.first(shard) + done.sums.lanes
        missing = range(first, shard.samples.stop)
        return shard._replace(samples=missing) if missing else None

    def done(self, shard: Shard, rows: pa.Table) -> Done:
        sums = sums_of(shard.cell, rows, self.config.recovery)
        return Done(shard.number, shard.cell.number, sums)


def simulate_shards(
    work: Assignment,
    shards: Sequence[Shard],
    machine: Machine,
    load_done: Callable[[int], None] = lambda lanes: None,
) -> Iterator[Done]:
    """Simulate shards, after the samples that they have; yield a report on each complete shard.

    A thread writes the rows, shard by shard, while the next shards are simulated.
    """
    stores = open_stores(work) if work.filled is not None else {}
    unwritten = deque[Future[Done]]()
    with ThreadPoolExecutor(1) as writer:
        parts = [(shard.cell, shard.samples) for shard in shards]
        outcomes = simulate_outcomes(work.config, parts, work.series, machine, load_done)
        for number, outcome in outcomes:
            shard = shards[number]
            states = shard.cell.scenario.vehicle.states
            values = arrays.series_values(work.variables, outcome.series, states)
            checksums = {}
            if work.filled is not None:
                checksums = write_arrays(work, shard, values, stores)
            elif values:
                content = io.BytesIO()
                np.savez(content, allow_pickle=False, **values)
                work.folder.put(name_beside(shard.number), content.getvalue())
                checksums = {BESIDE_ROWS: zlib.crc32(content.getbuffer())}
            rest = outcome._replace(series={})
            unwritten.append(writer.submit(write_shard, work, shard, rest, checksums))
            while unwritten and (unwritten[0].done() or len(unwritten) > MOST_UNWRITTEN):
                yield unwritten.popleft().result()
        yield from (written.result() for written in unwritten)


def write_shard(
    work: Assignment, shard: Shard, outcome: Outcome, checksums: dict[str, int]
) -> Done:
    """Write the rows of a shard, after those that it has, and report on it."""
    table = work.columns.table(shard, outcome)
    if before := shard.samples.start - work.first(shard):
        there, _ = rows.read_rows(work.folder.path / rows.row_file(shard.number))
        table = pa.concat_tables([there.slice(0, before), table])
    rows.write_rows(work.folder, shard.number, table, work.stamp(shard, checksums))
    return work.done(shard, table)


def simulate_outcomes(
    config: Config,
    parts: Sequence[tuple[Cell, Sequence[int]]],
    series: tuple[str, ...],
    machine: Machine,
    load_done: Callable[[int], None] = lambda lanes: None,
) -> Iterator[tuple[int, Outcome]]:
    """Yield the place in `parts` and the outcome of each part, samples of one cell.

    Parts that fit one program follow each other and fill its loads together: a load costs the same
    for one lane as for all that it holds.
    """
    some = {cell.number: place for place, (cell, _) in enumerate(parts)}  # a part of each cell
    sources = {cell: source_of(config, parts[some[cell]][0].scenario) for cell in some}

    def drawn(place: int, samples: Sequence[int]) -> Job:
        cell = parts[place][0]
        return job(cell.scenario, sources[cell.number], samples, series)

    jobs, held = dict[Program, Job](), dict[int, Inputs]()
    programs, size = dict[int, Program](), 0
    for number, place in some.items():
        one = drawn(place, parts[place][1] if size < MOST_HELD else [0])
        programs[number] = program_of(one)
        jobs.setdefault(programs[number], one)
        if size < MOST_HELD:
            held[place] = one.inputs
            size += sum(leaf.nbytes for leaf in jax.tree.leaves(one.inputs))
    kinds: dict[Program, list[int]] = {}
    for place, (cell, _) in enumerate(parts):
        kinds.setdefault(programs[cell.number], []).append(place)

    def inputs(place: int) -> Inputs:
        return held.pop(place, None) or drawn(place, parts[place][1]).inputs

    for program, alike in kinds.items():
        one = jobs.pop(program)
        lanes = sum(len(parts[place][1]) for place in alike)
        shared = one.network, one.clock, one.plan
        ends = batch.simulate_each(map(inputs, alike), lanes, *shared, machine, load_done)
        yield from zip(alike, ends, strict=True)


def try_kinds(
    config: Config, cells: Sequence[Cell], machine: Machine, series: tuple[str, ...] = ()
) -> None:
    """Trace each program with kinds from outside; raise KindError for a broken contract."""
    scope, tried = config.scope, set[Program]()
    for scenario in (cell.scenario for cell in cells if scope.known):
        if scope.named_in(to_plain(scenario)):
            one = job(scenario, source_of(config, scenario), [0], series)
            if (program := program_of(one)) not in tried:
                tried.add(program)
                batch.trace(one, machine)
                proofs.prove_errors(batch.queue_of(one.inputs, 1).lane, one.network.hearing.sources)


def program_of(one: Job) -> Program:
    leaves, structure = jax.tree.flatten(one.inputs)
    shared, kind = jax.tree.flatten((one.network, one.clock))
    values = tuple((leaf.shape, leaf.tobytes()) for leaf in map(np.asarray, shared))
    return one.plan, structure, tuple((leaf.shape[1:], leaf.dtype) for leaf in leaves), kind, values


Stores = Mapping[str, "zarr.Group"]


def open_stores(work: Assignment) -> Stores:
    found = {name: arrays.open_for_writing(work.folder.path / name) for name in work.stores}
    return {name: store for name, store in found.items() if store is not None}


def write_arrays(
    work: Assignment, shard: Shard, values: dict[str, np.ndarray], stores: Stores
) -> dict[str, int]:
    samples, checksums = slice(shard.samples.start, shard.samples.stop), {}
    for name, variables in work.stores.items():
        mine = {key: values[key] for key in variables}
        with work.folder.naming(name):
            arrays.write_chunks(stores[name], (shard.cell.number, samples), mine)
        path = work.folder.path / name
        checksums |= arrays.read_checksums(path, variables, work.chunk(shard))
    return checksums


def name_beside(number: int) -> str:
    """Name of the file that holds a shard's arrays until they are moved into the stores."""
    return rows.row_file(number).replace(".parquet", ".npz")


def find_done(work: Assignment, shard: Shard) -> Done | None:
    """Report on a shard if its rows and arrays are in the folder, else return None.

    A torn shard is removed with a warning. Arrays beside the rows are moved into the stores.
    """
    path = work.folder.path / rows.row_file(shard.number)
    try:
        table, stamp = rows.read_rows(path)
        if stamp._replace(filled={}, checksums={}) != work.stamp(shard, {})._replace(filled={}):
            raise TornError("holds lanes of another study or version, or is parted otherwise")
        if table.column_names != work.columns.names(shard.cell):
            raise TornError("has other columns")
        count = min(table.num_rows, work.rows_of(shard))
        there = range(work.first(shard), work.first(shard) + count)
        if wrong := rows.wrong_rows(table, shard.cell.number, there):
            raise TornError(wrong)
        table = table.slice(0, work.rows_of(shard))
        return work.done(shard, table) if has_arrays(work, shard, table, stamp) else None
    except FileNotFoundError:
        return None
    except TornError as error:
        work.folder.remove(rows.row_file(shard.number), name_beside(shard.number))
        warnings.warn(f"{path}: {error}; its lanes are simulated again", stacklevel=2)
        return None


def has_arrays(work: Assignment, shard: Shard, table: pa.Table, stamp: Stamp) -> bool:
    """Whether the folder has the arrays of a shard with rows; raise TornError if damaged."""
    if work.filled is not None and stamp.filled.items() >= work.filled.items():
        for name, variables in work.stores.items():
            path = work.folder.path / name
            if not arrays.is_intact(path, variables, work.chunk(shard), stamp.checksums):
                samples = f"samples {shard.samples.start} to {shard.samples.stop - 1}"
                raise TornError(f"{name} is corrupt at cell {shard.cell.number}, {samples}")
        return True
    if work.stores and table.num_rows < work.rows_of(shard):  # no store to go on in
        return False
    if work.filled is None and stamp.filled.keys() >= work.stores.keys():
        return True
    with STORING:
        values = read_beside(work, shard, stamp)
        if work.filled is None or not values.keys() >= work.variables.keys():
            return values.keys() >= work.variables.keys()
        count = len(shard.samples)
        values = {key: each[:count] for key, each in values.items()}
        checksums = write_arrays(work, shard, values, open_stores(work))
    rows.write_rows(work.folder, shard.number, table.slice(0, count), work.stamp(shard, checksums))
    work.folder.remove(name_beside(shard.number))
    return True


def read_beside(work: Assignment, shard: Shard, stamp: Stamp) -> dict[str, np.ndarray]:
    """Arrays in the file beside a shard's rows, none without a file; raise TornError."""
    path = work.folder.path / name_beside(shard.number)
    if BESIDE_ROWS not in stamp.checksums or not path.exists():
        return {}
    content = path.read_bytes()
    if zlib.crc32(content) != stamp.checksums[BESIDE_ROWS]:
        raise TornError("the arrays beside it are torn or of other lanes")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as held:
            return dict(held)
    except (ValueError, OSError, zipfile.BadZipFile) as error:
        raise TornError(f"the arrays beside it cannot be read ({error})") from error
