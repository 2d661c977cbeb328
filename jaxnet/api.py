"""What a script calls: `load` a study, `run` or `simulate` it, `open` its results; `field` is one lane's."""

import contextlib
import dataclasses
import uuid
import weakref
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, SupportsInt

import pandas as pd
from upath import UPath

from jaxnet.config.document import ConfigError, Problem
from jaxnet.config.study import Study, StudySource, load
from jaxnet.runs.cache import enable
from jaxnet.statistics.steps import Steps, untold
from jaxnet.store import results as stored
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.looking import known_or
from jaxnet.store.results import Part, arrays_at, whole
from jaxnet.view.text import progress as reports

if TYPE_CHECKING:
    import xarray
    from jax import Array

    from jaxnet.statistics.pairs import Comparison
    from jaxnet.view.figures.every import Plots

__all__ = [
    "Part",
    "Replay",
    "Results",
    "Study",
    "compare",
    "field",
    "load",
    "open",
    "rare",
    "run",
    "run_part",
    "search",
    "sensitivity",
    "simulate",
]

Place = str | Path | UPath
Progress = reports.Progress | bool | None
VectorField = Callable[[Any, Any, Any], Any]  # time, state (n, m), ignored: the state's derivative


class Replay(NamedTuple):
    """A lane simulated again: its row, its trajectory, and where that is stored."""

    row: pd.Series
    trajectory: "xarray.Dataset"
    path: UPath


@dataclasses.dataclass(frozen=True, repr=False)
class Results(stored.Results):
    """A results folder, read when asked, and what can be made of it.

    `found_all` says of what `run` returns that all was there already, so nothing was simulated.
    """

    found_all: bool = dataclasses.field(default=False, compare=False)

    def fit(self) -> pd.DataFrame:
        """Fit the ultimate error against ā, beside the bounds of theory; the fits.

        Writes what `jaxnet fit` does. Raises FolderError for an unfinished run, where no ā is fixed or
        swept, and while another process writes there.
        """
        for _ in write_fits(self):
            pass
        return self.fits

    def replay(self, cell: SupportsInt, sample: SupportsInt, engine: str | None = None) -> Replay:
        """Simulate one lane again with its trajectory, by the study's own engine or another.

        Raises FolderError if the study has no such lane, or the engine cannot simulate it.
        """
        enable()
        from jaxnet.runs.replay import replay

        path, row = replay(self, whole("cell", cell), whole("sample", sample), engine)
        return Replay(row, arrays_at(path), path)

    def report(self) -> UPath:
        """Write figures and `report.html`, a page that works offline; the page's path.

        Fits what is not fitted yet, and replays what the page shows: the median and worst lanes of a dozen
        cells at most, and the worst of the study if it has `recovery`. Raises FolderError for an unfinished
        run, and while another process writes there.
        """
        *_, page = write_report(self)
        return page

    def animate(self, cell: SupportsInt, sample: SupportsInt, out: Place | None = None) -> UPath:
        """Write a film of one lane, by default into figures/; its path.

        The lane is simulated again if its trajectory is not stored. Raises FolderError if the study has no
        such lane, or for an .mp4 where there is no ffmpeg.
        """
        return write_film(self, whole("cell", cell), whole("sample", sample), out)

    def export(self, out: Place | None = None) -> UPath:
        """Write a file for MATLAB, by default into the folder; its path. Raises FolderError if too large."""
        from jaxnet.store import matlab

        return matlab.write_mat(self, out)

    @property
    def plot(self) -> "Plots":
        """Figures, as in `results.plot.tails()`."""
        from jaxnet.view.figures.every import Plots

        return Plots(self)

    def _repr_html_(self) -> str:
        """What a notebook shows: lanes, and the summary."""
        from jaxnet.view.text import tables

        return tables.html(self)


def open(path: Place, out: Place | None = None, trust: bool = False, config: Place | None = None) -> Results:
    """Results of a folder that a run has made.

    What is made of the rows (fits, figures, the report, replays) is written into the folder itself, or into
    `out`. Raises FolderError if it is no such folder, or if `out` holds what was made of other rows.

    No code is run because the folder names it. A kind from outside that this process has not loaded, and that
    is not installed, is known by what the folder says of it; replays need its code. `config` is the study's
    config, or its folder: modules beside it are loaded. With `trust` modules are loaded from where the folder
    says that they are.
    """
    found = stored.open(path, out, trust, None if config is None else Path(str(config)))
    return Results(found.path, found.out, found.trust, found.config)


