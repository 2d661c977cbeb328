"""The command line: thin, and quick to say what it can do. JAX is imported by the commands that simulate."""

import contextlib
import errno
import os
import re
import signal
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

import jaxnet
from jaxnet.view.figures import NAMES

INTERRUPTED = 130
AGAIN = 0.5  # [s]
FAILED_LANES = 3
FORMATS = ("text", "csv", "markdown", "latex")
NOT_OURS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)  # faults that are not ours

config_arguments = [
    click.argument("config", type=click.Path(path_type=Path)),
    click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]..."),
]
results_argument = click.argument("results", type=click.Path())  # a path or URL; shells complete paths


def takes_config(command):
    """Give a command its CONFIG and overrides."""
    for argument in reversed(config_arguments):
        command = argument(command)
    return command


@contextlib.contextmanager
def interrupts() -> Iterator[None]:
    """Have Ctrl-C raise KeyboardInterrupt, and again where that is ignored, as in a callback of gc."""

    def interrupt(*_: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGALRM)}
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def user_errors() -> Iterator[None]:
    """End with status 2 and a plain message on what the user can mend, 130 on Ctrl-C."""
    from jaxnet.config.document import ConfigError
    from jaxnet.kinds.registry import KindError, blaming
    from jaxnet.runs.cluster import ClusterError
    from jaxnet.store.folder import FolderError

    try:
        with interrupts(), warnings.catch_warnings(), blaming():
            warnings.showwarning = lambda message, *_: click.echo(f"warning: {message}", err=True)
            yield
    except (ConfigError, FolderError, ClusterError, KindError) as error:
        click.echo(str(error), err=True)
        if isinstance(error, ConfigError) and len(error.problems) > 1:
            click.echo(f"{len(error.problems)} errors", err=True)
        sys.exit(2)
    except OSError as error:
        if error.errno not in NOT_OURS and not isinstance(error, PermissionError):
            raise
        click.echo(f"{error}; finished shards are kept, the same command goes on", err=True)
        sys.exit(2)
    except KeyboardInterrupt:
        click.echo("interrupted; finished shards are kept, the same command goes on", err=True)
        sys.stdout.flush()
        os._exit(INTERRUPTED)  # not to wait for programs under way, whose lanes nobody will take


class ShardOf(click.ParamType):
    """`i/n`: shards i, i + n, i + 2n, … counted from 0."""

    name = "i/n"

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[int, int]:
        """The two numbers."""
        match = re.fullmatch(r"(\d+)/(\d+)", value)
        if not match or int(match[1]) >= int(match[2]):
            self.fail(f"{value} is none of 0/n, 1/n, … up to n-1/n", param, ctx)
        return int(match[1]), int(match[2])


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(jaxnet.__version__, prog_name="jaxnet")
def main() -> None:
    """Monte Carlo attack studies on networks of two-wheeled robots.

    A study is a YAML file; its first line is the command that runs it. Try `jaxnet check configs/quick.yaml`,
    then `jaxnet run configs/quick.yaml`.
    """


@main.command()
@takes_config
@click.option(
    "--out",
    metavar="DIR",
    type=click.Path(),
    help="Results folder, or a URL like s3://bucket/study.  [default: results/NAME]",
)
@click.option("--fresh", is_flag=True, help="Throw away what the folder holds of earlier results.")
@click.option("--strict", is_flag=True, help="Exit with status 3 if any lane failed.")
@click.option("--devices", type=click.IntRange(1), help="Cores, or accelerators, to use.  [default: all]")
@click.option(
    "--chunk",
    type=click.IntRange(1),
    help="Lanes advanced side by side; changes rows by rounding.  [default: what suits the engine]",
)
@click.option("--workers", type=click.IntRange(1), help="Processes to part the cores among.")
@click.option("--cluster", metavar="tcp://…", help="A dask scheduler whose workers see the results folder.")
@click.option(
    "--shard",
    type=ShardOf(),
    help="Only every n-th shard, from the i-th on, counted from 0; for job arrays. The same command without"
    " it simulates what is missing, and makes the tables.",
)
def run(
    config: Path,
    overrides: tuple[str, ...],
    out: str | None,
    fresh: bool,
    strict: bool,
    devices: int | None,
    chunk: int | None,
    workers: int | None,
    cluster: str | None,
    shard: tuple[int, int] | None,
) -> None:
    """Simulate a study; an unfinished run of it is resumed.

    KEY=VALUE overrides a key of CONFIG by its dotted name, the value in YAML:
    attack.magnitude=10 samples=100 'sweep.attack.magnitude={geomspace: [0.1, 100, 12]}'
    """
    if shard and (fresh or workers or cluster):
        raise click.UsageError("--shard goes with neither --fresh nor --workers nor --cluster")
    with user_errors():
        study = jaxnet.load(config, overrides)
        from jaxnet.view.text import tables

        if shard is not None:
            part = jaxnet.run_part(study, *shard, out, True, devices, chunk)
            failed = part.failed
            click.echo(tables.part(part), err=True)
        else:
            results = jaxnet.run(study, out, fresh, True, devices, chunk, workers, cluster)
            failed = results.manifest["lanes"]["failed"]
            click.echo(tables.summary(results))
            done = tables.nothing_to_do if results.found_all else tables.what_was_written
            said = [done(results), tables.failures(results), tables.next_command(results)]
            click.echo("\n".join(filter(None, said)), err=True)
    if failed and strict:
        sys.exit(FAILED_LANES)


