"""The command line: what each command is called, takes, says in its help, and does.

Help appears at once: JAX, pandas and all else that a command needs are imported when it runs.
"""

import json
import re
import shlex
import sys
import webbrowser
from pathlib import Path
from string import Template
from typing import Any

import click

import jaxnet
from jaxnet.cli.commands import (
    A_STUDY,
    FURTHER,
    ITS_RESULTS,
    ONE_LANE,
    NearChoice,
    code,
    command,
    config_words,
    elsewhere,
    errors,
    flag,
    form_option,
    fresh_option,
    lane,
    machines,
    number,
    out_of,
    results_argument,
    text,
    where_option,
)
from jaxnet.cli.commands import main as main
from jaxnet.lazy import LazyModule, LazyPackage
from jaxnet.view.figures import COLUMN_WIDTHS, FIGURE_NAMES

api = LazyPackage("jaxnet.api")
configs = LazyPackage("jaxnet.config")
engines = LazyPackage("jaxnet.engine")
shards = LazyModule("jaxnet.runs.shards")
stores = LazyPackage("jaxnet.store")
texts = LazyPackage("jaxnet.view.text")
watching = LazyModule("jaxnet.runs.watched")

FAILED_LANES = 3


# --- a study --------------------------------------------------------------------------------------


@command(
    A_STUDY, "init", click.argument("file", default="study.yaml", type=click.Path(path_type=Path))
)
def write_starter(file: Path) -> None:
    """Write a first config, with comments, to be changed in an editor.

    FILE (default: study.yaml) must not be there yet; the study takes its name.
    """
    if file.exists():
        raise jaxnet.FolderError(f"{file} is there already: give another FILE")
    template = Template(
        Path(configs.cells.__file__).with_name("starter.yaml").read_text(encoding="utf-8")
    )
    content = template.substitute(file=shlex.quote(str(file)), name=json.dumps(file.stem))
    configs.cells.read_document(configs.document.Document(content, str(file)))
    with file.open("x", encoding="utf-8") as opened:
        opened.write(content)
    errors.tell_written([file])
    errors.tell_next("check", file)


@command(
    A_STUDY,
    "check",
    config_words,
    click.option("--cell", type=click.IntRange(0), help="Tell all of this cell alone."),
)
def check_command(config: Path, overrides: tuple[str, ...], cell: int | None) -> None:
    """Validate a config; print its cells and what theory says of them, without simulation."""
    study = jaxnet.load(config, overrides)
    if cell is not None and cell >= len(study.cells):
        raise click.BadParameter(f"there are {len(study.cells)} cells", param_hint="--cell")
    with texts.progress.report_work("checking what theory says"):
        if study.config.scope.known:  # classes from outside are tried, which takes JAX
            shards.try_kinds(study.config, study.cells, engines.batch.EVERYTHING)
        errors.echo(texts.check.check_text(study, cell))
    errors.tell_next("run", config, *overrides)


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


@command(
    A_STUDY,
    "run",
    config_words,
    out_of("Results folder, or a URL like s3://bucket/study.  [default: results/NAME]"),
    fresh_option,
    flag("--strict", told="Exit with status 3 if any lane failed."),
    machines,
    click.option(
        "--shard",
        type=ShardOf(),
        help="Only every n-th shard, from the i-th on, counted from 0; for job arrays. The same"
        " command without it simulates what is missing, and makes the tables.",
    ),
)
def run_command(
    config: Path,
    overrides: tuple[str, ...],
    out: str | None,
    fresh: bool,
    strict: bool,
    shard: tuple[int, int] | None,
    **machines: Any,
) -> None:
    """Simulate a study; an unfinished run of it is resumed.

    KEY=VALUE overrides a key of CONFIG by its dotted name, the value in YAML:
    attack.magnitude=10 samples=100 'sweep.attack.magnitude={geomspace: [0.1, 100, 12]}'
    """
    if shard and (fresh or machines["workers"] or machines["cluster"]):
        raise click.UsageError("--shard goes with neither --fresh nor --workers nor --cluster")
    study = jaxnet.load(config, overrides)
    if shard:
        part = jaxnet.run_part(study, *shard, out, True, machines["devices"], machines["chunk"])
        failed = part.failed
        errors.echo(texts.tables.part_text(part), err=True)
    else:
        results = jaxnet.run(study, out, fresh, True, **machines)
        ok, failed = (results.manifest["lanes"][each] for each in ("ok", "failed"))
        if ok:
            errors.echo(texts.tables.summary_text(results))
        errors.echo(texts.tables.outcome_text(results, results.found_all), err=True)
        if ok:  # else the first failed lane is told, and how to replay it
            errors.tell_next("report", results.path)
    if failed and strict:
        sys.exit(FAILED_LANES)


