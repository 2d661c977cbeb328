"""Shards: simulated into the folder, and looked over when a run goes on.

A shard holds consecutive samples of one cell. Whoever simulates it, this process or another, is given the
`Work` and the shard, writes its arrays and then its rows, and answers with a few numbers. A shard whose row
file is there is therefore complete, unless something has happened to its files since.

Shards whose lanes can share a compiled program follow each other without a pause, drawn while others are
simulated.
"""

import threading
import warnings
import zipfile
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
import pyarrow as pa
from upath import UPath

import jaxnet
from jaxnet.engine import batch
from jaxnet.engine.batch import Job, Machine
from jaxnet.engine.plan import Outcome
from jaxnet.engine.status import Status
from jaxnet.lanes.jobs import job
from jaxnet.store import arrays, rows
from jaxnet.store.folder import Folder
from jaxnet.store.layout import Shard, Variable
from jaxnet.store.rows import Stamp, TornError

TAKING = threading.Semaphore(2)  # who hold a shard's arrays in memory at a time


class Work(NamedTuple):
    """What it takes to simulate any shard of a study, besides the shard."""

    folder: Folder
    study: str  # hash
    seed: int
    size: int  # samples of a whole shard
    types: dict[str, pa.DataType]  # of the swept keys' columns
    stores: dict[str, dict[str, Variable]]  # variables to be stored over time, by the stores' names
    filled: dict[str, str] | None  # identities of those stores; None: arrays are put beside the rows

    @property
    def series(self) -> tuple[str, ...]:
        """What is saved over time."""
        return tuple(name for variables in self.stores.values() for name in variables)

    def stamp(self, shard: Shard) -> Stamp:
        """What the shard's row file is to say of itself."""
        place = shard.cell.number, shard.samples.start, self.size
        return Stamp(jaxnet.__version__, self.study, *place, self.filled or {})


class Done(NamedTuple):
    """What is told of a shard that was stored."""

    shard: int
    lanes: int
    failed: int


def simulate(
    work: Work,
    shards: Sequence[Shard],
    machine: Machine,
    load_done: Callable[[int], None] = lambda lanes: None,
) -> Iterator[Done]:
    """Simulate and store shards; each is told of when it is there. `load_done` is told of lanes before."""
    stores = {name: arrays.opened(work.folder.path / name) for name in work.filled or {}}
    for shard, outcome in outcomes(work, shards, machine, load_done):
        if work.filled is None:
            put_beside(work, shard, outcome.series)
        else:
            fill(work, shard, outcome.series, stores)
        rows.write(work.folder, shard.number, rows.table(shard, outcome, work.types), work.stamp(shard))
        yield Done(shard.number, len(shard.samples), int((outcome.status != Status.ok).sum()))


def outcomes(
    work: Work, shards: Sequence[Shard], machine: Machine, load_done: Callable[[int], None]
) -> Iterator[tuple[Shard, Outcome]]:
    """Outcome of each shard, those that fit one program in one go."""
    programs = {
        cell.number: program_of(job(cell.scenario, work.seed, [0], work.series))
        for cell in {shard.cell.number: shard.cell for shard in shards}.values()
    }
    kinds: dict[Any, list[Shard]] = {}
    for shard in shards:
        kinds.setdefault(programs[shard.cell.number], []).append(shard)
    for alike in kinds.values():
        one = job(alike[0].cell.scenario, work.seed, [0], work.series)
        inputs = (job(shard.cell.scenario, work.seed, shard.samples, work.series).inputs for shard in alike)
        lanes = sum(len(shard.samples) for shard in alike)
        ends = batch.simulate_each(inputs, lanes, one.network, one.clock, one.plan, machine, load_done)
        yield from zip(alike, ends, strict=True)


def program_of(one: Job) -> Any:
    """What jobs must share to run in one go: types, shapes, the plan, the network and the clock."""
    leaves, structure = jax.tree.flatten(one.inputs)
    shared, kind = jax.tree.flatten((one.network, one.clock))
    values = tuple((leaf.shape, leaf.tobytes()) for leaf in map(np.asarray, shared))
    return one.plan, structure, tuple((leaf.shape[1:], leaf.dtype) for leaf in leaves), kind, values


