"""Commands on results: tables, fits, the report, its figures, two studies held against each other."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

import jaxnet
from jaxnet.cli.echo import echo
from jaxnet.cli.errors import user_errors
from jaxnet.lazy import LazyModule
from jaxnet.view.figures import COLUMN_WIDTHS, FIGURE_NAMES, HEAT

if TYPE_CHECKING:
    import webbrowser

    from upath import UPath

    from jaxnet.api import writing
    from jaxnet.store import folder as storage
    from jaxnet.view import columns as summary
    from jaxnet.view.text import (
        analyses,
        comparison,
        folders,
        formats,
        progress,
        slopes,
        tables,
        width,
    )
else:
    analyses = LazyModule("jaxnet.view.text.analyses")
    comparison = LazyModule("jaxnet.view.text.comparison")
    folders = LazyModule("jaxnet.view.text.folders")
    formats = LazyModule("jaxnet.view.text.formats")
    progress = LazyModule("jaxnet.view.text.progress")
    slopes = LazyModule("jaxnet.view.text.slopes")
    summary = LazyModule("jaxnet.view.columns")
    storage = LazyModule("jaxnet.store.folder")
    tables = LazyModule("jaxnet.view.text.tables")
    width = LazyModule("jaxnet.view.text.width")
    webbrowser = LazyModule("webbrowser")
    writing = LazyModule("jaxnet.api.writing")

F = TypeVar("F", bound=Callable[..., object])
AXES_OF = {"curve": ("x", "y", "hue", "panel"), **dict.fromkeys(HEAT, ("x", "hue", "panel"))}
FORMATS = ("text", "csv", "markdown", "latex")

results_argument = click.argument(
    "results", type=click.Path()
)  # a path or URL; shells complete paths
out_option = click.option(
    "--out", metavar="DIR", type=click.Path(), help="Where to write, if not into RESULTS."
)


def takes_code(command: F) -> F:
    """Add the options that say which code of kinds from outside may run."""
    for option in (
        click.option(
            "--config",
            type=click.Path(path_type=Path),
            help="The study's config, or its folder: kinds are loaded from the modules beside it.",
        ),
        click.option(
            "--trust",
            is_flag=True,
            help="Load the kinds from where RESULTS says that their modules are.",
        ),
    ):
        command = option(command)
    return command


format_option = click.option(
    "--format",
    "form",
    type=click.Choice(FORMATS),
    default="text",
    show_default=True,
    help="csv has all digits, the others four.",
)


where_option = click.option(
    "--where",
    metavar="KEY=VALUE",
    multiple=True,
    help="Only cells with this value of a swept key; the same key again: or this one.",
)


@click.command()
@results_argument
@format_option
@click.option(
    "--columns",
    metavar="A,B,…",
    help="Columns of cells.csv to show.  [default: what is asked first]",
)
@click.option("--sort", metavar="COLUMN", help="Column to sort by; -COLUMN: the greatest first.")
@where_option
@click.option("--pivot", metavar="KEY", help="Swept key whose values stand across.")
@click.option("--all", "whole", is_flag=True, help="All rows, on a terminal too.")
def show(
    results: str,
    form: str,
    columns: str | None,
    sort: str | None,
    where: tuple[str, ...],
    pivot: str | None,
    whole: bool,
) -> None:
    """Print the summary table again, a line per cell, and what search, sensitivity and rare found.

    As text it is as wide as the terminal, and says what it leaves out. On a terminal it has 60 rows at most
    without --all. The other formats have all of it. A column that is the same in all cells is one line of
    text.
    """
    names = columns.split(",") if columns else ()
    with user_errors():
        opened = jaxnet.open(results)
        chosen = names, wanted(where), sort, pivot
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


@click.command("list")
@click.argument("folder", default="results", type=click.Path())
def list_results(folder: str) -> None:
    """List the results folders at or below FOLDER (default: results).

    A line each: cells, lanes, how many of them are ok and failed, whether the run is finished, and when it
    was written.
    """
    with user_errors():
        if lines := folders.folders_text(folder):
            echo(lines)
        else:
            echo(f"no results in {folder}", err=True)


@click.command()
@results_argument
@out_option
@takes_code
def fit(results: str, out: str | None, trust: bool, config: Path | None) -> None:
    """Fit the ultimate error against the attack's magnitude, beside the bounds of theory.

    Writes fit.csv, bounds.csv and violations.csv, and prints what they come to.
    """
    with user_errors():
        opened = jaxnet.open(results, out, trust, config)
        with progress.report_steps() as told:
            for path in writing.write_fits(opened, told):
                echo(f"wrote {path}", err=True)
        echo(slopes.fit_text(opened))


@click.command()
@results_argument
@out_option
@click.option("--open", "shown", is_flag=True, help="Open the page in the browser.")
@click.option(
    "--no-replay",
    is_flag=True,
    help="Simulate no lane again: the page shows stored trajectories alone.",
)
@takes_code
def report(
    results: str, out: str | None, shown: bool, no_replay: bool, trust: bool, config: Path | None
) -> None:
    """Write report.html, a page that works offline, and its figures as PNG and PDF.

    Fits what is not fitted yet, and simulates lanes again that the page shows: the median and the worst of a
    dozen cells at most, and the worst of the study if it has `recovery`. Most of the time goes into these
    lanes; --no-replay leaves them out.
    """
    with user_errors():
        opened = jaxnet.open(results, out, trust, config)
        with progress.report_steps() as told:
            for path in writing.write_report(opened, told, not no_replay):
                echo(f"wrote {path}", err=True)
        if shown:
            show_page(opened.folder.path / "report.html")


def show_page(page: "UPath") -> None:
    """Open a page in the browser, or print that there is no browser."""
    if not webbrowser.open(page.absolute().as_uri()):
        echo(f"no browser opens {page}", err=True)


@click.command("figure")
@results_argument
@click.argument("name", metavar="NAME", type=click.Choice(FIGURE_NAMES))
@where_option
@click.option("--x", metavar="KEY", help="Swept key across.  [default: the key of most numbers]")
@click.option(
    "--y", metavar="NAME", help="Metric or share of curve.  [default: what the study asks for]"
)
@click.option("--hue", metavar="KEY", help="Swept key in colours; of a heat map, down.")
@click.option(
    "--panel", metavar="KEY", multiple=True, help="Swept key with a panel a value; repeatable."
)
@click.option(
    "--column",
    type=click.Choice(list(COLUMN_WIDTHS)),
    default="two",
    show_default=True,
    help="Columns of a journal that it is as wide as: 3.5 or 7.16 in.",
)
@click.option(
    "--plain",
    is_flag=True,
    help="In matplotlib's own style (matplotlibrc), not in that for print.",
)
@click.option(
    "--no-note", is_flag=True, help="Without the small line at the top: a caption says it."
)
@out_option
@takes_code
def figure_command(
    results: str,
    name: str,
    where: tuple[str, ...],
    column: str,
    plain: bool,
    no_note: bool,
    out: str | None,
    trust: bool,
    config: Path | None,
    panel: tuple[str, ...],
    **axes: str | None,
) -> None:
    """Write the figure NAME, as PNG and PDF, into figures/ of RESULTS.

    \b
    curve       a metric or share with its interval against a swept key
    heat        the share of lanes unrecovered over two swept keys
    heat_worst  the greatest error over two swept keys
    ultimate, ultimate_mean              the error over the tail against ā
    tails, bands, panels                 lanes by cell; errors over time; trajectories
    vehicles                             the error of each vehicle over the tail
    topologies                           graphs with weights and attacked links
    search, search_worst                 of jaxnet search
    sensitivity, sensitivity_unrecovered of jaxnet sensitivity

    The first three take --x, --hue and --panel; curve takes --y too. A choice of cells, axes or width is
    part of the files' names.
    """  # noqa: D301
    chosen: dict[str, object] = {key: value for key, value in axes.items() if value}
    chosen |= {"panel": list(panel)} if panel else {}
    if unknown := sorted(set(chosen) - set(AXES_OF.get(name, ()))):
        raise click.UsageError(f"{name} takes no --{unknown[0]}")
    with user_errors():
        opened = jaxnet.open(results, out, trust, config)
        for path in writing.write_figure(
            opened, name, wanted(where), column, chosen, plain, not no_note
        ):
            echo(f"wrote {path}", err=True)


def wanted(words: tuple[str, ...]) -> dict[str, list[str]]:
    """Return the values of each swept key from words KEY=VALUE."""
    found: dict[str, list[str]] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals:
            raise click.BadParameter(f"KEY=VALUE (got {word})", param_hint="--where")
        found.setdefault(key, []).append(value)
    return found


@click.command("compare")
@click.argument("a", type=click.Path())
@click.argument("b", type=click.Path())
@format_option
@click.option(
    "--out", metavar="DIR", type=click.Path(), help="Where to write.  [default: A-B beside B]"
)
def compare_command(a: str, b: str, form: str, out: str | None) -> None:
    """Hold the lanes of results B against those of A, paired by their draws.

    Prints what differs between the studies, then B − A cell by cell: the tail errors, and the share of lanes
    unrecovered with those that changed sides. Writes compare.html, differences.csv, changed.csv and
    failed.csv.
    """
    with user_errors():
        found = jaxnet.compare(a, b)
        for path in writing.write_comparison(
            found, out or neighbour_of(b, f"{Path(a).name}-{Path(b).name}")
        ):
            echo(f"wrote {path}", err=True)
        if form == "text":
            echo(comparison.comparison_text(found))
        else:
            echo(formats.in_format(formats.columns_of(comparison.comparison_rows(found)), form))


def neighbour_of(folder: str, name: str) -> "UPath":
    """Return the path of this name beside a folder."""
    return storage.place(folder).parent / name


@click.command()
@results_argument
@click.option(
    "--mat",
    is_flag=False,
    flag_value="",
    help="A file for MATLAB.  [default: results.mat in RESULTS]",
)
@click.option(
    "--csv",
    metavar="DIR",
    is_flag=False,
    flag_value="",
    help="A folder of CSV files of the trajectories.  [default: csv in RESULTS]",
)
def export(results: str, mat: str | None, csv: str | None) -> None:
    """Write results for other programs: --mat [FILE] for MATLAB and Octave, --csv [DIR] for R and Excel.

    The file for MATLAB has a structure of columns for the lanes and one for the cells, what is swept, and
    errors and trajectories where they are stored. CSV has a file for each stored trajectory, with a row for
    each time and vehicle. Everything else is readable as it is: CSV, Parquet and Zarr.
    """
    chosen = {form: out for form, out in (("mat", mat), ("csv", csv)) if out is not None}
    if not chosen:
        raise click.UsageError("say for which program: --mat or --csv")
    with user_errors():
        opened = jaxnet.open(results)
        for form, out in chosen.items():
            echo(f"wrote {opened.export(out or None, form)}", err=True)
