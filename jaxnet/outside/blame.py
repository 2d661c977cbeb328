"""Errors of kinds from outside, as messages with the file and line where they arose."""

import contextlib
from collections.abc import Iterator

from jaxnet.outside import modules, provenance
from jaxnet.outside.modules import KindError


def with_place(error: BaseException) -> str:
    """Return an error's type and the first line of its message after the place where it arose.

    The place is the file and line of a syntax error, else of the innermost frame from outside, else of the
    innermost frame.
    """
    frames, outside = list(traceback_lines(error)), outside_files()
    places = [(file, line) for file, line in frames if file in outside] or frames
    told = str(error)
    if isinstance(error, SyntaxError) and error.filename:
        places, told = [(error.filename, error.lineno or 1)], error.msg
    first = modules.without_private(told.strip().partition("\n")[0])
    message = f"{type(error).__name__}: {first}" if first else type(error).__name__
    return f"{places[-1][0]}:{places[-1][1]}: {message}" if places else message


def traceback_lines(error: BaseException) -> Iterator[tuple[str, int]]:
    """Yield the file and line of each frame of an error's traceback, outermost first."""
    frame = error.__traceback__
    while frame is not None:
        yield frame.tb_frame.f_code.co_filename, frame.tb_lineno
        frame = frame.tb_next


def outside_files() -> set[str]:
    """Return all files from which kinds from outside were loaded or imported."""
    return modules.loaded_files() | {
        each.file for each in provenance.IMPORTED_SOURCES.values() if each.file
    }


def blame(error: BaseException) -> KindError | None:
    """Return a KindError with the place if an error passed through a file from outside, else None."""
    outside = outside_files()
    if isinstance(error, KindError) or not any(
        file in outside for file, _ in traceback_lines(error)
    ):
        return None
    return KindError(with_place(error))


@contextlib.contextmanager
def blaming() -> Iterator[None]:
    """Turn an error that a kind from outside raises, or its exit, into a KindError with its file and line."""
    try:
        yield
    except (Exception, SystemExit) as error:
        blamed = blame(error)
        if blamed is None:
            raise
        raise blamed from error
