"""How a command ends: status 2 and a plain message on a user's mistake, 130 on Ctrl-C, 143 on SIGTERM, 70 on
an error of jaxnet's own.
"""

import contextlib
import errno
import os
import shlex
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from jaxnet.cli.echo import echo
from jaxnet.lazy import LazyModule
from jaxnet.version import __version__

if TYPE_CHECKING:
    from jaxnet.config import document
    from jaxnet.outside import blame, modules
    from jaxnet.runs import cluster
    from jaxnet.store import folder
else:
    cluster = LazyModule("jaxnet.runs.cluster")
    document = LazyModule("jaxnet.config.document")
    folder = LazyModule("jaxnet.store.folder")
    modules = LazyModule("jaxnet.outside.modules")
    blame = LazyModule("jaxnet.outside.blame")

STOPPED: dict[int, str] = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
REPEAT_AFTER = 0.5  # [s]
DISK_FAULTS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


@contextlib.contextmanager
def interrupts() -> Iterator[list[int]]:
    """Have Ctrl-C and SIGTERM raise KeyboardInterrupt; yield the list of the signals that came.

    KeyboardInterrupt is raised again after `REPEAT_AFTER`, since some code, as a callback of gc, ignores it.
    """
    came: list[int] = []

    def interrupt(number: int, _: object) -> None:
        came.append(number)
        signal.setitimer(signal.ITIMER_REAL, REPEAT_AFTER)
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in (*STOPPED, signal.SIGALRM)}
    try:
        yield came
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def unforeseen() -> Iterator[None]:
    """Exit with status 70, one line and a file with the traceback on an error that nobody foresaw."""
    try:
        yield
    except (click.ClickException, click.exceptions.Exit, click.Abort):
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno == errno.EPIPE:  # click ends such a command
            raise
        click.echo(f"jaxnet failed: {blame.with_place(error)}; {report_file(error)}", err=True)
        sys.exit(70)


def report_file(error: Exception) -> str:
    """Write the traceback of an error to a new file; return where it is."""
    told = "".join(traceback.format_exception(error))
    try:
        with tempfile.NamedTemporaryFile("w", prefix="jaxnet-", suffix=".txt", delete=False) as file:
            file.write(f"jaxnet {__version__}: {shlex.join(sys.argv)}\n{told}")
    except OSError as unwritten:
        return f"its traceback cannot be written ({unwritten}):\n{told}"
    return f"its traceback is in {file.name}"


@contextlib.contextmanager
def user_errors() -> Iterator[None]:
    """Exit with status 2 and a message on a user's mistake, 130 on Ctrl-C, 143 on SIGTERM."""
    came: list[int] = []
    try:
        with interrupts() as came, warnings.catch_warnings(), blame.blaming():
            warnings.showwarning = lambda message, *_: echo(f"warning: {message}", err=True)
            yield
    except KeyboardInterrupt:
        number = came[0] if came else signal.SIGINT
        echo(f"{STOPPED[number]}; {cluster.KEPT}", err=True)
        sys.stdout.flush()
        os._exit(128 + number)  # not to wait for programs under way, whose lanes nobody will take
    except OSError as error:
        if error.errno not in DISK_FAULTS and not isinstance(error, folder.UnwrittenError | PermissionError):
            raise
        echo("; ".join(filter(None, (str(error), remedy()))), err=True)
        sys.exit(2)
    except (document.ConfigError, folder.FolderError, cluster.ClusterError, modules.KindError) as error:
        echo(str(error), err=True)
        if isinstance(error, document.ConfigError) and len(error.problems) > 1:
            echo(f"{len(error.problems)} errors", err=True)
        sys.exit(2)


def remedy() -> str:
    """Return advice for a command that cannot write: repeat it if it resumes, or give another place."""
    names = {option.name for option in click.get_current_context().command.params}
    resumes = "config" in names and "results" not in names
    options = {"out": "--out", "mat": "--mat"}
    elsewhere = [f"give another place with {options[name]}" for name in options if name in names]
    return " or ".join([cluster.KEPT] * resumes + elsewhere)