@main.command()
@takes_config
def check(config: Path, overrides: tuple[str, ...]) -> None:
    """Validate a config; print its cells and what is known of them before anything moves."""
    with user_errors():
        study = jaxnet.load(config, overrides)
        from jaxnet.view.text import check

        click.echo(check.text(study))


@main.command()
def schema() -> None:
    """Print the config's JSON schema, for editors."""
    from jaxnet.config.schema import schema_text

    click.echo(schema_text(), nl=False)


@main.command()
@results_argument
@click.option("--cell", type=click.IntRange(0), required=True, help="Number of the cell, from 0.")
@click.option("--sample", type=click.IntRange(0), required=True, help="Number of the draw, from 0.")
@click.option("--engine", metavar="NAME", help="exact, nonlinear or stacked.  [default: the study's own]")
def replay(results: str, cell: int, sample: int, engine: str | None) -> None:
    """Simulate one lane again, with its full trajectory."""
    with user_errors():
        opened = jaxnet.open(results)
        from jaxnet.view.text import tables

        again = opened.replay(cell, sample, engine)
        click.echo(tables.lane(opened, again.row))
        click.echo(f"wrote {again.path}", err=True)


@main.command()
@results_argument
@click.option(
    "--format",
    "form",
    type=click.Choice(FORMATS),
    default="text",
    show_default=True,
    help="csv has all digits, the others four.",
)
def show(results: str, form: str) -> None:
    """Print the summary table again, a line per cell.

    As text it is at most 80 columns wide and 60 cells long, and says what it leaves out; the other formats
    have all of it.
    """
    with user_errors():
        opened = jaxnet.open(results)
        from jaxnet.view.text import formats

        click.echo(formats.in_format(opened, form))


@main.command("list")
@click.argument("folder", default="results", type=click.Path())
def list_results(folder: str) -> None:
    """List the results folders at or below FOLDER (default: results).

    A line each: cells, lanes, how many of them are ok and failed, whether the run is finished, and when it
    was written.
    """
    with user_errors():
        from jaxnet.view.text import folders

        if lines := folders.listing(folder):
            click.echo(lines)
        else:
            click.echo(f"no results in {folder}", err=True)


@main.command()
@results_argument
def fit(results: str) -> None:
    """Fit the ultimate error against the attack's magnitude, beside the bounds of theory.

    Writes fit.csv, bounds.csv and violations.csv, and prints what they come to.
    """
    with user_errors():
        opened = jaxnet.open(results)
        from jaxnet.api import write_fits
        from jaxnet.view.text import progress, slopes

        with progress.stepping() as told:
            for path in write_fits(opened, told):
                click.echo(f"wrote {path}", err=True)
        click.echo(slopes.text(opened))


@main.command()
@results_argument
@click.option("--open", "shown", is_flag=True, help="Open the page in the browser.")
def report(results: str, shown: bool) -> None:
    """Write report.html, a page that works offline, and its figures as PNG and PDF.

    Fits what is not fitted yet, and simulates lanes again that the page shows: the median and the worst of a
    dozen cells at most, and the worst of the study if it has `recovery`.
    """
    with user_errors():
        opened = jaxnet.open(results)
        from jaxnet.api import write_report
        from jaxnet.view.text import progress

        with progress.stepping() as told:
            for path in write_report(opened, told):
                click.echo(f"wrote {path}", err=True)
        if shown:
            show_page(opened.path / "report.html")


def show_page(page: Any) -> None:
    """Open a page in the browser, or say that there is none."""
    import webbrowser

    if not webbrowser.open(page.absolute().as_uri()):
        click.echo(f"no browser opens {page}", err=True)


@main.command()
@results_argument
@click.argument("name", type=click.Choice(NAMES))
def figure(results: str, name: str) -> None:
    """Write one figure of the report, as PNG and PDF, into figures/ of RESULTS."""
    with user_errors():
        opened = jaxnet.open(results)
        from jaxnet.api import write_figure

        for path in write_figure(opened, name):
            click.echo(f"wrote {path}", err=True)
