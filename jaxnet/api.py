"""What a script calls: `load` a study, `run` it, `open` its results."""

from collections.abc import Callable
from pathlib import Path

from upath import UPath

from jaxnet.config.study import Study, load
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.results import Part, Results, open

__all__ = ["Part", "Results", "Study", "load", "open", "run", "run_part"]


def run(
    study: Study,
    out: str | Path | UPath | None = None,
    fresh: bool = False,
    progress: Callable[[int, int, int], None] = lambda done, total, failed: None,
    devices: int | None = None,
    chunk: int | None = None,
    workers: int | None = None,
    cluster: str | None = None,
) -> Results:
    """Simulate what is not there yet into `out`, a path or URL (default results/NAME).

    `fresh` throws earlier results of that folder away; `progress` is told lanes done, all, failed.
    `devices` are the cores, or accelerators, used at most (default all); `chunk` is how many lanes advance
    side by side (default what suits the engine; another one changes rows by rounding). `workers` parts the
    cores among so many processes (a script that asks for them must guard its `__main__`), `cluster` is the
    address of a dask scheduler whose workers see the same folder.

    Raises FolderError or ClusterError.
    """
    from jaxnet.engine.cores import cores
    from jaxnet.runs.cluster import crew

    folder = Folder(default_out(study, out))
    with folder.writing(), crew(folder.path, workers, cluster, devices or cores(), chunk) as others:
        from jaxnet.engine.batch import Machine  # takes as long as workers do, so they are called before
        from jaxnet.runs.run import Run
        from jaxnet.store.admission import admit

        admit(folder, study.config, fresh)
        Run(study.config, study.cells, folder, progress, Machine(devices, chunk), others).whole()
    return Results(folder.path)


def run_part(
    study: Study,
    part: int,
    parts: int,
    out: str | Path | UPath | None = None,
    progress: Callable[[int, int, int], None] = lambda done, total, failed: None,
    devices: int | None = None,
    chunk: int | None = None,
) -> Part:
    """Simulate every `parts`-th shard from `part` on, counted from 0, into `lanes/` of `out`.

    Any number of these may run at the same time. `run` then simulates what is missing and makes tables and
    arrays. Raises FolderError.
    """
    from jaxnet.engine.batch import Machine
    from jaxnet.runs.run import Run
    from jaxnet.store.admission import admit

    if not 0 <= part < parts:
        raise FolderError(f"there are parts 0 to {parts - 1} of {parts} (got {part})")
    folder, machine = Folder(default_out(study, out)), Machine(devices, chunk)
    with folder.writing(alone=False):
        admit(folder, study.config)
        run = Run(study.config, study.cells, folder, progress, machine)
        return Part(folder.path, *run.part(part, parts))


def default_out(study: Study, out: str | Path | UPath | None) -> str | Path | UPath:
    """Where results go."""
    return Path("results") / study.config.name if out is None else out
