"""What a script does with a study: simulate it, search it, analyse its draws, compare it."""

import contextlib
import uuid
import weakref
from pathlib import Path
from typing import TYPE_CHECKING, SupportsInt

import pandas as pd

from jaxnet.api.results import AnyPath, Results, open, writing
from jaxnet.config.document import ConfigError, Problem
from jaxnet.config.study import Study, StudySource, load
from jaxnet.engine.cores import cores
from jaxnet.lazy import LazyModule
from jaxnet.runs.cache import enable
from jaxnet.runs.cluster import executor
from jaxnet.statistics.steps import no_progress
from jaxnet.store import results as stored
from jaxnet.store.admission import admit
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.results import Part, whole_number
from jaxnet.store.tables import read_table
from jaxnet.view.text import progress as reports

if TYPE_CHECKING:
    from jax import Array

    from jaxnet.runs.field import LaneField
    from jaxnet.statistics.pairs import Comparison

batch = LazyModule("jaxnet.engine.batch")
fields = LazyModule("jaxnet.runs.field")
pairing = LazyModule("jaxnet.statistics.pairs")
runs = LazyModule("jaxnet.runs.run")

ProgressOption = reports.ReportLanes | bool | None


def run(
    study: StudySource,
    out: AnyPath | None = None,
    fresh: bool = False,
    progress: ProgressOption = None,
    devices: int | None = None,
    chunk: int | None = None,
    workers: int | None = None,
    cluster: str | None = None,
) -> Results:
    """Simulate the lanes of a study that its results folder lacks.

    Parameters
    ----------
    study
        A study, or any other argument of `load`.
    out
        Path or URL of the results folder; None is results/NAME.
    fresh
        Whether to remove earlier results of the folder first.
    progress
        A function of lanes done, lanes in all, and lanes failed. None shows a bar in a terminal or
        notebook, True also prints a line each half minute elsewhere, False shows nothing.
    devices
        Largest number of cores or accelerators; None is all of them.
    chunk
        Number of lanes that advance side by side; None suits the engine. Another number changes
        rows by rounding.
    workers
        Number of processes that share the cores. A script that asks for workers must guard its
        `__main__`.
    cluster
        Address of a dask scheduler whose workers see the results folder.

    Returns
    -------
    Results
        The finished folder.

    Raises
    ------
    ConfigError, FolderError
        The study is not valid; the folder holds another study, or cannot be written.
    ClusterError
        The workers are lost or do not answer.

    Examples
    --------
    >>> import jaxnet, tempfile
    >>> keys = {"engine": "exact", "horizon": 5.0, "samples": 2}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     results = jaxnet.run(keys, folder)
    ...     sorted(path.name for path in results.path.iterdir() if not path.name.startswith("."))
    ['cells.csv', 'lanes', 'manifest.json', 'study.yaml']
    """
    enable()
    study = load(study)
    folder = folder_of(study, out)
    with (
        folder.writing(),
        executor(folder.path, workers, cluster, devices or cores(), chunk) as others,
    ):
        admit(folder, study.config, fresh)
        # `runs` takes long to import; the workers start meanwhile.
        with reports.report_progress(progress) as report:
            machine = batch.Machine(devices, chunk)
            work = runs.Run(study.config, study.cells, folder, report, machine, others)
            missing = work.whole()
    return Results(folder.path, found_all=not missing)


def run_part(
    study: StudySource,
    part: int,
    parts: int,
    out: AnyPath | None = None,
    progress: ProgressOption = None,
    devices: int | None = None,
    chunk: int | None = None,
) -> Part:
    """Simulate shards `part`, `part + parts`, … of a study.

    Any number of these calls may run at the same time. Afterwards `run` simulates missing lanes and
    makes the tables and arrays.

    Parameters
    ----------
    study
        A study, or any other argument of `load`.
    part
        Number of the first shard, from 0 to `parts - 1`.
    parts
        Number of parts.
    out, progress, devices, chunk
        As in `run`.

    Returns
    -------
    Part
        The number of shards, of shards simulated now, and of failed lanes.

    Raises
    ------
    ConfigError
        The study is not valid.
    FolderError
        There is no such part, the folder holds another study, or it cannot be written.

    Examples
    --------
    >>> import jaxnet, tempfile
    >>> keys = {"engine": "exact", "horizon": 5.0, "samples": 2}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     part = jaxnet.run_part(keys, part=0, parts=1, out=folder)
    >>> part.shards, part.simulated, part.failed
    (1, 1, 0)
    """
    if not 0 <= part < parts:
        raise FolderError(f"there are parts 0 to {parts - 1} of {parts} (got {part})")
    enable()
    study = load(study)
    folder, machine = folder_of(study, out), batch.Machine(devices, chunk)
    with folder.writing(alone=False):
        admit(folder, study.config)
        with reports.report_progress(progress) as report:
            work = runs.Run(study.config, study.cells, folder, report, machine)
            return Part(folder.path, *work.part(part, parts))