@command(
    A_STUDY,
    "search",
    config_words,
    out_of("Results folder or URL.  [default: results/NAME]"),
    fresh_option,
    machines,
)
def search_command(
    config: Path, overrides: tuple[str, ...], out: str | None, fresh: bool, **machines: Any
) -> None:
    """Search for an attacker's worst choice in `search.over`; compare it with as many random lanes.

    The lanes are a run of the study; a search that was broken off goes on, and workers search cells
    side by side. The best choice of each cell is tried from 10,000 other draws and by the
    nonlinear engine, and written as a study of its own.
    """
    study = api.studies.with_random_lanes(jaxnet.load(config, overrides))
    results = jaxnet.run(study, out, fresh, True, **machines)
    with texts.progress.report_steps() as told:
        files = list(api.writing.write_search(results, told, **machines))
    errors.echo(texts.worst.search_text(results))
    errors.tell_written(files)
    errors.tell_next("report", results.path)


@command(A_STUDY, "schema")
def print_schema() -> None:
    """Print the config's JSON schema, for editors."""
    errors.echo(configs.schema.schema_text(), nl=False)


# --- results -------------------------------------------------------------------------------------


@command(ITS_RESULTS, "list", click.argument("folder", default="results", type=click.Path()))
def list_results(folder: str) -> None:
    """List the results folders at or below FOLDER (default: results).

    A line each: cells, lanes, how many of them are ok and failed, whether the run is finished, and
    when it was written.
    """
    if lines := texts.folders.folders_text(folder):
        errors.echo(lines)
    else:
        errors.echo(f"no results in {folder}", err=True)


@command(
    ITS_RESULTS,
    "show",
    results_argument,
    form_option,
    text("--columns", "A,B,…", "Columns of cells.csv to show.  [default: the main ones]"),
    text("--sort", "COLUMN", "Column to sort by; -COLUMN: the greatest first."),
    where_option,
    text("--pivot", "KEY", "Swept key whose values stand across."),
    flag("--all", "whole", told="All rows, on a terminal too."),
)
def show_command(
    results: str,
    form: str,
    columns: str | None,
    sort: str | None,
    where: dict[str, list[str]],
    pivot: str | None,
    whole: bool,
) -> None:
    """Print the summary table again, a line per cell, and what search, sensitivity and rare found.

    As text it is as wide as the terminal, and says what it leaves out. On a terminal it has 60 rows
    at most without --all. The other formats have all of it. A column that is the same in all cells
    is one line of text.
    """
    opened = jaxnet.open(results)
    chosen = columns.split(",") if columns else (), where, sort, pivot
    if form == "text":
        most = None if whole or not sys.stdout.isatty() else texts.width.MOST_ROWS
        told = [texts.analyses.analyses_text(opened)]
        ended = not opened.has_run or opened.cells["ok"].to_numpy().any()
        if opened.has_run:
            table = texts.tables.summary_text(opened, *chosen, most) if ended or columns else ""
            told = [table, texts.tables.failures_text(opened, where), *told]
        errors.echo("\n\n".join(filter(None, told)))
        if ended:
            errors.tell_next("report", results)
    elif opened.has_run:
        errors.echo(texts.tables.formatted(opened, form, *chosen))
    else:
        found = [texts.formats.columns_of(getattr(opened, name)) for name in opened.analyses]
        errors.echo("\n\n".join(texts.formats.in_format(each, form) for each in found))


