"""Commands on a study's config: begin one, check it, run it."""

import json
import re
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, TypeVar

import click

import jaxnet
from jaxnet.cli.echo import echo
from jaxnet.cli.errors import user_errors
from jaxnet.lazy import LazyModule

if TYPE_CHECKING:
    from jaxnet.api import writing
    from jaxnet.config import cells, document, schema
    from jaxnet.engine import batch
    from jaxnet.explore import sensitivity
    from jaxnet.runs import shards
    from jaxnet.store import folder
    from jaxnet.store import tables as stored
    from jaxnet.view.text import analyses, progress, tables, worst
    from jaxnet.view.text import check as checks
    from jaxnet.view.text import sensitivity as indices
else:
    analyses = LazyModule("jaxnet.view.text.analyses")
    batch = LazyModule("jaxnet.engine.batch")
    cells = LazyModule("jaxnet.config.cells")
    checks = LazyModule("jaxnet.view.text.check")
    document = LazyModule("jaxnet.config.document")
    folder = LazyModule("jaxnet.store.folder")
    indices = LazyModule("jaxnet.view.text.sensitivity")
    progress = LazyModule("jaxnet.view.text.progress")
    schema = LazyModule("jaxnet.config.schema")
    sensitivity = LazyModule("jaxnet.explore.sensitivity")
    shards = LazyModule("jaxnet.runs.shards")
    stored = LazyModule("jaxnet.store.tables")
    tables = LazyModule("jaxnet.view.text.tables")
    worst = LazyModule("jaxnet.view.text.worst")
    writing = LazyModule("jaxnet.api.writing")

C = TypeVar("C", bound=Callable[..., object])
FAILED_LANES = 3

config_arguments = [
    click.argument("config", type=click.Path(path_type=Path)),
    click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]..."),
]


def takes_config(command: C) -> C:
    """Add the arguments CONFIG and KEY=VALUE to a command."""
    for argument in reversed(config_arguments):
        command = argument(command)
    return command


machine_options = [
    click.option(
        "--devices", type=click.IntRange(1), help="Cores, or accelerators, to use.  [default: all]"
    ),
    click.option(
        "--chunk",
        type=click.IntRange(1),
        help="Lanes advanced side by side; changes rows by rounding.  [default: what suits the engine]",
    ),
    click.option("--workers", type=click.IntRange(1), help="Processes to part the cores among."),
    click.option(
        "--cluster",
        metavar="tcp://…",
        help="A dask scheduler whose workers see the results folder.",
    ),
]


def takes_machines(command: C) -> C:
    """Add the options that say where lanes are simulated."""
    for option in reversed(machine_options):
        command = option(command)
    return command


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


@click.command()
@click.argument("file", default="study.yaml", type=click.Path(path_type=Path))
def init(file: Path) -> None:
    """Write a first config, with comments, to be changed in an editor.

    FILE (default: study.yaml) must not be there yet; the study takes its name.
    """
    with user_errors():
        if file.exists():
            raise folder.FolderError(f"{file} is there already: give another FILE")
        template = Template(
            Path(cells.__file__).with_name("starter.yaml").read_text(encoding="utf-8")
        )
        content = template.substitute(file=shlex.quote(str(file)), name=json.dumps(file.stem))
        cells.read_document(document.Document(content, str(file)))
        with file.open("x", encoding="utf-8") as opened:
            opened.write(content)
        echo(f"wrote {file}\nnext: jaxnet check {shlex.quote(str(file))}", err=True)