def simulate(
    study: StudySource,
    samples: SupportsInt | None = None,
    progress: ProgressOption = None,
    devices: int | None = None,
) -> Results:
    """Simulate a study in memory.

    The results live in this process alone, and their memory is freed with the returned object.
    Tables and arrays that were read from it stay.

    Parameters
    ----------
    study
        A study, or any other argument of `load`.
    samples
        Number of lanes of each cell; None is the study's own number.
    progress, devices
        As in `run`.

    Returns
    -------
    Results
        All that the results of a folder have.

    Raises
    ------
    ConfigError
        The study is not valid.

    Examples
    --------
    >>> import jaxnet
    >>> keys = {"engine": "exact", "horizon": 5.0, "sweep": {"attack.magnitude": [1, 10]}}
    >>> results = jaxnet.simulate(keys, samples=2)
    >>> results.cells[["attack.magnitude", "lanes", "ok"]]
       attack.magnitude  lanes  ok
    0                 1      2   2
    1                10      2   2
    """
    study = load(study, {} if samples is None else {"samples": samples})
    results = Results(in_memory().path)
    weakref.finalize(results, Folder(results.path.parent).remove, results.path.name)
    run(study, results.path, progress=progress, devices=devices)
    return results


def field(
    study: StudySource, sample: SupportsInt = 0, cell: SupportsInt = 0
) -> "tuple[LaneField, Array]":
    """Return the vector field of one lane, and the state from which the lane starts.

    `field(t, state, args)`, as diffrax takes it, is pure and jitted. Its arguments are the time [s]
    and a state of shape (n, m): rows x [m], y [m], heading [rad], speed [m/s] and the vehicle's
    further states, one column a vehicle. `args` is ignored. Vehicles decide at every evaluation,
    whatever the study's `tick` is. The field jumps where a decision changes.

    Parameters
    ----------
    study
        A study, or any other argument of `load`.
    sample, cell
        Numbers of the sample and of the cell, from 0.

    Returns
    -------
    field : Callable
        The vector field.
    state : Array, shape (n, m)
        The initial state.

    Raises
    ------
    ConfigError
        The study is not valid.
    ValueError
        The study has no such lane, or its defence or attack decides at ticks only.
    RuntimeError
        JAX does not calculate in double precision.

    Examples
    --------
    >>> import jax, jaxnet
    >>> jax.config.update("jax_enable_x64", True)
    >>> vector_field, state = jaxnet.field({"vehicles": 3, "attack": "none"})
    >>> state.shape, vector_field(0.0, state, None).shape
    ((6, 3), (6, 3))
    """
    return fields.field_of(load(study), whole_number("cell", cell), whole_number("sample", sample))


def compare(first: stored.Results | AnyPath, second: stored.Results | AnyPath) -> "Comparison":
    """Compare the lanes of two studies, paired by their draws.

    Parameters
    ----------
    first, second
        Results, or paths of results folders.

    Returns
    -------
    Comparison
        Tables of the differences, second − first, cell by cell.

    Raises
    ------
    FolderError
        The studies have no lanes with equal draws.

    Examples
    --------
    >>> import jaxnet
    >>> keys = {"engine": "exact", "horizon": 5.0, "samples": 2}
    >>> weak, strong = (jaxnet.simulate(keys | {"attack": {"magnitude": a}}) for a in (1, 10))
    >>> bool((jaxnet.compare(weak, strong).cells["tail_mean_difference"] > 0).all())
    True
    """
    a, b = (each if isinstance(each, stored.Results) else open(each) for each in (first, second))
    return pairing.compare_studies(a, b)