@command(ITS_RESULTS, "fit", results_argument, elsewhere, code)
def fit_results(results: str, out: str | None, **code: Any) -> None:
    """Fit the ultimate error against the attack's magnitude, beside the bounds of theory.

    Writes fit.csv, bounds.csv and violations.csv, and prints what they come to.
    """
    opened = jaxnet.open(results, out, **code)
    with texts.progress.report_steps() as told:
        errors.tell_written(api.writing.write_fits(opened, told))
    errors.echo(texts.slopes.fit_text(opened))
    errors.tell_next("report", results, *(["--out", out] if out else []))


@command(
    ITS_RESULTS,
    "report",
    results_argument,
    elsewhere,
    flag("--open", "shown", told="Open the page in the browser."),
    flag("--no-replay", told="Simulate no lane again: the page shows stored trajectories alone."),
    code,
)
def report_command(
    results: str, out: str | None, shown: bool, no_replay: bool, **code: Any
) -> None:
    """Write report.html, a page that works offline, and its figures as PNG and PDF.

    Fits what is not fitted yet, and simulates lanes again that the page shows: the median and the
    worst of a dozen cells at most, and the worst per ā if the study has `recovery`. Most of the
    time goes into these lanes; --no-replay leaves them out.
    """
    opened = jaxnet.open(results, out, **code)
    if many := 0 if no_replay else watching.lanes_again(opened):
        told = "lane is" if many == 1 else "lanes are"
        motion = "simulated again to show their motion; --no-replay leaves them out"
        errors.echo(f"{many} {told} {motion}", err=True)
    stored = {*opened.folder.path.glob("replays/*")}
    with texts.progress.report_steps() as told:
        files = api.writing.write_report(opened, told, not no_replay)
        errors.tell_written(file for file in files if file not in stored)
    if stored:
        errors.echo(f"replays: {len(stored)} were there already", err=True)
    page = opened.folder.path / "report.html"
    if shown and not webbrowser.open(page.absolute().as_uri()):
        errors.echo(f"no browser opens {page}", err=True)


@command(
    ITS_RESULTS,
    "figure",
    results_argument,
    click.argument("name", metavar="NAME", type=NearChoice(FIGURE_NAMES)),
    where_option,
    text("--x", "KEY", "Swept key across.  [default: the key of most numbers]"),
    text("--y", "NAME", "Metric or share of curve, series of bands.  [default: what is asked]"),
    text("--hue", "KEY", "Swept key in colours; of a heat map, down."),
    text("--panel", "KEY", "Swept key with a panel a value; repeatable.", multiple=True),
    click.option(
        "--column",
        type=click.Choice(list(COLUMN_WIDTHS)),
        default="two",
        show_default=True,
        help="Columns of a journal that it is as wide as: 3.5 or 7.16 in.",
    ),
    text("--size", "WxH", "Width and height: 3.4x2.5 in inches, or 86x64mm."),
    click.option("--font-size", type=float, help="Size of the type [pt].  [default: 8]"),
    text("--font", "FAMILY", "An installed font, such as serif or 'Times New Roman'."),
    flag("--plain", told="In matplotlib's own style (matplotlibrc), not in that for print."),
    flag("--no-note", told="Without the small lines below the panels: a caption says it."),
    elsewhere,
    code,
)
def figure_command(
    results: str,
    name: str,
    where: dict[str, list[str]],
    column: str,
    plain: bool,
    no_note: bool,
    out: str | None,
    trust: bool,
    config: Path | None,
    **chosen: Any,
) -> None:
    """Write the figure NAME, as PNG and PDF, into figures/ of RESULTS.

    \b
    curve         a metric or share with its interval against a swept key
    answer        the median error, or the share of lanes in the hull, as on the page
    heat          the share of lanes unrecovered over two swept keys
    heat_worst    the greatest error over two swept keys
    ultimate, ultimate_mean              the error over the tail against ā
    tails, bands, panels                 lanes by cell; errors over time; trajectories
    vehicles                             the error of each vehicle over the tail
    topologies                           graphs with weights and attacked links
    search, search_worst                 of jaxnet search
    sensitivity, sensitivity_unrecovered of jaxnet sensitivity

    The first four take --x, --hue and --panel; curve takes --y too, and bands takes --y and --hue.
    A choice of cells, axes, size or type is part of the files' names.
    """  # noqa: D301
    chosen = {key: list(each) if key == "panel" else each for key, each in chosen.items() if each}
    opened = jaxnet.open(results, out, trust, config)
    with texts.progress.report_work(f"drawing {name}"):
        files = api.writing.write_figure(opened, name, where, column, chosen, plain, not no_note)
        errors.tell_written(files)


