"""What the command line writes. A function yields the path of each file once the file is whole.

All that is heavy is imported here: `jaxnet.api.results` and the commands import this module late.
"""

import warnings
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import xarray as xr
from upath import UPath

from jaxnet import film, viewer
from jaxnet.api.results import AnyPath
from jaxnet.api.studies import folder_of, in_memory
from jaxnet.config.study import Study
from jaxnet.engine import batch
from jaxnet.engine.cores import cores
from jaxnet.explore import rare, sensitivity, worst
from jaxnet.model.graph import Digraph
from jaxnet.runs import replay, watched
from jaxnet.runs.cache import enable
from jaxnet.runs.cluster import executor
from jaxnet.statistics import fits, pairs
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.store import arena
from jaxnet.store.admission import claim
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results
from jaxnet.store.tables import csv_text
from jaxnet.view import page
from jaxnet.view.drawings.scene import scene_of
from jaxnet.view.figures import SENSITIVITY, ULTIMATE
from jaxnet.view.figures import every as figures
from jaxnet.view.page import comparison


def write_sensitivity(
    study: Study, samples: int, out: AnyPath | None, told: Steps = no_progress
) -> Iterator[UPath]:
    """Write `sensitivity.csv` and its figures."""
    enable()
    folder = folder_of(study, out)
    with folder.writing():
        claim(folder, study.config)
        yield sensitivity.write_indices(study, folder, samples, told)
        yield from figures.draw_figures(Results(folder.path, folder), SENSITIVITY, told)


def write_rare(study: Study, points: int, out: AnyPath | None, told: Steps = no_progress) -> UPath:
    """Write `rare.csv` and return its path."""
    enable()
    folder = folder_of(study, out)
    with folder.writing():
        claim(folder, study.config)
        return rare.count_rare(study, folder, points, told)


def write_comparison(found: pairs.Comparison, out: AnyPath) -> Iterator[UPath]:
    """Write the tables and the page of a comparison into a folder."""
    folder = Folder(out)
    tables = {"differences": found.cells, "changed": found.changed, "failed": found.failed}
    for name, table in tables.items():
        yield folder.put(f"{name}.csv", csv_text(table).encode())
    yield folder.put("compare.html", comparison.comparison_page(found).encode())


def write_film(
    results: Results, cell: int, sample: int, out: AnyPath | None = None, told: Steps = no_progress
) -> UPath:
    """Write a film of one lane and return its path; see `Results.animate`."""
    enable()
    file = UPath(out) if out and UPath(out).suffix else None  # else a folder, or none given
    kind = film.film_format(str(file) if file else None)
    folder = UPath(out) if out else results.folder.path / "figures"
    place = file or folder / f"cell-{cell}-sample-{sample}{kind}"
    lane, graph = shown_lane(results, cell, sample, kept=not out)
    chosen = results.study.cells[cell]
    shown = film.film_of(lane, chosen, graph)
    return film.save_film(Folder(place.parent), place.name, shown, chosen, sample, told)


def shown_lane(results: Results, cell: int, sample: int, kept: bool) -> tuple[xr.Dataset, Digraph]:
    """Trajectory and graph of a lane; `kept`: a lane simulated again stays in the folder."""
    if not kept:
        results = Results(results.path, in_memory(), results.trust, results.config)
    with results.folder.writing():
        lane, graph = replay.trajectory_of(results, cell, sample)
        if not kept:
            lane = lane.load()
            results.folder.remove("replays")
    return lane, graph


def write_robotarium(results: Results, cell: int, sample: int, out: AnyPath) -> list[UPath]:
    """Write the script for the arena with the loop of one lane, and the lane's poses."""
    enable()
    replay.refuse_unknown(results, cell, sample)
    chosen = results.study.cells[cell]
    arena.refuse_unable(chosen, out)
    lane, _ = shown_lane(results, cell, sample, kept=False)
    return arena.write_script(results.study.config, chosen, sample, lane, out)


def write_view(
    results: Results, cell: int, sample: int, save: AnyPath | None, told: Steps = no_progress
) -> UPath | None:
    """Open the viewer rerun with one lane, or write a recording for it and return its path."""
    enable()
    if save is not None and UPath(save).suffix != ".rrd":
        raise FolderError(f"save: a recording ends in .rrd (got {save})")
    viewer.load_rerun()
    lane, graph = shown_lane(results, cell, sample, kept=False)
    config, chosen = results.study.config, results.study.cells[cell]
    scene = scene_of(lane, chosen, graph)
    title = f"{config.name}, cell {cell}, sample {sample}"
    return viewer.show_lane(title, scene, None if save is None else UPath(save), told)


def write_fits(results: Results, told: Steps = no_progress) -> Iterator[UPath]:
    """Write fits, bounds and violations of the ultimate error, and their figures."""
    enable()
    with results.folder.writing():
        results.tell_missing("bounds that need it are")
        yield from fits.write_ultimate_error(results, told)
        yield from figures.draw_figures(results, ULTIMATE, told)


def write_figure(
    results: Results,
    name: str,
    where: Mapping[str, list[str]] | None = None,
    column: str = "two",
    chosen: Mapping[str, object] | None = None,
    plain: bool = False,
    note: bool = True,
) -> Iterator[UPath]:
    """Write one of the figures in `view.figures.FIGURE_NAMES`.

    `where` selects cells, `column` a width, `plain` matplotlib's own style, `note` the small
    lines below, and `chosen` has the further arguments of `Results.figure`. Raises FolderError if
    the folder has no data for the figure.
    """
    enable()
    chosen = chosen or {}
    look: Any = {"column": column, "note": note, **chosen}
    draw = partial(figures.draw_figure, results, name, where, plain)
    drawn, size = draw(**look), look.get("size")
    if told := figures.room_words(drawn, size, lambda size: draw(**look | {"size": size})):
        warnings.warn(f"{name}: {told}", stacklevel=2)
    file = figures.file_name(name, where or {}, column, chosen, plain, note, results.study.cells)
    with results.folder.writing():
        yield from figures.save_figure(results, file, drawn)


def write_report(
    results: Results, told: Steps = no_progress, replayed: bool = True
) -> Iterator[UPath]:
    """Write missing fits, the trajectories that the page shows, the figures, and the page at last.

    Without `replayed` no lane is simulated again; the page shows the lanes whose trajectories are
    stored.
    """
    enable()
    with results.folder.writing():
        if results.analyses and not results.has_run:
            yield from figures.draw_figures(results, SENSITIVITY, told)
            yield page.write_page(results)
            return
        _ = results.cells  # refuses an unfinished run
        results.tell_missing("lanes simulated again, and what is told of networks and bounds, are")
        fitted = known_or(False, lambda: fits.has_fixed_magnitude(results))
        if fitted and not results.file("fit.csv").exists():
            yield from fits.write_ultimate_error(results, told)
        if replayed and not results.missing:
            yield from watched.replay_watched(results, told)
        yield from figures.draw_figures(results, told=told)
        yield page.write_page(results)


def write_search(
    results: Results,
    told: Steps = no_progress,
    devices: int | None = None,
    chunk: int | None = None,
    workers: int | None = None,
    cluster: str | None = None,
) -> Iterator[UPath]:
    """Search for the worst choice in each cell of a study whose random lanes are in the folder."""
    enable()
    with (
        results.folder.writing(),
        executor(results.path, workers, cluster, devices or cores(), chunk) as others,
    ):  # `worst` takes long to import; the workers start meanwhile
        yield from worst.search_each(results, batch.Machine(devices, chunk), told, others)