def run(
    study: StudySource,
    out: Place | None = None,
    fresh: bool = False,
    progress: Progress = None,
    devices: int | None = None,
    chunk: int | None = None,
    workers: int | None = None,
    cluster: str | None = None,
) -> Results:
    """Simulate what is not there yet of a study, or of what `load` takes for one, into `out`.

    That is a path or URL (default results/NAME). `fresh` throws earlier results of that folder away;
    `progress` is told lanes done, all, failed; by default a terminal or notebook shows a bar, False is none,
    True is a line each half minute elsewhere too.
    `devices` are the cores, or accelerators, used at most (default all); `chunk` is how many lanes advance
    side by side (default what suits the engine; another one changes rows by rounding). `workers` parts the
    cores among so many processes (a script that asks for them must guard its `__main__`), `cluster` is the
    address of a dask scheduler whose workers see the same folder.

    Raises ConfigError, FolderError or ClusterError.
    """
    enable()
    from jaxnet.engine.cores import cores
    from jaxnet.runs.cluster import crew

    study = load(study)
    folder = Folder(default_out(study, out))
    with folder.writing(), crew(folder.path, workers, cluster, devices or cores(), chunk) as others:
        from jaxnet.engine.batch import Machine  # takes as long as workers do, so they are called before
        from jaxnet.runs.run import Run
        from jaxnet.store.admission import admit

        admit(folder, study.config, fresh)
        with reports.reporting(progress) as report:
            work = Run(study.config, study.cells, folder, report, Machine(devices, chunk), others)
            missing = work.whole()
    return Results(folder.path, found_all=not missing)


def run_part(
    study: StudySource,
    part: int,
    parts: int,
    out: Place | None = None,
    progress: Progress = None,
    devices: int | None = None,
    chunk: int | None = None,
) -> Part:
    """Simulate every `parts`-th shard from `part` on, counted from 0, into `lanes/` of `out`.

    Any number of these may run at the same time. `run` then simulates what is missing and makes tables and
    arrays. Raises ConfigError or FolderError.
    """
    if not 0 <= part < parts:
        raise FolderError(f"there are parts 0 to {parts - 1} of {parts} (got {part})")
    enable()
    from jaxnet.engine.batch import Machine
    from jaxnet.runs.run import Run
    from jaxnet.store.admission import admit

    study = load(study)
    folder, machine = Folder(default_out(study, out)), Machine(devices, chunk)
    with folder.writing(alone=False):
        admit(folder, study.config)
        with reports.reporting(progress) as report:
            run = Run(study.config, study.cells, folder, report, machine)
            return Part(folder.path, *run.part(part, parts))


def simulate(
    study: StudySource,
    samples: SupportsInt | None = None,
    progress: Progress = None,
    devices: int | None = None,
) -> Results:
    """Simulate a study, or what `load` takes for one, in memory; `samples` are those of each cell.

    The Results have all that those of a folder have, in this process alone. What they hold is freed with
    them; tables and arrays read from them stay.

    Raises ConfigError.
    """
    study = load(study, {} if samples is None else {"samples": samples})
    results = Results(in_memory().path)
    weakref.finalize(results, Folder(results.path.parent).remove, results.path.name)
    run(study, results.path, progress=progress, devices=devices)
    return results


def in_memory() -> Folder:
    """A new folder in this process's memory."""
    return Folder(f"memory://jaxnet/{uuid.uuid4().hex}")


def field(study: StudySource, sample: SupportsInt = 0, cell: SupportsInt = 0) -> tuple[VectorField, "Array"]:
    """The vector field of one lane of a study, or of what `load` takes for one, and the state it starts from.

    `field(t, state, args)`, as diffrax takes it, is pure and jitted, in t [s] and a state (6, m), rows
    x, y, heading, speed and what else the vehicle has; `args` is ignored. Vehicles decide whom to retain at
    every evaluation, whatever `tick` is, so where a decision changes the field jumps.

    Raises ConfigError, ValueError if the study has no such lane, or if its defence or attack decides at ticks
    only, and RuntimeError if JAX does not calculate in double precision.
    """
    from jaxnet.runs.field import field

    return field(load(study), whole("cell", cell), whole("sample", sample))


