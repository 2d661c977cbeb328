"""How a command ends: status 2 and a plain message on a user's mistake, 130 on Ctrl-C, 143 on SIGTERM."""

import contextlib
import errno
import os
import signal
import sys
import warnings
from collections.abc import Iterator

import click

STOPPED: dict[int, str] = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
KEPT = "what is finished is kept, the same command goes on"
AGAIN = 0.5  # [s]
NOT_OURS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)  # faults that are not ours


@contextlib.contextmanager
def interrupts() -> Iterator[list[int]]:
    """Have Ctrl-C and SIGTERM raise KeyboardInterrupt, and say which of them came.

    It is raised again where it is ignored, as in a callback of gc.
    """
    came: list[int] = []

    def interrupt(number: int, _: object) -> None:
        came.append(number)
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in (*STOPPED, signal.SIGALRM)}
    try:
        yield came
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def user_errors() -> Iterator[None]:
    """End with status 2 and a plain message on what the user can mend, 130 on Ctrl-C, 143 on SIGTERM."""
    from jaxnet.config.document import ConfigError
    from jaxnet.kinds.blame import blaming
    from jaxnet.kinds.modules import KindError
    from jaxnet.runs.cluster import ClusterError
    from jaxnet.store.folder import FolderError, UnwrittenError

    came: list[int] = []
    try:
        with interrupts() as came, warnings.catch_warnings(), blaming():
            warnings.showwarning = lambda message, *_: click.echo(f"warning: {message}", err=True)
            yield
    except OSError as error:
        if error.errno not in NOT_OURS and not isinstance(error, UnwrittenError | PermissionError):
            raise
        click.echo("; ".join(filter(None, (str(error), remedy()))), err=True)
        sys.exit(2)
    except (ConfigError, FolderError, ClusterError, KindError) as error:
        click.echo(str(error), err=True)
        if isinstance(error, ConfigError) and len(error.problems) > 1:
            click.echo(f"{len(error.problems)} errors", err=True)
        sys.exit(2)
    except KeyboardInterrupt:
        number = came[0] if came else signal.SIGINT
        click.echo(f"{STOPPED[number]}; {KEPT}", err=True)
        sys.stdout.flush()
        os._exit(128 + number)  # not to wait for programs under way, whose lanes nobody will take


def remedy() -> str:
    """What to do where a command cannot write: the same again if it resumes, or another place."""
    names = {option.name for option in click.get_current_context().command.params}
    resumes = "config" in names and "results" not in names
    options = {"out": "--out", "mat": "--mat"}
    elsewhere = [f"give another place with {options[name]}" for name in options if name in names]
    return " or ".join([KEPT] * resumes + elsewhere)
