"""The command line. Help appears at once, since a command imports JAX and pandas only when it runs."""

import atexit
import gc
from typing import Any

import click

from jaxnet.cli import lanes, results, studies
from jaxnet.cli.errors import prepare_streams, unforeseen
from jaxnet.version import __version__

SECTIONS = {
    "A study": (
        studies.init,
        studies.check,
        studies.run_command,
        studies.search_command,
        studies.schema_command,
    ),
    "Its results": (
        results.list_results,
        results.show,
        results.fit,
        results.report,
        results.figure_command,
    ),
    "One lane": (lanes.replay_command, lanes.animate),
    "Further": (
        studies.sensitivity_command,
        studies.rare_command,
        results.compare_command,
        results.export,
    ),
}


class Sections(click.Group):
    """Commands, listed in the order in which they are used."""

    def main(self, *args: Any, **keys: Any) -> Any:
        """Run a command with output streams that take what it writes."""
        prepare_streams()
        return super().main(*args, **keys)

    def invoke(self, ctx: click.Context) -> object:
        """Run a command; an error that nobody foresaw ends in one line."""
        with unforeseen():
            return super().invoke(ctx)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a section of help for each group of commands."""
        for title, commands in SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl(
                    [(str(each.name), each.get_short_help_str(200)) for each in commands]
                )


@click.group(cls=Sections, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="jaxnet")
def main() -> None:
    """Monte Carlo attack studies on networks of two-wheeled robots.

    A study is a YAML file; its first line is the command that runs it. Try `jaxnet check configs/quick.yaml`,
    then `jaxnet run configs/quick.yaml`.
    """
    gc.set_threshold(300_000)  # imports and traces make millions of objects that stay
    atexit.register(gc.freeze)  # the last collection need not look through them


for commands in SECTIONS.values():
    for command in commands:
        main.add_command(command)
