"""The command line: what each command is called, takes and says in its help.

Help appears at once, since what the commands do stands in `studies` and `results`, which import JAX
and pandas, and are imported when a command runs.
"""

import atexit
import functools
import gc
import io
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from jaxnet.lazy import LazyModule
from jaxnet.runs import cache
from jaxnet.version import __version__
from jaxnet.view.figures import COLUMN_WIDTHS, FIGURE_NAMES, HEAT

errors = LazyModule("jaxnet.cli.errors")
results = LazyModule("jaxnet.cli.results")
studies = LazyModule("jaxnet.cli.studies")

C = TypeVar("C", bound=Callable[..., object])
SECTIONS: dict[str, list[click.Command]] = {
    "A study": [],
    "Its results": [],
    "One lane": [],
    "Further": [],
}
A_STUDY, ITS_RESULTS, ONE_LANE, FURTHER = SECTIONS
FORMATS = ("text", "csv", "markdown", "latex")
AXES_OF = {"curve": ("x", "y", "hue", "panel"), **dict.fromkeys(HEAT, ("x", "hue", "panel"))}


class Sections(click.Group):
    """Commands, listed in the order in which they are used."""

    def main(self, *args: Any, **keys: Any) -> Any:
        """Run a command with output streams that take what it writes."""
        prepare_streams()
        return super().main(*args, **keys)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a section of help for each group of commands."""
        for title, commands in SECTIONS.items():
            with formatter.section(title):
                rows = [(str(each.name), each.get_short_help_str(200)) for each in commands]
                formatter.write_dl(rows)


@click.group(cls=Sections, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="jaxnet")
def main() -> None:
    """Monte Carlo attack studies on networks of two-wheeled robots.

    A study is a YAML file; its first line is the command that runs it. Try `jaxnet check
    configs/quick.yaml`, then `jaxnet run configs/quick.yaml`.
    """
    gc.set_threshold(300_000)  # imports and traces make millions of objects that stay
    atexit.register(gc.freeze)  # the last collection need not look through them


def prepare_streams() -> None:
    """Have a terminal without our characters show others.

    Exits with status 2 without a standard output, or with too little memory for any command.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    if sys.stdout is None:
        click.echo("standard output is closed: give it a file, as > /dev/null", err=True)
        sys.exit(2)
    try:
        cache.refuse_low_limit(cache.OF_CHECKS)
    except MemoryError as error:
        click.echo(f"out of memory: {error}", err=True)
        sys.exit(2)


def command(section: str, name: str | None = None) -> Callable[[Callable[..., object]], Any]:
    """Add a command to a section; its errors end in plain messages."""

    def decorate(function: Callable[..., object]) -> click.Command:
        @functools.wraps(function)
        def guarded(**given: object) -> None:
            with errors.unforeseen(), errors.user_errors():
                function(**given)

        guarded.__dict__["__click_params__"] = getattr(function, "__click_params__", [])
        made = click.command(name or function.__name__)(guarded)
        SECTIONS[section].append(made)
        main.add_command(made)
        return made

    return decorate


# --- arguments and options ------------------------------------------------------------------------


def together(*parameters: Callable[[Any], Any]) -> Callable[[C], C]:
    """Make one decorator of several parameters."""

    def decorate(function: C) -> C:
        for parameter in reversed(parameters):
            function = parameter(function)
        return function

    return decorate


