"""The command line: thin, and quick to say what it can do. JAX is imported by the commands that simulate."""

import atexit
import gc

import click

import jaxnet
from jaxnet.cli import lanes, results, studies

SECTIONS = {
    "A study": (studies.init, studies.check, studies.run, studies.search, studies.schema),
    "Its results": (results.list_results, results.show, results.fit, results.report, results.figure),
    "One lane": (lanes.replay, lanes.animate),
    "Further": (studies.sensitivity, studies.rare, results.compare, results.export),
}


class Sections(click.Group):
    """Commands, listed in the order in which they are used."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """A section each."""
        for title, commands in SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl([(str(each.name), each.get_short_help_str(200)) for each in commands])


@click.group(cls=Sections, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(jaxnet.__version__, prog_name="jaxnet")
def main() -> None:
    """Monte Carlo attack studies on networks of two-wheeled robots.

    A study is a YAML file; its first line is the command that runs it. Try `jaxnet check configs/quick.yaml`,
    then `jaxnet run configs/quick.yaml`.
    """
    gc.set_threshold(300_000)  # imports and traces make millions of objects that stay
    atexit.register(gc.freeze)  # nor are they looked through in the end


for commands in SECTIONS.values():
    for command in commands:
        main.add_command(command)