@click.command("run")
@takes_config
@click.option(
    "--out",
    metavar="DIR",
    type=click.Path(),
    help="Results folder, or a URL like s3://bucket/study.  [default: results/NAME]",
)
@click.option("--fresh", is_flag=True, help="Throw away what the folder holds of earlier results.")
@click.option("--strict", is_flag=True, help="Exit with status 3 if any lane failed.")
@takes_machines
@click.option(
    "--shard",
    type=ShardOf(),
    help="Only every n-th shard, from the i-th on, counted from 0; for job arrays. The same command without"
    " it simulates what is missing, and makes the tables.",
)
def run_command(
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
        if shard is not None:
            part = jaxnet.run_part(study, *shard, out, True, devices, chunk)
            failed = part.failed
            echo(tables.part_text(part), err=True)
        else:
            results = jaxnet.run(study, out, fresh, True, devices, chunk, workers, cluster)
            failed = results.manifest["lanes"]["failed"]
            echo(tables.summary_text(results))
            done = tables.nothing_to_do_text if results.found_all else tables.written_text
            said = [done(results), tables.failures_text(results), tables.next_command(results)]
            echo("\n".join(filter(None, said)), err=True)
    if failed and strict:
        sys.exit(FAILED_LANES)


@click.command("search")
@takes_config
@click.option(
    "--out",
    metavar="DIR",
    type=click.Path(),
    help="Results folder or URL.  [default: results/NAME]",
)
@click.option("--fresh", is_flag=True, help="Throw away what the folder holds of earlier results.")
@takes_machines
def search_command(
    config: Path,
    overrides: tuple[str, ...],
    out: str | None,
    fresh: bool,
    devices: int | None,
    chunk: int | None,
    workers: int | None,
    cluster: str | None,
) -> None:
    """Look for the worst of what `search.over` lets an attacker choose, beside as many random lanes.

    The lanes are a run of the study; a search that was broken off goes on, and workers search cells side by
    side. The best choice of each cell is tried from 10,000 other starts and by the nonlinear engine, and
    written as a study of its own.
    """
    with user_errors():
        study = writing.with_random_lanes(jaxnet.load(config, overrides))
        machines = devices, chunk, workers, cluster
        results = jaxnet.run(study, out, fresh, True, *machines)
        with progress.report_steps() as told:
            files = [str(file) for file in writing.write_search(results, told, *machines)]
        echo(worst.search_text(results))
        echo("\n".join(f"wrote {file}" for file in files), err=True)


@click.command()
@takes_config
@click.option("--cell", type=click.IntRange(0), help="Tell all of this cell alone.")
def check(config: Path, overrides: tuple[str, ...], cell: int | None) -> None:
    """Validate a config; print its cells and what is known of them before anything moves."""
    with user_errors():
        study = jaxnet.load(config, overrides)
        if cell is not None and cell >= len(study.cells):
            raise click.BadParameter(f"there are {len(study.cells)} cells", param_hint="--cell")
        if study.config.scope.known:
            shards.try_kinds(study.config, study.cells, batch.EVERYTHING)
        echo(checks.check_text(study, cell))


@click.command("sensitivity")
@takes_config
@click.option(
    "--metric",
    help="Of which to print; the file has all of them.  [default: tail_mean; spread without a navigator]",
)
@click.option(
    "--samples",
    type=click.IntRange(30),
    default=1024,
    show_default=True,
    help="Lanes of a cell for each quantity drawn; twice as many come on top.",
)
@click.option(
    "--out", metavar="DIR", type=click.Path(), help="Results folder.  [default: results/NAME]"
)
def sensitivity_command(
    config: Path, overrides: tuple[str, ...], metric: str | None, samples: int, out: str | None
) -> None:
    """Tell which of the quantities drawn the results depend on.

    Sobol's indices with 95 % intervals: which part of the variance over lanes comes from each, alone and with
    interactions. Writes sensitivity.csv and its figure; cells that are there are not done again.
    """
    with user_errors():
        study = jaxnet.load(config, overrides)
        known = [each.name for each in study.config.measured()]
        known += ["unrecovered"] if study.config.recovery else []
        metric = metric or cells.judged_metric(study.cells)
        if metric not in known:
            raise click.BadParameter(
                f"one of {', '.join(known)} (got {metric})", param_hint="--metric"
            )
        echo(indices.plan_text(sensitivity.lanes_needed(study, samples), samples), err=True)
        with progress.report_steps() as told:
            written = list(writing.write_sensitivity(study, samples, out, told))
        echo(indices.indices_text(stored.read_table(written[0]), study, metric))
        for path in written:
            echo(f"wrote {path}", err=True)


@click.command("rare")
@takes_config
@click.option(
    "--points", type=click.IntRange(100), default=1000, show_default=True, help="Lanes of a level."
)
@click.option(
    "--out", metavar="DIR", type=click.Path(), help="Results folder.  [default: results/NAME]"
)
def rare_command(config: Path, overrides: tuple[str, ...], points: int, out: str | None) -> None:
    """Tell how rarely the defence fails, where plain lanes would hardly show it.

    Subset simulation over all that is drawn, ten repeats, with a 95 % interval. Writes rare.csv; cells that
    are there are not done again.
    """
    with user_errors():
        study = jaxnet.load(config, overrides)
        with progress.report_steps() as told:
            written = writing.write_rare(study, points, out, told)
        echo(analyses.rare_text(stored.read_table(written)))
        echo(f"wrote {written}", err=True)


@click.command("schema")
def schema_command() -> None:
    """Print the config's JSON schema, for editors."""
    echo(schema.schema_text(), nl=False)
