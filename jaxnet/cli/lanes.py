"""Commands on one lane: simulate it again, see it move."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

import jaxnet
from jaxnet.cli.echo import echo
from jaxnet.cli.errors import user_errors
from jaxnet.cli.results import out_option, results_argument, takes_code
from jaxnet.lazy import LazyModule

if TYPE_CHECKING:
    from jaxnet.api import writing
    from jaxnet.view.text import progress, tables
else:
    progress = LazyModule("jaxnet.view.text.progress")
    tables = LazyModule("jaxnet.view.text.tables")
    writing = LazyModule("jaxnet.api.writing")

cell_option = click.option(
    "--cell", type=click.IntRange(0), required=True, help="Number of the cell, from 0."
)
sample_option = click.option(
    "--sample", type=click.IntRange(0), required=True, help="Number of the draw, from 0."
)


@click.command("replay")
@results_argument
@cell_option
@sample_option
@click.option(
    "--engine", metavar="NAME", help="exact, nonlinear or stacked.  [default: the study's own]"
)
@out_option
@takes_code
def replay_command(
    results: str,
    cell: int,
    sample: int,
    engine: str | None,
    out: str | None,
    trust: bool,
    config: Path | None,
) -> None:
    """Simulate one lane again, with its full trajectory."""
    with user_errors():
        opened = jaxnet.open(results, out, trust, config)
        again = opened.replay(cell, sample, engine)
        echo(tables.lane_text(opened, again.row))
        echo(f"wrote {again.path}", err=True)


@click.command()
@results_argument
@cell_option
@sample_option
@click.option(
    "--out", metavar="FILE", help="Ends in .mp4 (needs ffmpeg) or .gif.  [default: into figures/]"
)
@takes_code
def animate(
    results: str, cell: int, sample: int, out: str | None, trust: bool, config: Path | None
) -> None:
    """Write a film of one lane: who hears whom, attacked vehicles and what they tell, and the errors.

    It is an MP4 where ffmpeg is found, else a GIF. A lane whose trajectory is not there is simulated again.
    """
    with user_errors():
        opened = jaxnet.open(results, trust=trust, config=config)
        with progress.report_steps() as told:
            path = writing.write_film(opened, cell, sample, out, told)
        echo(f"wrote {path}", err=True)