def compare(first: stored.Results | Place, second: stored.Results | Place) -> "Comparison":
    """Hold the lanes of one study against those of another, paired by draws; differences are second − first.

    Raises FolderError if none can be paired.
    """
    from jaxnet.statistics.pairs import held_against

    a, b = (each if isinstance(each, stored.Results) else open(each) for each in (first, second))
    return held_against(a, b)


def sensitivity(study: StudySource, samples: SupportsInt = 1024, out: Place | None = None) -> pd.DataFrame:
    """Sobol's indices of each metric to each quantity that a study draws, cell by cell.

    First-order and total, with 95 % intervals. It takes `samples` lanes for each quantity of a
    cell, and twice as many more, and writes `sensitivity.csv` into `out` (default results/NAME), where a run
    of the study may be; cells that are there are not done again. Raises ConfigError or FolderError.
    """
    study = load(study)
    table, *_ = write_sensitivity(study, whole("samples", samples), out)
    return stored.read_table(table)


def write_sensitivity(study: Study, samples: int, out: Place | None, told: Steps = untold) -> Iterator[UPath]:
    """Write `sensitivity.csv`, and its figures; the files, one after the other."""
    enable()
    from jaxnet.explore.sensitivity import analyse
    from jaxnet.store.admission import claim
    from jaxnet.view.figures import SENSITIVITY
    from jaxnet.view.figures import every as figures

    folder = Folder(default_out(study, out))
    with folder.writing():
        claim(folder, study.config)
        yield analyse(study, folder, samples, told=told)
        yield from figures.draw(stored.Results(folder.path, folder), SENSITIVITY, told)


def rare(study: StudySource, points: SupportsInt = 1000, out: Place | None = None) -> pd.DataFrame:
    """The share of lanes that do not recover where it is very small, cell by cell, by subset simulation.

    With a 95 % t interval over ten repeats, each of so many points a level. Writes `rare.csv` into `out`
    (default results/NAME), where a run of the study may be; cells that are there are not done again. Raises
    ConfigError or FolderError.
    """
    return stored.read_table(write_rare(load(study), whole("points", points), out))


def write_rare(study: Study, points: int, out: Place | None, told: Steps = untold) -> UPath:
    """Write `rare.csv`; its path."""
    enable()
    from jaxnet.explore.rare import count_rare
    from jaxnet.store.admission import claim

    folder = Folder(default_out(study, out))
    with folder.writing():
        claim(folder, study.config)
        return count_rare(study, folder, points, told=told)


def write_comparison(found: "Comparison", out: Place) -> Iterator[UPath]:
    """Write tables and page of a comparison into a folder; the files, one after the other."""
    from jaxnet.view.page import comparison

    folder = Folder(out)
    pages = {"differences.csv": found.cells, "changed.csv": found.changed, "failed.csv": found.failed}
    for name, table in pages.items():
        yield folder.put(name, lambda file, table=table: table.to_csv(file, index=False))
    yield folder.put("compare.html", lambda file: file.write(comparison.html(found).encode()))


def write_film(
    results: stored.Results,
    cell: int,
    sample: int,
    out: Place | None = None,
    told: Steps = untold,
) -> UPath:
    """Write a film of one lane; see `Results.animate`."""
    enable()
    from jaxnet import film
    from jaxnet.runs.replay import trajectory_of
    from jaxnet.view.page.trajectories import headings

    kind = film.file_kind(None if out is None else str(out))
    place = UPath(out) if out else results.folder.path / "figures" / f"cell-{cell}-sample-{sample}{kind}"
    if out:  # then nothing is written into the folder
        results = stored.Results(results.path, in_memory())
    with results.folder.writing():
        lane, graph = trajectory_of(results, cell, sample)
        if out:
            lane = lane.load()
            results.folder.clear(["replays"])
    chosen = results.study.cells[cell]
    shown = film.film_of(lane, chosen, graph, headings(lane["states"]))
    return film.write_to(Folder(place.parent), place.name, shown, chosen, sample, told)


