"""What commands do that simulate or show results: for the most part, print what the API returns."""

import sys
import webbrowser
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click

import jaxnet
from jaxnet.api.places import with_random_lanes
from jaxnet.api.results import writing
from jaxnet.cli.errors import echo
from jaxnet.config.cells import judged_metric
from jaxnet.lazy import LazyModule
from jaxnet.store import folder as storage
from jaxnet.store.tables import read_table
from jaxnet.view import columns as summary
from jaxnet.view.text import analyses, comparison, formats, progress, slopes, tables, width, worst

indices_of = LazyModule("jaxnet.explore.sensitivity")

FAILED_LANES = 3


def tell_written(paths: Iterable[object]) -> None:
    for path in paths:
        echo(f"wrote {path}", err=True)


def simulate_study(
    config: Path,
    overrides: tuple[str, ...],
    out: str | None,
    fresh: bool,
    strict: bool,
    shard: tuple[int, int] | None,
    **machines: Any,
) -> None:
    study = jaxnet.load(config, overrides)
    if shard is not None:
        part = jaxnet.run_part(study, *shard, out, True, machines["devices"], machines["chunk"])
        failed = part.failed
        echo(tables.part_text(part), err=True)
    else:
        results = jaxnet.run(study, out, fresh, True, **machines)
        failed = results.manifest["lanes"]["failed"]
        echo(tables.summary_text(results))
        echo(tables.outcome_text(results, results.found_all), err=True)
    if failed and strict:
        sys.exit(FAILED_LANES)


def search_study(
    config: Path, overrides: tuple[str, ...], out: str | None, fresh: bool, **machines: Any
) -> None:
    study = with_random_lanes(jaxnet.load(config, overrides))
    results = jaxnet.run(study, out, fresh, True, **machines)
    with progress.report_steps() as told:
        files = list(writing.write_search(results, told, **machines))
    echo(worst.search_text(results))
    tell_written(files)


def tell_sensitivity(
    config: Path, overrides: tuple[str, ...], metric: str | None, samples: int, out: str | None
) -> None:
    study = jaxnet.load(config, overrides)
    known = [each.name for each in study.config.measured()]
    known += ["unrecovered"] if study.config.recovery else []
    metric = metric or judged_metric(study.cells)
    if metric not in known:
        told = f"one of {', '.join(known)} (got {metric})"
        raise click.BadParameter(told, param_hint="--metric")
    echo(analyses.plan_text(indices_of.lanes_needed(study, samples), samples), err=True)
    with progress.report_steps() as told:
        written = list(writing.write_sensitivity(study, samples, out, told))
    echo(analyses.indices_text(read_table(written[0]), study, metric))
    tell_written(written)


def tell_rare(config: Path, overrides: tuple[str, ...], points: int, out: str | None) -> None:
    study = jaxnet.load(config, overrides)
    with progress.report_steps() as told:
        written = writing.write_rare(study, points, out, told)
    echo(analyses.rare_text(read_table(written)))
    tell_written([written])


def print_summary(
    results: str,
    form: str,
    columns: str | None,
    sort: str | None,
    where: dict[str, list[str]],
    pivot: str | None,
    whole: bool,
) -> None:
    opened = jaxnet.open(results)
    chosen = columns.split(",") if columns else (), where, sort, pivot
    if form == "text":
        most = None if whole or not sys.stdout.isatty() else width.MOST_ROWS
        table = tables.summary_text(opened, *chosen, most) if opened.has_run else ""
        echo("\n\n".join(filter(None, [table, analyses.analyses_text(opened)])))
    elif opened.has_run:
        asked = tables.asked_columns(opened, *chosen)
        notes = [*tables.summary_notes(opened, asked), tables.setting_note(opened)]
        echo(formats.in_format(summary.pivoted(asked, pivot) if pivot else asked, form, notes))
    else:
        found = [getattr(opened, name) for name in opened.analyses]
        echo("\n\n".join(formats.in_format(formats.columns_of(each), form) for each in found))


def fit_results(results: str, out: str | None, **code: Any) -> None:
    opened = jaxnet.open(results, out, **code)
    with progress.report_steps() as told:
        tell_written(writing.write_fits(opened, told))
    echo(slopes.fit_text(opened))


def report_results(
    results: str, out: str | None, shown: bool, no_replay: bool, **code: Any
) -> None:
    opened = jaxnet.open(results, out, **code)
    with progress.report_steps() as told:
        tell_written(writing.write_report(opened, told, not no_replay))
    page = opened.folder.path / "report.html"
    if shown and not webbrowser.open(page.absolute().as_uri()):
        echo(f"no browser opens {page}", err=True)


def draw_figure(
    results: str,
    name: str,
    where: dict[str, list[str]],
    axes: dict[str, object],
    column: str,
    plain: bool,
    no_note: bool,
    out: str | None,
    **code: Any,
) -> None:
    opened = jaxnet.open(results, out, **code)
    tell_written(writing.write_figure(opened, name, where, column, axes, plain, not no_note))


def replay_lane(
    results: str, cell: int, sample: int, engine: str | None, out: str | None, **code: Any
) -> None:
    opened = jaxnet.open(results, out, **code)
    again = opened.replay(cell, sample, engine)
    echo(tables.lane_text(opened, again.row))
    tell_written([again.path])


def film_lane(results: str, cell: int, sample: int, out: str | None, **code: Any) -> None:
    opened = jaxnet.open(results, **code)
    with progress.report_steps() as told:
        path = writing.write_film(opened, cell, sample, out, told)
    tell_written([path])


def compare_results(a: str, b: str, form: str, out: str | None) -> None:
    found = jaxnet.compare(a, b)
    beside = storage.place(b).parent / f"{Path(a).name}-{Path(b).name}"
    tell_written(writing.write_comparison(found, out or beside))
    if form == "text":
        echo(comparison.comparison_text(found))
    else:
        echo(formats.in_format(comparison.comparison_columns(found), form))