def sensitivity(
    study: StudySource, samples: SupportsInt = 1024, out: AnyPath | None = None
) -> pd.DataFrame:
    """Compute Sobol's indices of each metric to each quantity that a study draws, cell by cell.

    The function simulates `samples` (d + 2) lanes for a cell that draws d quantities. It writes
    `sensitivity.csv`. Cells that the file already has are not computed again.

    Parameters
    ----------
    study
        A study, or any other argument of `load`.
    samples
        Number of lanes of a cell for each quantity.
    out
        Results folder, which may hold a run of the study; None is results/NAME.

    Returns
    -------
    pd.DataFrame
        First-order and total indices with 95 % intervals.

    Raises
    ------
    ConfigError, FolderError
        The study is not valid; the folder holds another study, or cannot be written.

    Examples
    --------
    >>> import jaxnet, tempfile
    >>> keys = {"engine": "exact", "horizon": 5.0}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     indices = jaxnet.sensitivity(keys, samples=16, out=folder)
    >>> indices.loc[indices["metric"] == "tail_mean", "quantity"].to_list()
    ['initial.position', 'initial.heading', 'initial.speed', 'attack.phase']
    """
    study = load(study)
    table, *_ = writing.write_sensitivity(study, whole_number("samples", samples), out)
    return read_table(table)


def rare(
    study: StudySource, points: SupportsInt = 1000, out: AnyPath | None = None
) -> pd.DataFrame:
    """Estimate a very small share of unrecovered lanes by subset simulation, cell by cell.

    The function writes `rare.csv`. Cells that the file already has are not computed again.

    Parameters
    ----------
    study
        A study, or any other argument of `load`.
    points
        Number of lanes of a level, in each of ten repeats.
    out
        Results folder, which may hold a run of the study; None is results/NAME.

    Returns
    -------
    pd.DataFrame
        The shares with 95 % t intervals over the repeats.

    Raises
    ------
    ConfigError
        The study is not valid.
    FolderError
        The study has no `recovery`, the folder holds another study, or it cannot be written.

    Examples
    --------
    >>> import jaxnet, tempfile
    >>> keys = {"engine": "exact", "horizon": 5.0, "recovery": {"tau": 0.01}}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     estimate = jaxnet.rare(keys, points=20, out=folder)
    >>> estimate[["cell", "share", "levels", "lanes"]]  # five seconds are too few to recover
       cell  share  levels  lanes
    0     0    1.0       1    200
    """
    return read_table(writing.write_rare(load(study), whole_number("points", points), out))


def search(
    study: StudySource,
    out: AnyPath | None = None,
    fresh: bool = False,
    progress: ProgressOption = None,
    devices: int | None = None,
    chunk: int | None = None,
    workers: int | None = None,
    cluster: str | None = None,
) -> Results:
    """Search for the attacker's worst choice in each cell, beside as many random lanes.

    The random lanes are a run of the study. An interrupted search goes on. Workers search cells
    side by side.

    Parameters
    ----------
    study
        A study that has `search`, or any other argument of `load`.
    out, fresh, progress, devices, chunk, workers, cluster
        As in `run`.

    Returns
    -------
    Results
        `worst` has a row for each cell, `searched` a row for each generation.

    Raises
    ------
    ConfigError
        The study is not valid, or has no `search`.
    FolderError
        The folder holds another study, or cannot be written.
    ClusterError
        The workers are lost or do not answer.

    Examples
    --------
    >>> import jaxnet, tempfile
    >>> keys = {"engine": "exact", "horizon": 20.0, "tail": 5.0, "vehicles": 3, "defence": "none"}
    >>> keys["attack"] = {"kind": "rotating", "vehicles": [2], "magnitude": 10.0}
    >>> keys["search"] = {"over": {"attack.frequency": [0.1, 4]}, "budget": 100, "until": 20.0}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     results = jaxnet.search(keys, folder)
    ...     worst = results.worst
    >>> list(worst.columns[:3]), bool((worst["greatest"] >= worst["found"]).all())
    (['cell', 'found', 'late'], True)
    """
    results = run(with_random_lanes(study), out, fresh, progress, devices, chunk, workers, cluster)
    with (
        contextlib.nullcontext(no_progress) if progress is False else reports.report_steps() as told
    ):
        for _ in writing.write_search(results, told, devices, chunk, workers, cluster):
            pass
    return results


def folder_of(study: Study, out: AnyPath | None) -> Folder:
    """The results folder of a study: the given one, or results/NAME."""
    return Folder(Path("results") / study.config.name if out is None else out)


def in_memory() -> Folder:
    return Folder(f"memory://jaxnet/{uuid.uuid4().hex}")


def with_random_lanes(study: StudySource) -> Study:
    """The study with as many random lanes as its search takes; raise ConfigError."""
    study = load(study)
    if study.config.search is None:
        told = "is missing: add, for example, search: {over: {attack.phase: each}}"
        raise ConfigError([Problem(study.config.name, "search", told)])
    return load(study, {"samples": study.config.search.budget})