def write_fits(results: stored.Results, told: Steps = untold) -> Iterator[UPath]:
    """Fit, and draw what was fitted; the files, one after the other."""
    enable()
    from jaxnet.statistics import ultimate
    from jaxnet.view.figures import ULTIMATE
    from jaxnet.view.figures import every as figures

    with results.folder.writing():
        results.tell_missing("bounds that need it are")
        yield from ultimate.analyse(results, told)
        yield from figures.draw(results, ULTIMATE, told)


def write_figure(
    results: stored.Results, name: str, where: Mapping[str, Any] | None = None, column: str = "two"
) -> Iterator[UPath]:
    """Draw one of `figures.NAMES`; its files. Raises FolderError if the folder has no data for it.

    `where` and `column` choose cells and width, as in `Results.plot`.
    """
    enable()
    from jaxnet.view.figures import every as figures

    with results.folder.writing():
        _ = results.cells  # refuses an unfinished run
        drawn = getattr(figures.Plots(results), name)(where, column)
        yield from figures.save(results, figures.file_name(name, where or {}, column), drawn)


def write_report(results: stored.Results, told: Steps = untold) -> Iterator[UPath]:
    """Fit, simulate lanes again that the page shows, draw, and write it; the files, one after the other."""
    enable()
    from jaxnet.runs.watched import replay_watched
    from jaxnet.statistics import ultimate
    from jaxnet.view import page
    from jaxnet.view.figures import every as figures

    with results.folder.writing():
        _ = results.cells  # refuses an unfinished run
        results.tell_missing("lanes simulated again, and what is told of networks and bounds, are")
        if known_or(False, lambda: ultimate.asked(results)) and not results.file("fit.csv").exists():
            yield from ultimate.analyse(results, told)
        if not results.missing:
            yield from replay_watched(results, told)
        yield from figures.draw(results, told=told)
        yield page.write_page(results)


def search(
    study: StudySource,
    out: Place | None = None,
    fresh: bool = False,
    progress: Progress = None,
    devices: int | None = None,
    chunk: int | None = None,
    workers: int | None = None,
    cluster: str | None = None,
) -> Results:
    """Look for the worst choice in each cell of a study that has `search`, and simulate as many random lanes.

    These are a run of the study, and the arguments are `run`'s; workers search cells side by side. Of the
    Results, `worst` has a row for each cell and `searched` one for each generation. A search that was broken
    off goes on.

    Raises ConfigError, FolderError or ClusterError.
    """
    results = run(with_random_lanes(study), out, fresh, progress, devices, chunk, workers, cluster)
    with contextlib.nullcontext(untold) if progress is False else reports.stepping() as told:
        for _ in write_search(results, told, devices, chunk, workers, cluster):
            pass
    return results


def with_random_lanes(study: StudySource) -> Study:
    """The study with as many random lanes as its search takes; raises ConfigError if it has none."""
    study = load(study)
    if study.config.search is None:
        problem = Problem(study.config.name, "search", "is missing: search: {over: {attack.phase: each}}")
        raise ConfigError([problem])
    return load(study, {"samples": study.config.search.budget})


def write_search(
    results: stored.Results,
    told: Steps = untold,
    devices: int | None = None,
    chunk: int | None = None,
    workers: int | None = None,
    cluster: str | None = None,
) -> Iterator[UPath]:
    """Search in each cell of a study whose random lanes are there; the files, one after the other."""
    enable()
    from jaxnet.engine.cores import cores
    from jaxnet.runs.cluster import crew

    with (
        results.folder.writing(),
        crew(results.path, workers, cluster, devices or cores(), chunk) as others,
    ):
        from jaxnet.engine.batch import Machine
        from jaxnet.explore.worst import search_each

        yield from search_each(results, Machine(devices, chunk), told, others)


def default_out(study: Study, out: Place | None) -> Place:
    """Where results go."""
    return Path("results") / study.config.name if out is None else out