def fill(work: Work, shard: Shard, series: dict[str, np.ndarray], stores: dict[str, Any]) -> None:
    """Write a shard's arrays into the stores."""
    samples = slice(shard.samples.start, shard.samples.stop)
    for name, variables in work.stores.items():
        arrays.write(stores[name], shard.cell.number, samples, {key: series[key] for key in variables})


def path_beside(work: Work, number: int) -> UPath:
    """The file beside a shard's rows that holds its arrays until they are taken into the stores."""
    return (work.folder.path / rows.name_of(number)).with_suffix(".npz")


def put_beside(work: Work, shard: Shard, series: dict[str, np.ndarray]) -> None:
    """Write a shard's arrays beside its rows."""
    types = {key: variable.dtype for variables in work.stores.values() for key, variable in variables.items()}
    if types:
        stored = {key: series[key].astype(dtype) for key, dtype in types.items()}
        name = str(path_beside(work, shard.number).relative_to(work.folder.path))
        work.folder.put(name, lambda file: np.savez(file, allow_pickle=False, **stored))


def there(work: Work, shard: Shard) -> Done | None:
    """A shard that is there, whole and with its arrays; one that is torn is removed, with a warning.

    Arrays that lie beside its rows are taken into the stores.
    """
    path = work.folder.path / rows.name_of(shard.number)
    try:
        table, stamp = rows.read(path)
        if stamp._replace(filled={}) != work.stamp(shard)._replace(filled={}):
            raise TornError("holds lanes of another study or version, or is parted otherwise")
        if table.column_names != rows.column_names(shard.cell):
            raise TornError("has other columns")
        if table.num_rows < len(shard.samples) or not arrays_there(work, shard, table, stamp):
            return None
    except FileNotFoundError:
        return None
    except TornError as error:
        path.unlink(missing_ok=True)
        path_beside(work, shard.number).unlink(missing_ok=True)
        warnings.warn(f"{path}: {error}; its lanes are simulated again", stacklevel=2)
        return None
    failed = sum(status != Status.ok.name for status in table["status"].to_pylist())
    return Done(shard.number, len(shard.samples), failed)


def arrays_there(work: Work, shard: Shard, table: pa.Table, stamp: Stamp) -> bool:
    """Whether the arrays of a shard whose rows are there are so too; raises TornError."""
    if work.filled is None:
        return stamp.filled.keys() >= work.stores.keys() or set(beside(work, shard)) >= set(work.series)
    if not stamp.filled.items() >= work.filled.items():
        return take_in(work, shard, table)
    check_arrays(work, shard)
    return True


def check_arrays(work: Work, shard: Shard) -> None:
    """Raise TornError if the shard's part of a store is not as it was written."""
    for name, variables in work.stores.items():
        store = work.folder.path / name
        if not arrays.intact(store, variables, shard.cell.number, shard.samples.start // work.size):
            where = f"cell {shard.cell.number}, samples {shard.samples.start} to {shard.samples.stop - 1}"
            raise TornError(f"{name} is corrupt at {where}")


def take_in(work: Work, shard: Shard, table: pa.Table) -> bool:
    """Take the arrays beside a shard's rows into the stores; whether all that are wanted were there."""
    count = len(shard.samples)
    with TAKING:
        series = {key: values[:count] for key, values in beside(work, shard).items()}
        if not series.keys() >= set(work.series):
            return False
        fill(work, shard, series, {name: arrays.opened(work.folder.path / name) for name in work.stores})
    rows.write(work.folder, shard.number, table.slice(0, count), work.stamp(shard))
    path_beside(work, shard.number).unlink()
    return True


def beside(work: Work, shard: Shard) -> dict[str, np.ndarray]:
    """The arrays beside a shard's rows, none if there is no file of them; raises TornError."""
    path = path_beside(work, shard.number)
    if not path.exists():
        return {}
    try:
        with path.open("rb") as file, np.load(file) as held:
            return dict(held)
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise TornError(f"the arrays beside it are torn ({error})") from error