@command(
    ONE_LANE,
    "replay",
    lane,
    text("--engine", "NAME", "exact, nonlinear or stacked.  [default: the study's own]"),
    elsewhere,
    code,
)
def replay_command(
    results: str, cell: int, sample: int, engine: str | None, out: str | None, **code: Any
) -> None:
    """Simulate one lane again, with its full trajectory."""
    opened = jaxnet.open(results, out, **code)
    with texts.progress.report_work(f"simulating cell {cell}, sample {sample}"):
        again = opened.replay(cell, sample, engine)
    errors.echo(texts.tables.lane_text(opened, again.row))
    errors.tell_written([again.path])
    errors.tell_next("animate", results, "--cell", cell, "--sample", sample)


@command(
    ONE_LANE,
    "animate",
    lane,
    text("--out", "FILE", "Ends in .mp4 (needs ffmpeg) or .gif.  [default: into figures/]"),
    code,
)
def animate_command(results: str, cell: int, sample: int, out: str | None, **code: Any) -> None:
    """Write a film of one lane: links, what attacked vehicles transmit, and the errors.

    It is an MP4 where ffmpeg is found, else a GIF. A lane whose trajectory is not there is
    simulated again.
    """
    opened = jaxnet.open(results, **code)
    with texts.progress.report_steps() as told:
        path = api.writing.write_film(opened, cell, sample, out, told)
    errors.tell_written([path])


@command(
    ONE_LANE,
    "view",
    lane,
    text("--save", "FILE", "Write a recording that ends in .rrd; the viewer does not open."),
    code,
)
def view_command(results: str, cell: int, sample: int, save: str | None, **code: Any) -> None:
    """Open one lane in rerun: robots, links, dropped messages, false positions, formation.

    Needs rerun: pip install 'jaxnet-sim[view]'. A lane whose trajectory is not there is simulated
    again.
    """
    opened = jaxnet.open(results, **code)
    with texts.progress.report_steps() as told:
        path = api.writing.write_view(opened, cell, sample, save, told)
    errors.tell_written([] if path is None else [path])


# --- further --------------------------------------------------------------------------------------


@command(
    FURTHER,
    "sensitivity",
    config_words,
    click.option(
        "--metric",
        help="Of which to print; the file has all of them.  [default: tail_mean; spread without a"
        " navigator]",
    ),
    number(
        "--samples",
        30,
        "Lanes of a cell for each quantity drawn; twice as many come on top.",
        default=1024,
        show_default=True,
    ),
    out_of("Results folder.  [default: results/NAME]"),
)
def sensitivity_command(
    config: Path, overrides: tuple[str, ...], metric: str | None, samples: int, out: str | None
) -> None:
    """Tell on which drawn quantities the results depend.

    Sobol's indices with 95 % intervals: which part of the variance over lanes comes from each,
    alone and with interactions. Writes sensitivity.csv and its figure; cells that are there are not
    done again.
    """
    study = jaxnet.load(config, overrides)
    known = [each.name for each in study.config.measured()]
    known += ["unrecovered"] if study.config.recovery else []
    metric = metric or configs.cells.judged_metric(study.cells)
    if metric not in known:
        told = f"one of {', '.join(known)} (got {metric})"
        raise click.BadParameter(told, param_hint="--metric")
    with texts.progress.report_steps() as told:
        written = list(api.writing.write_sensitivity(study, samples, out, told))
    errors.echo(texts.analyses.indices_text(stores.tables.read_table(written[0]), study, metric))
    errors.tell_written(written)
    errors.tell_next("report", written[0].parent)


