"""How a command ends: status 2 and a plain message on a user's mistake, 130 on Ctrl-C, 143 on
SIGTERM, 70 on an error of jaxnet's own.
"""

import contextlib
import errno
import itertools
import os
import re
import shlex
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterable, Iterator

import click

from jaxnet.config.document import ConfigError, escape_controls
from jaxnet.outside import blame
from jaxnet.outside.modules import KindError
from jaxnet.runs.cluster import KEPT, ClusterError
from jaxnet.store.folder import FolderError, UnwrittenError
from jaxnet.version import __version__

STOPPED: dict[int, str] = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
REPEAT_AFTER = 0.5  # [s]
NO_PLATFORM = "Unable to initialize backend"  # how JAX begins its error for JAX_PLATFORMS
DISK_FAULTS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


def echo(message: object, err: bool = False, nl: bool = True) -> None:
    """Print a message; what it quotes of files moves no cursor, and names no window."""
    click.echo(escape_controls(str(message), but="\n\t"), err=err, nl=nl)


def tell_written(paths: Iterable[object]) -> None:
    """Name the files that are written; a figure's PNG and PDF in one line."""
    bare = re.compile(r"\.(png|pdf)$")
    for _, (first, *pdf) in itertools.groupby(map(str, paths), lambda path: bare.sub("", path)):
        echo(f"wrote {first}{' and .pdf' * len(pdf)}", err=True)


def tell_next(command: str, *words: object) -> None:
    echo(f"next: {shlex.join(['jaxnet', command, *map(str, words)])}", err=True)


@contextlib.contextmanager
def interrupts() -> Iterator[list[int]]:
    """Have Ctrl-C and SIGTERM raise KeyboardInterrupt; yield the list of the signals that came.

    KeyboardInterrupt is raised again after `REPEAT_AFTER`, since some code, as a callback of gc,
    ignores it.
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
    """Exit with status 70, a line and a file with the traceback on an error that nobody foresaw."""
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
        with tempfile.NamedTemporaryFile(
            "w", prefix="jaxnet-", suffix=".txt", delete=False
        ) as file:
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
        echo(f"{STOPPED[number]}; {KEPT}", err=True)
        sys.stdout.flush()
        os._exit(128 + number)  # not to wait for programs under way, whose lanes nobody will take
    except OSError as error:
        if error.errno not in DISK_FAULTS and not isinstance(
            error, UnwrittenError | PermissionError
        ):
            raise
        told = f"cannot write standard output: {error.strerror}" if from_echo(error) else str(error)
        echo("; ".join(filter(None, (told, remedy()))), err=True)
        sys.exit(2)
    except MemoryError as error:
        echo(f"out of memory{f': {error}' * bool(str(error))}; {KEPT}", err=True)
        sys.exit(2)
    except (ConfigError, FolderError, ClusterError, KindError) as error:
        echo(str(error), err=True)
        if isinstance(error, ConfigError) and len(error.problems) > 1:
            echo(f"{len(error.problems)} errors", err=True)
        sys.exit(2)
    except RuntimeError as error:
        if not str(error).startswith(NO_PLATFORM):
            raise
        echo(f"JAX: {str(error).splitlines()[0]}", err=True)
        sys.exit(2)


def from_echo(error: OSError) -> bool:
    """Return whether an error without a file's name is from a command's own output."""
    frames = (frame for frame, _ in traceback.walk_tb(error.__traceback__))
    return error.filename is None and any(frame.f_code is click.echo.__code__ for frame in frames)


def remedy() -> str:
    """Advise a command that cannot write: repeat it if it resumes, or give another place."""
    names = {option.name for option in click.get_current_context().command.params}
    resumes = "config" in names and "results" not in names
    options = {"out": "--out", "mat": "--mat"}
    elsewhere = [f"give another place with {options[name]}" for name in options if name in names]
    return " or ".join([KEPT] * resumes + elsewhere)