class ShardOf(click.ParamType):
    """`i/n`: shards i, i + n, i + 2n, … counted from 0."""

    name = "i/n"

    def convert(
        self, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Return the numbers i and n."""
        match = re.fullmatch(r"(\d+)/(\d+)", value)
        if not match or int(match[1]) >= int(match[2]):
            self.fail(f"{value} is none of 0/n, 1/n, … up to n-1/n", param, ctx)
        return int(match[1]), int(match[2])


def flag(*names: str, told: str) -> Callable[[C], C]:
    return click.option(*names, is_flag=True, help=told)


def text(name: str, metavar: str, told: str, **more: Any) -> Callable[[C], C]:
    return click.option(name, metavar=metavar, help=told, **more)


def number(name: str, least: int, told: str, **more: Any) -> Callable[[C], C]:
    return click.option(name, type=click.IntRange(least), help=told, **more)


def out_of(told: str) -> Callable[[C], C]:
    return text("--out", "DIR", told, type=click.Path())


def chosen_cells(words: tuple[str, ...]) -> dict[str, list[str]]:
    """Return the values of each swept key from words KEY=VALUE."""
    found: dict[str, list[str]] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals:
            raise click.BadParameter(f"KEY=VALUE (got {word})", param_hint="--where")
        found.setdefault(key, []).append(value)
    return found


config_words = together(
    click.argument("config", type=click.Path(path_type=Path)),
    click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]..."),
)
fresh = flag("--fresh", told="Throw away what the folder holds of earlier results.")
machines = together(
    number("--devices", 1, "Cores, or accelerators, to use.  [default: all]"),
    number(
        "--chunk",
        1,
        "Lanes advanced side by side; changes rows by rounding.  [default: what suits the engine]",
    ),
    number("--workers", 1, "Processes to part the cores among."),
    text("--cluster", "tcp://…", "A dask scheduler whose workers see the results folder."),
)
results_argument = click.argument("results", type=click.Path())  # or a URL
elsewhere = out_of("Where to write, if not into RESULTS.")
code = together(
    flag("--trust", told="Load the kinds from where RESULTS says that their modules are."),
    click.option(
        "--config",
        type=click.Path(path_type=Path),
        help="The study's config, or its folder: kinds are loaded from the modules beside it.",
    ),
)
lane = together(
    results_argument,
    number("--cell", 0, "Number of the cell, from 0.", required=True),
    number("--sample", 0, "Number of the draw, from 0.", required=True),
)
form = click.option(
    "--format",
    "form",
    type=click.Choice(FORMATS),
    default="text",
    show_default=True,
    help="csv has all digits, the others four.",
)
where_option = text(
    "--where",
    "KEY=VALUE",
    "Only cells with this value of a swept key; the same key again: or this one.",
    multiple=True,
)


# --- a study --------------------------------------------------------------------------------------


@command(A_STUDY)
@click.argument("file", default="study.yaml", type=click.Path(path_type=Path))
def init(**given: Any) -> None:
    """Write a first config, with comments, to be changed in an editor.

    FILE (default: study.yaml) must not be there yet; the study takes its name.
    """
    studies.write_starter(**given)


@command(A_STUDY)
@config_words
@click.option("--cell", type=click.IntRange(0), help="Tell all of this cell alone.")
def check(**given: Any) -> None:
    """Validate a config; print its cells and what is known of them before anything moves."""
    studies.check_study(**given)


@command(A_STUDY, "run")
@config_words
@out_of("Results folder, or a URL like s3://bucket/study.  [default: results/NAME]")
@fresh
@flag("--strict", told="Exit with status 3 if any lane failed.")
@machines
@click.option(
    "--shard",
    type=ShardOf(),
    help="Only every n-th shard, from the i-th on, counted from 0; for job arrays. The same command"
    " without it simulates what is missing, and makes the tables.",
)
def run_command(shard: tuple[int, int] | None, **given: Any) -> None:
    """Simulate a study; an unfinished run of it is resumed.

    KEY=VALUE overrides a key of CONFIG by its dotted name, the value in YAML:
    attack.magnitude=10 samples=100 'sweep.attack.magnitude={geomspace: [0.1, 100, 12]}'
    """
    if shard and any(given[name] for name in ("fresh", "workers", "cluster")):
        raise click.UsageError("--shard goes with neither --fresh nor --workers nor --cluster")
    results.simulate_study(shard=shard, **given)


@command(A_STUDY, "search")
@config_words
@out_of("Results folder or URL.  [default: results/NAME]")
@fresh
@machines
def search_command(**given: Any) -> None:
    """Look for the worst that `search.over` lets an attacker choose, beside as many random lanes.

    The lanes are a run of the study; a search that was broken off goes on, and workers search cells
    side by side. The best choice of each cell is tried from 10,000 other starts and by the
    nonlinear engine, and written as a study of its own.
    """
    results.search_study(**given)


@command(A_STUDY, "schema")
def schema_command() -> None:
    """Print the config's JSON schema, for editors."""
    studies.print_schema()


# --- its results ----------------------------------------------------------------------------------


@command(ITS_RESULTS, "list")
@click.argument("folder", default="results", type=click.Path())
def list_results(**given: Any) -> None:
    """List the results folders at or below FOLDER (default: results).

    A line each: cells, lanes, how many of them are ok and failed, whether the run is finished, and
    when it was written.
    """
    studies.print_folders(**given)


@command(ITS_RESULTS)
@results_argument
@form
@text("--columns", "A,B,…", "Columns of cells.csv to show.  [default: what is asked first]")
@text("--sort", "COLUMN", "Column to sort by; -COLUMN: the greatest first.")
@where_option
@text("--pivot", "KEY", "Swept key whose values stand across.")
@flag("--all", "whole", told="All rows, on a terminal too.")
def show(where: tuple[str, ...], **given: Any) -> None:
    """Print the summary table again, a line per cell, and what search, sensitivity and rare found.

    As text it is as wide as the terminal, and says what it leaves out. On a terminal it has 60 rows
    at most without --all. The other formats have all of it. A column that is the same in all cells
    is one line of text.
    """
    results.print_summary(where=chosen_cells(where), **given)


@command(ITS_RESULTS)
@results_argument
@elsewhere
@code
def fit(**given: Any) -> None:
    """Fit the ultimate error against the attack's magnitude, beside the bounds of theory.

    Writes fit.csv, bounds.csv and violations.csv, and prints what they come to.
    """
    results.fit_results(**given)


@command(ITS_RESULTS)
@results_argument
@elsewhere
@flag("--open", "shown", told="Open the page in the browser.")
@flag("--no-replay", told="Simulate no lane again: the page shows stored trajectories alone.")
@code
def report(**given: Any) -> None:
    """Write report.html, a page that works offline, and its figures as PNG and PDF.

    Fits what is not fitted yet, and simulates lanes again that the page shows: the median and the
    worst of a dozen cells at most, and the worst of the study if it has `recovery`. Most of the
    time goes into these lanes; --no-replay leaves them out.
    """
    results.report_results(**given)


@command(ITS_RESULTS, "figure")
@results_argument
@click.argument("name", metavar="NAME", type=click.Choice(FIGURE_NAMES))
@where_option
@text("--x", "KEY", "Swept key across.  [default: the key of most numbers]")
@text("--y", "NAME", "Metric or share of curve.  [default: what the study asks for]")
@text("--hue", "KEY", "Swept key in colours; of a heat map, down.")
@text("--panel", "KEY", "Swept key with a panel a value; repeatable.", multiple=True)
@click.option(
    "--column",
    type=click.Choice(list(COLUMN_WIDTHS)),
    default="two",
    show_default=True,
    help="Columns of a journal that it is as wide as: 3.5 or 7.16 in.",
)
@flag("--plain", told="In matplotlib's own style (matplotlibrc), not in that for print.")
@flag("--no-note", told="Without the small line at the top: a caption says it.")
@elsewhere
@code
def figure_command(name: str, where: tuple[str, ...], **given: Any) -> None:
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

    The first three take --x, --hue and --panel; curve takes --y too. A choice of cells, axes or
    width is part of the files' names.
    """  # noqa: D301
    axes = {key: given.pop(key) for key in ("x", "y", "hue", "panel")}
    axes = {key: list(each) if key == "panel" else each for key, each in axes.items() if each}
    if unknown := sorted({*axes} - {*AXES_OF.get(name, ())}):
        raise click.UsageError(f"{name} takes no --{unknown[0]}")
    results.draw_figure(name=name, where=chosen_cells(where), axes=axes, **given)


# --- one lane -------------------------------------------------------------------------------------


@command(ONE_LANE, "replay")
@lane
@text("--engine", "NAME", "exact, nonlinear or stacked.  [default: the study's own]")
@elsewhere
@code
def replay_command(**given: Any) -> None:
    """Simulate one lane again, with its full trajectory."""
    results.replay_lane(**given)


@command(ONE_LANE)
@lane
@text("--out", "FILE", "Ends in .mp4 (needs ffmpeg) or .gif.  [default: into figures/]")
@code
def animate(**given: Any) -> None:
    """Write a film of one lane: who hears whom, what attacked vehicles tell, and the errors.

    It is an MP4 where ffmpeg is found, else a GIF. A lane whose trajectory is not there is
    simulated again.
    """
    results.film_lane(**given)


# --- further --------------------------------------------------------------------------------------


@command(FURTHER, "sensitivity")
@config_words
@click.option(
    "--metric",
    help="Of which to print; the file has all of them.  [default: tail_mean; spread without a"
    " navigator]",
)
@number(
    "--samples",
    30,
    "Lanes of a cell for each quantity drawn; twice as many come on top.",
    default=1024,
    show_default=True,
)
@out_of("Results folder.  [default: results/NAME]")
def sensitivity_command(**given: Any) -> None:
    """Tell which of the quantities drawn the results depend on.

    Sobol's indices with 95 % intervals: which part of the variance over lanes comes from each,
    alone and with interactions. Writes sensitivity.csv and its figure; cells that are there are not
    done again.
    """
    results.tell_sensitivity(**given)


@command(FURTHER, "rare")
@config_words
@number("--points", 100, "Lanes of a level.", default=1000, show_default=True)
@out_of("Results folder.  [default: results/NAME]")
def rare_command(**given: Any) -> None:
    """Tell how rarely the defence fails, where plain lanes would hardly show it.

    Subset simulation over all that is drawn, ten repeats, with a 95 % interval. Writes rare.csv;
    cells that are there are not done again.
    """
    results.tell_rare(**given)


@command(FURTHER, "compare")
@click.argument("a", type=click.Path())
@click.argument("b", type=click.Path())
@form
@out_of("Where to write.  [default: A-B beside B]")
def compare_command(**given: Any) -> None:
    """Hold the lanes of results B against those of A, paired by their draws.

    Prints what differs between the studies, then B − A cell by cell: the tail errors, and the share
    of lanes unrecovered with those that changed sides. Writes compare.html, differences.csv,
    changed.csv and failed.csv.
    """
    results.compare_results(**given)


@command(FURTHER)
@results_argument
@text(
    "--mat",
    "TEXT",
    "A file for MATLAB.  [default: results.mat in RESULTS]",
    is_flag=False,
    flag_value="",
)
@text(
    "--csv",
    "DIR",
    "A folder of CSV files of the trajectories.  [default: csv in RESULTS]",
    is_flag=False,
    flag_value="",
)
def export(results: str, mat: str | None, csv: str | None) -> None:
    """Write results for other programs: --mat [FILE] for MATLAB, Octave, --csv [DIR] for R, Excel.

    The file for MATLAB has a structure of columns for the lanes and one for the cells, what is
    swept, and errors and trajectories where they are stored. CSV has a file for each stored
    trajectory, with a row for each time and vehicle. Everything else is readable as it is: CSV,
    Parquet and Zarr.
    """
    chosen = {form: out for form, out in (("mat", mat), ("csv", csv)) if out is not None}
    if not chosen:
        raise click.UsageError("say for which program: --mat or --csv")
    studies.export_results(results, chosen)
