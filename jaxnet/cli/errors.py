"""How a command ends: a user's mistakes with status 2 and a plain message, Ctrl-C with 130."""

import contextlib
import errno
import os
import signal
import sys
import warnings
from collections.abc import Iterator

import click

INTERRUPTED = 130
AGAIN = 0.5  # [s]
NOT_OURS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)  # faults that are not ours


@contextlib.contextmanager
def interrupts() -> Iterator[None]:
    """Have Ctrl-C raise KeyboardInterrupt, and again where that is ignored, as in a callback of gc."""

    def interrupt(*_: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGALRM)}
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def user_errors() -> Iterator[None]:
    """End with status 2 and a plain message on what the user can mend, 130 on Ctrl-C."""
    from jaxnet.config.document import ConfigError
    from jaxnet.kinds.registry import KindError, blaming
    from jaxnet.runs.cluster import ClusterError
    from jaxnet.store.folder import FolderError

    try:
        with interrupts(), warnings.catch_warnings(), blaming():
            warnings.showwarning = lambda message, *_: click.echo(f"warning: {message}", err=True)
            yield
    except (ConfigError, FolderError, ClusterError, KindError) as error:
        click.echo(str(error), err=True)
        if isinstance(error, ConfigError) and len(error.problems) > 1:
            click.echo(f"{len(error.problems)} errors", err=True)
        sys.exit(2)
    except OSError as error:
        if error.errno not in NOT_OURS and not isinstance(error, PermissionError):
            raise
        click.echo(f"{error}; what is finished is kept, the same command goes on", err=True)
        sys.exit(2)
    except KeyboardInterrupt:
        click.echo("interrupted; what is finished is kept, the same command goes on", err=True)
        sys.stdout.flush()
        os._exit(INTERRUPTED)  # not to wait for programs under way, whose lanes nobody will take
