"""Text on its way to a terminal."""

from typing import TYPE_CHECKING

import click

from jaxnet.lazy import LazyModule

if TYPE_CHECKING:
    from jaxnet.config import document
else:
    document = LazyModule("jaxnet.config.document")


def echo(message: object, err: bool = False, nl: bool = True) -> None:
    """Print a message; what it quotes of files moves no cursor, and names no window."""
    click.echo(document.escape_controls(str(message), but="\n\t"), err=err, nl=nl)