@command(
    FURTHER,
    "rare",
    config_words,
    number("--points", 100, "Lanes of a level.", default=1000, show_default=True),
    out_of("Results folder.  [default: results/NAME]"),
)
def rare_command(config: Path, overrides: tuple[str, ...], points: int, out: str | None) -> None:
    """Estimate how often the defence fails, where that is too rare for plain lanes.

    Subset simulation over all that is drawn, ten repeats, with a 95 % interval. Writes rare.csv;
    cells that are there are not done again.
    """
    study = jaxnet.load(config, overrides)
    with texts.progress.report_steps() as told:
        written = api.writing.write_rare(study, points, out, told)
    errors.echo(texts.analyses.rare_text(stores.tables.read_table(written), study))
    errors.tell_written([written])
    errors.tell_next("report", written.parent)


@command(
    FURTHER,
    "compare",
    click.argument("a", type=click.Path()),
    click.argument("b", type=click.Path()),
    form_option,
    out_of("Where to write.  [default: A-B beside B]"),
)
def compare_command(a: str, b: str, form: str, out: str | None) -> None:
    """Compare the lanes of results B with those of A, paired by their draws.

    Prints what differs between the studies, then B − A cell by cell: the tail errors, and the share
    of lanes unrecovered with those that changed sides. Writes compare.html, differences.csv,
    changed.csv and failed.csv.
    """
    with texts.progress.report_work("comparing lanes"):
        found = jaxnet.compare(a, b)
    beside = stores.folder.place(b).parent / f"{Path(a).name}-{Path(b).name}"
    errors.tell_written(api.writing.write_comparison(found, out or beside))
    if form == "text":
        errors.echo(texts.comparison.comparison_text(found))
    else:
        columns = texts.comparison.comparison_columns(found)
        errors.echo(texts.formats.in_format(columns, form))


@command(
    FURTHER,
    "export",
    results_argument,
    *(
        text(f"--{form}", metavar, told, is_flag=False, flag_value="")
        for form, metavar, told in (
            ("mat", "TEXT", "A file for MATLAB.  [default: results.mat in RESULTS]"),
            ("csv", "DIR", "A folder of CSV files of the trajectories.  [default: csv in RESULTS]"),
        )
    ),
    text("--robotarium", "FILE", "A script for the simulator of the Robotarium; ends in .py."),
    number("--cell", 0, "Of the script: number of the cell, from 0."),
    number("--sample", 0, "Of the script: number of the draw, from 0."),
    code,
)
def export_command(
    results: str,
    robotarium: str | None,
    cell: int | None,
    sample: int | None,
    trust: bool,
    config: Path | None,
    **chosen: str | None,
) -> None:
    """Write results for other programs: --mat [FILE] for MATLAB, Octave, --csv [DIR] for R, Excel.

    The file for MATLAB has a structure of columns for the lanes and one for the cells, what is
    swept, and errors and trajectories where they are stored. CSV has a file for each stored
    trajectory, with a row for each time and vehicle. Everything else is readable as it is: CSV,
    Parquet and Zarr.

    --robotarium FILE --cell C --sample S writes a script with the closed loop of one lane, and the
    poses of this lane beside it.
    """
    asked = {form: out for form, out in chosen.items() if out is not None}
    if not asked and robotarium is None:
        raise click.UsageError("say for which program: --mat, --csv or --robotarium")
    if (robotarium is None) != (cell is None) or (robotarium is None) != (sample is None):
        raise click.UsageError("a script needs all three: --robotarium, --cell and --sample")
    opened = jaxnet.open(results, trust=trust, config=config)
    if robotarium is not None and cell is not None and sample is not None:
        with texts.progress.report_work("writing the script"):
            written = api.writing.write_robotarium(opened, cell, sample, robotarium)
        errors.tell_written(written)
    for form, out in asked.items():
        with texts.progress.report_work(f"writing {form}"):
            errors.echo(f"wrote {opened.export(out or None, form)}", err=True)
