"""The group of commands with its sections of help, and the parameters that commands share."""

import atexit
import functools
import gc
import io
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from jaxnet.lazy import LazyModule
from jaxnet.runs import cache
from jaxnet.version import __version__

errors = LazyModule("jaxnet.cli.errors")
near_names = LazyModule("jaxnet.kinds.refusals")

C = TypeVar("C", bound=Callable[..., object])
A_STUDY, ITS_RESULTS, ONE_LANE, FURTHER = "A study", "Its results", "One lane", "Further"
SECTIONS = {name: list[click.Command]() for name in (A_STUDY, ITS_RESULTS, ONE_LANE, FURTHER)}


class NearChoice(click.Choice):
    """A choice of many names; a refusal asks whether a near one was meant."""

    def get_invalid_choice_message(self, value: Any, ctx: click.Context | None) -> str:
        told = super().get_invalid_choice_message(value, ctx)
        return told + near_names.suggestion(value, [*self.choices], fallback=False)


class Sections(click.Group):
    """Commands, listed in the order in which they are used."""

    def main(self, *args: Any, **keys: Any) -> Any:
        """Run a command with streams that show others in place of characters they lack.

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
    """Monte Carlo attack studies on networks of vehicles.

    A study is a YAML file; its first line is the command that runs it. Try `jaxnet check
    configs/quick.yaml`, then `jaxnet run configs/quick.yaml`.
    """
    gc.set_threshold(300_000)  # imports and traces make millions of objects that stay
    atexit.register(gc.freeze)  # the last collection need not look through them


def command(
    section: str, name: str, *parameters: Callable[[Any], Any]
) -> Callable[[Callable[..., object]], click.Command]:
    """Add a command with its parameters to a section; its errors end in plain messages."""

    def decorate(function: Callable[..., object]) -> click.Command:
        @functools.wraps(function)
        def guarded(**given: object) -> None:
            with errors.unforeseen(), errors.user_errors():
                function(**given)

        made = click.command(name)(together(*parameters)(guarded))
        SECTIONS[section].append(made)
        main.add_command(made)
        return made

    return decorate


def together(*parameters: Callable[[Any], Any]) -> Callable[[C], C]:
    """Make one decorator of several parameters."""

    def decorate(function: C) -> C:
        for parameter in reversed(parameters):
            function = parameter(function)
        return function

    return decorate


def flag(*names: str, told: str) -> Callable[[C], C]:
    return click.option(*names, is_flag=True, help=told)


def text(name: str, metavar: str, told: str, **more: Any) -> Callable[[C], C]:
    return click.option(name, metavar=metavar, help=told, **more)


def number(name: str, least: int, told: str, **more: Any) -> Callable[[C], C]:
    return click.option(name, type=click.IntRange(least), help=told, **more)


def out_of(told: str) -> Callable[[C], C]:
    return text("--out", "DIR", told, type=click.Path())


config_words = together(
    click.argument("config", type=click.Path(path_type=Path)),
    click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]..."),
)
fresh_option = flag("--fresh", told="Throw away what the folder holds of earlier results.")
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
form_option = click.option(
    "--format",
    "form",
    type=click.Choice(("text", "csv", "markdown", "latex")),
    default="text",
    show_default=True,
    help="csv has all digits, the others three.",
)


def chosen_cells(
    ctx: click.Context, param: click.Parameter, words: tuple[str, ...]
) -> dict[str, list[str]]:
    """Return the values of each swept key from words KEY=VALUE."""
    found: dict[str, list[str]] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals:
            raise click.BadParameter(f"KEY=VALUE (got {word})", ctx, param)
        found.setdefault(key, []).append(value)
    return found


where_option = text(
    "--where",
    "KEY=VALUE",
    "Only cells with this value of a swept key; the same key again: or this one.",
    multiple=True,
    callback=chosen_cells,
)
